"""Animations and contact sheets of views."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lippmann.images import check_output, encode, replacing

if TYPE_CHECKING:
    import PIL.Image

ANIMATION_SUFFIXES = (".gif", ".png", ".apng")
#: Time that each view stands, ms.
FRAME_MS = 80


def to_srgb8(radiance: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """Encode linear radiance (height, width, 3) for a screen."""
    return np.asarray(np.rint(encode(radiance, "srgb") * 255.0), np.uint8)


def write_animation(
    path: str | Path,
    views: Sequence[npt.NDArray[np.float32]],
    there_and_back: bool = True,
    frame_ms: float = FRAME_MS,
) -> None:
    """Write views as an endless GIF or animated PNG; `there_and_back` runs them to and fro, `frame_ms` each stands.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    from PIL import Image

    path = check_output(path, ANIMATION_SUFFIXES)
    frames = [Image.fromarray(to_srgb8(view)) for view in views]
    if there_and_back:
        frames += frames[-2:0:-1]
    kind = "GIF" if path.suffix.lower() == ".gif" else "PNG"
    with replacing(path) as partial:
        if kind == "GIF":
            # One palette for all frames and no dither: what does not move costs nothing, and nothing flickers.
            palette = _common_palette(frames[: len(views)])
            frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
        frames[0].save(
            partial,
            format=kind,
            save_all=True,
            append_images=frames[1:],
            duration=frame_ms,
            loop=0,
            optimize=True,
        )


def _common_palette(frames: Sequence[PIL.Image.Image]) -> PIL.Image.Image:
    """Return an image whose palette of 256 colours suits all frames, from a small copy of each."""
    from PIL import Image

    side = 96
    strip = Image.new("RGB", (side * len(frames), side))
    for k, frame in enumerate(frames):
        strip.paste(frame.resize((side, side), Image.Resampling.NEAREST), (k * side, 0))
    return strip.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=2)


def write_contact_sheet(
    path: str | Path,
    views: Sequence[npt.NDArray[np.float32]],
    captions: Sequence[str],
    columns: int = 3,
) -> None:
    """Write views side by side in rows, each with a caption below it.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    from PIL import Image, ImageDraw

    path = check_output(path, (".png",))
    height, width = views[0].shape[:2]
    columns = min(columns, len(views))
    rows = -(-len(views) // columns)
    margin, line = 8, 20
    sheet = Image.new(
        "RGB",
        (columns * (width + margin) + margin, rows * (height + line + margin) + margin),
        (24, 24, 24),
    )
    draw = ImageDraw.Draw(sheet)
    for k, (view, caption) in enumerate(zip(views, captions, strict=True)):
        x = margin + (k % columns) * (width + margin)
        y = margin + (k // columns) * (height + line + margin)
        sheet.paste(Image.fromarray(to_srgb8(view)), (x, y))
        draw.text((x, y + height + 4), caption, fill=(230, 230, 230))
    with replacing(path) as partial:
        sheet.save(partial, format="PNG")
