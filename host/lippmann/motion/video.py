"""Writes video files, lossless for panels and compressed for views."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.base.animation import write_animation
from lippmann.base.files import not_written, replacing
from lippmann.base.images import Radiance, check_output
from lippmann.base.tones import encoded_values
from lippmann.errors import MissingLibraryError, to_install
from lippmann.rendering.sampling import Window

Values = npt.NDArray[np.uint8]
#: Suffixes of lossless videos. Blurred colours would mix neighbouring lenslets' images.
LOSSLESS_SUFFIXES = (".mkv",)
#: Suffixes of videos for all players. An .mp4's colour has half the resolution, so the
#: width and the height must be even.
VIEW_SUFFIXES = (".mp4",)


def even_window(window: Window) -> Window:
    """Return a window of even width and height in pixels, as .mp4 needs."""
    return replace(window, width_px=-(-window.width_px // 2) * 2, height_px=-(-window.height_px // 2) * 2)


def write_video(
    path: str | Path, frames: Iterable[Values], width_px: int, height_px: int, frames_per_second: float
) -> None:
    """Write a video of sRGB frames (height, width, 3) uint8, with FFV1 (.mkv) or H.264 (.mp4, even sides).

    Raises InputError if writing fails, MissingLibraryError if ffmpeg is missing.
    """
    path = check_output(path, LOSSLESS_SUFFIXES + VIEW_SUFFIXES)
    try:
        import imageio_ffmpeg

        ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise MissingLibraryError(f"ffmpeg is missing ({error}); {to_install('render')}") from None
    rate = Fraction(frames_per_second).limit_denominator(1000)
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width_px}x{height_px}", "-r", str(rate), "-i", "-"]
    if path.suffix.lower() in LOSSLESS_SUFFIXES:
        codec = ["-c:v", "ffv1", "-pix_fmt", "bgr0"]
    else:
        codec = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "15", "-movflags", "+faststart"]
        codec += ["-vf", "scale=out_color_matrix=bt709:out_range=tv"]
        codec += ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1"]
    with replacing(path) as partial:
        place = f"file:{partial}"  # else a colon would mean a protocol, and a dash an option
        command = [ffmpeg, "-y", "-v", "quiet", *source, *codec, place]
        try:
            # ffmpeg has its own process group, so that Ctrl-C does not end it.
            with subprocess.Popen(command, stdin=subprocess.PIPE, process_group=0) as encoder:
                assert encoder.stdin is not None
                for frame in frames:
                    encoder.stdin.write(np.ascontiguousarray(frame).data)
        except BrokenPipeError:  # ffmpeg has ended; -v quiet hides its message
            raise not_written(path, "ffmpeg stopped", partial) from None
        if encoder.returncode:
            raise not_written(path, "ffmpeg stopped", partial)


def write_views(
    path: str | Path, views: Iterable[Radiance], window: Window, frames_per_second: float, there_and_back: bool = False
) -> None:
    """Write linear views (height, width, 3) to a file. Raises errors of `write_video`, `write_animation`."""
    if Path(path).suffix.lower() not in VIEW_SUFFIXES:
        write_animation(path, views, there_and_back, 1000.0 / frames_per_second)
        return
    frames: Iterable[Values] = (encoded_values(view, "srgb", 8) for view in views)
    if there_and_back:
        forth = list(frames)
        frames = [*forth, *forth[-2:0:-1]]
    write_video(path, frames, window.width_px, window.height_px, frames_per_second)
