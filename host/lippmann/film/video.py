"""Video files of frames: lossless for panels, compressed for views."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.errors import MissingLibraryError, to_install
from lippmann.files import not_written, replacing
from lippmann.images import check_output
from lippmann.rendering.sources import Window

Values = npt.NDArray[np.uint8]
#: Lossless RGB: a codec that blurs colours would mix neighbouring lenslets' images.
LOSSLESS_SUFFIXES = (".mkv",)
#: For every player; colour has half the resolution, so both sides must be even.
VIEW_SUFFIXES = (".mp4",)


def even_window(window: Window) -> Window:
    """Return a window whose sides are even, as .mp4 needs."""
    return replace(window, width_px=-(-window.width_px // 2) * 2, height_px=-(-window.height_px // 2) * 2)


def write_video(
    path: str | Path, frames: Iterable[Values], width_px: int, height_px: int, frames_per_second: float
) -> int:
    """Write a video of frames, (height, width, 3) uint8 each, sRGB; return their number.

    .mkv is FFV1, lossless; .mp4 is H.264, for which width and height must be even.

    Raises InputError when the file cannot be written; MissingLibraryError when there is no ffmpeg.
    """
    path = check_output(path, LOSSLESS_SUFFIXES + VIEW_SUFFIXES)
    try:
        import imageio_ffmpeg as ffmpeg

        ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise MissingLibraryError(f"ffmpeg is missing ({error}); {to_install()}") from None
    if path.suffix.lower() in LOSSLESS_SUFFIXES:
        kind: dict[str, Any] = {"codec": "ffv1", "pix_fmt_out": "bgr0", "quality": None}
    else:
        colours = ("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1")
        convert = ("-vf", "scale=out_color_matrix=bt709:out_range=tv")
        kind = {"codec": "libx264", "quality": 7, "output_params": [*colours, *convert, "-movflags", "+faststart"]}
    count = 0
    with replacing(path) as partial:
        place = f"file:{partial}"  # ffmpeg reads a name with a colon as a protocol's, one with a dash as an option
        writer = ffmpeg.write_frames(
            place, (width_px, height_px), fps=Fraction(frames_per_second).limit_denominator(1000),
            macro_block_size=1, ffmpeg_log_level="quiet", **kind,
        )  # fmt: skip
        writer.send(None)
        try:
            for frame in frames:
                writer.send(np.ascontiguousarray(frame))
                count += 1
        except OSError:  # ffmpeg has ended; its message is too long to show
            raise not_written(path, "ffmpeg stopped", partial) from None
        finally:
            writer.close()
        # imageio_ffmpeg hides ffmpeg's exit code; a full disk shows as missing frames.
        try:
            written = ffmpeg.count_frames_and_secs(place)[0]
        except (RuntimeError, OSError):  # not a video
            written = -1
        if int(written) != count:
            raise not_written(path, "ffmpeg stopped", partial)
    return count
