"""The frames of a film as files in a folder."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from lippmann.base.files import make_folder
from lippmann.base.images import read_picture
from lippmann.errors import InputError, input_error
from lippmann.motion.shot import Shot
from lippmann.rendering.integral_image import IntegralImage

#: How the names of frames begin.
FRAME_STEM = "frame_"


def frame_path(folder: Path, frame: int) -> Path:
    """Return the path of a frame."""
    return folder / f"{FRAME_STEM}{frame:04d}.exr"


#: What to do where no folder can be made.
REMEDY = "choose another folder with -o"


def check_folder(folder: Path, frames: int) -> None:
    """Raise InputError when a folder for a film's frames cannot be made, or contains frames of a longer film."""
    there = folder.exists()
    make_folder(folder, REMEDY)
    if not there:  # until there is a frame
        folder.rmdir()
    ours = {frame_path(folder, k) for k in range(frames)}
    for other in sorted(folder.glob("frame_*.exr")):
        if other not in ours:
            raise input_error(
                str(other), f"is beyond the film's {frames} frames", "remove it, or choose another folder"
            )


def is_rendered(folder: Path, shot: Shot) -> bool:
    """Tell whether a folder contains the complete frame of a shot."""

    def accept(metadata: Mapping[str, str]) -> None:
        if metadata.get("shot") != shot.identity:
            raise InputError("a frame of another film")

    panel = shot.display.panel
    try:
        read_picture(frame_path(folder, shot.frame), (panel.width_px, panel.height_px), accept)
    except InputError:
        return False
    return True


def write_frames(
    folder: Path,
    shots: Sequence[Shot],
    render: Callable[[Sequence[Shot]], Iterable[tuple[Shot, IntegralImage]]],
    progress: Callable[[int, int], None],
) -> int:
    """Render and write those of a film's frames that the folder lacks; return their number.

    `render` yields the image of each given shot, in any order. `progress` is called with (frames there, frames in all).

    Raises InputError as `render`, or when a file cannot be written.
    """
    there = folder.exists()
    make_folder(folder, REMEDY)
    missing = [shot for shot in shots if not is_rendered(folder, shot)]
    done = len(shots) - len(missing)
    progress(done, len(shots))
    try:
        for shot, image in render(missing):
            image.save(frame_path(folder, shot.frame))
            done += 1
            progress(done, len(shots))
    except BaseException:
        if not there:
            with contextlib.suppress(OSError):  # it holds frames
                folder.rmdir()
        raise
    return len(missing)
