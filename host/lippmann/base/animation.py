"""Writes animations and contact sheets of views, and encodes PNG files."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lippmann.base.files import replacing, write_file
from lippmann.base.images import Radiance, check_output
from lippmann.base.tones import Numbers, encoded_values

if TYPE_CHECKING:
    import PIL.Image

ANIMATION_SUFFIXES = (".gif", ".png", ".apng")
FRAME_MS = 80
#: Measured memory of an animation per pixel and frame, bytes.
FRAME_BYTES = 13


def png_bytes(radiance: Numbers) -> bytes:
    """Encode linear radiance (height, width, 3) as the bytes of an sRGB PNG file with 8 bits."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(encoded_values(radiance, "srgb", 8)).save(stream, "PNG")
    return stream.getvalue()


def write_animation(
    path: str | Path, views: Iterable[Radiance], there_and_back: bool = True, frame_ms: float = FRAME_MS
) -> None:
    """Write views, (height, width, 3) linear radiance, as an endless GIF or animated PNG.

    `there_and_back` plays the views forwards, then backwards. Raises InputError if the
    file cannot be written.
    """
    path = check_output(path, ANIMATION_SUFFIXES)
    kind = "GIF" if path.suffix.lower() == ".gif" else "PNG"
    write_file(path, animation_bytes(views, kind, there_and_back, frame_ms))


def animation_bytes(
    views: Iterable[Radiance], kind: str, there_and_back: bool = True, frame_ms: float = FRAME_MS
) -> bytes:
    """Encode views as the bytes of an animation file; `kind` is "GIF" or "PNG"."""
    from PIL import Image

    frames = [Image.fromarray(encoded_values(view, "srgb", 8)) for view in views]
    if kind == "GIF":
        # With one palette and no dither, static areas compress well and do not flicker.
        palette = _common_palette(frames)
        frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    if there_and_back:
        frames += frames[-2:0:-1]
    first, *others = frames
    stream = io.BytesIO()
    first.save(stream, kind, save_all=True, append_images=others, duration=frame_ms, loop=0, optimize=True)
    return stream.getvalue()


def _common_palette(frames: Sequence[PIL.Image.Image]) -> PIL.Image.Image:
    from PIL import Image

    side = 96
    strip = Image.new("RGB", (side * len(frames), side))
    for k, frame in enumerate(frames):
        strip.paste(frame.resize((side, side), Image.Resampling.NEAREST), (k * side, 0))
    return strip.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=2)


def write_contact_sheet(path: str | Path, views: Sequence[Radiance], captions: Sequence[str], columns: int = 3) -> None:
    """Write a PNG of captioned views in rows.

    Raises InputError if the file cannot be written.
    """
    from PIL import Image, ImageDraw

    path = check_output(path, (".png",))
    height, width = views[0].shape[:2]
    columns = min(columns, len(views))
    rows = -(-len(views) // columns)
    margin, line = 8, 20
    size = columns * (width + margin) + margin, rows * (height + line + margin) + margin
    sheet = Image.new("RGB", size, (24, 24, 24))
    draw = ImageDraw.Draw(sheet)
    for k, (view, caption) in enumerate(zip(views, captions, strict=True)):
        x = margin + (k % columns) * (width + margin)
        y = margin + (k // columns) * (height + line + margin)
        sheet.paste(Image.fromarray(encoded_values(view, "srgb", 8)), (x, y))
        draw.text((x, y + height + 4), caption, fill=(230, 230, 230))
    with replacing(path) as partial:
        sheet.save(partial, format="PNG")
