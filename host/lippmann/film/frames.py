"""The frames of a film as files in a folder: which are there, which are to be rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from lippmann.errors import InputError, input_error
from lippmann.film.shot import Shot
from lippmann.images import Image, read_picture, write_picture


def frame_path(folder: Path, frame: int) -> Path:
    """Return the file of a frame."""
    return folder / f"frame_{frame:04d}.exr"


def check_folder(folder: Path, frames: int) -> None:
    """Make a folder for a film's frames, or see that it holds no frames beyond them.

    Raises
    ------
    InputError
        When it cannot be made, or holds frames of a longer film.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise input_error(str(folder), f"cannot be made ({error.strerror})", "choose another folder with -o") from None
    ours = {frame_path(folder, k) for k in range(frames)}
    for other in sorted(folder.glob("frame_*.exr")):
        if other not in ours:
            raise input_error(
                str(other), f"is beyond the film's {frames} frames", "remove it, or choose another folder"
            )


class _OtherFrameError(Exception):
    """A frame of another film."""


def is_there(folder: Path, shot: Shot) -> bool:
    """Tell whether a shot's frame lies in a folder, whole."""

    def accept(metadata: Mapping[str, str]) -> None:
        if metadata.get("shot") != shot.identity:
            raise _OtherFrameError

    panel = shot.display.panel
    try:
        read_picture(frame_path(folder, shot.frame), (panel.width_px, panel.height_px), accept)
    except (InputError, _OtherFrameError):
        return False
    return True


def write_frames(
    folder: Path,
    shots: Sequence[Shot],
    render: Callable[[Sequence[Shot]], Iterable[tuple[Shot, Image, dict[str, str]]]],
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Render the frames of a film that are not there yet; return how many that were.

    Parameters
    ----------
    folder
        Where they lie.
    shots
        All of the film.
    render
        Gives each of the shots that it gets, in any order, with radiance and what its file carries.
    progress
        Called with (frames there, frames in all).

    Raises
    ------
    InputError
        As `render`, or when a file cannot be written.
    """
    missing = [shot for shot in shots if not is_there(folder, shot)]
    done = len(shots) - len(missing)
    if progress is not None:
        progress(done, len(shots))
    for shot, radiance, metadata in render(missing):
        write_picture(frame_path(folder, shot.frame), radiance, metadata)
        done += 1
        if progress is not None:
            progress(done, len(shots))
    return len(missing)
