"""Patterns shown one after the other, each photographed by a webcam."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.files import make_folder, replacing
from lippmann.base.progress import Progress
from lippmann.base.tones import encoded_values
from lippmann.calibration.coded_patterns import PatternSet
from lippmann.display.description import Display
from lippmann.errors import DeviceError

Pixels = npt.NDArray[np.uint8]
#: Frames that a camera has in its buffers when the picture changes, which are dropped.
STALE_FRAMES = 4


@contextmanager
def webcam(number: int) -> Iterator[Any]:
    """Give a webcam of this machine with its exposure and focus fixed, as far as its driver allows.

    Raises DeviceError when there is none.
    """
    camera = cv2.VideoCapture(number)
    try:
        if not camera.isOpened():
            raise DeviceError(f"camera {number} does not open; choose another --camera, and close other programs")
        # 0.25 and 1 mean "manual" to V4L2's and other drivers; one without the setting ignores it.
        camera.set(cv2.CAP_PROP_AUTO_EXPOSURE, 0.25)
        camera.set(cv2.CAP_PROP_AUTOFOCUS, 0)
        camera.set(cv2.CAP_PROP_AUTO_WB, 0)
        yield camera
    finally:
        camera.release()


def frame_of(patterns: PatternSet, place: int, display: Display) -> Pixels:
    """Return a pattern as values for the panel, (height, width, 3) uint8."""
    panel = display.panel
    light = patterns.light(patterns.patterns[place])
    values = encoded_values(np.asarray(light, np.float32), panel.transfer, min(panel.bits, 8)).astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(values[..., None], (*values.shape, 3)))


def shoot(
    patterns: PatternSet,
    display: Display,
    show: Callable[[Pixels], object],
    camera: Any,
    folder: Path,
    settle_s: float,
    average: int = 1,
    progress: Progress = lambda done, total: None,
) -> list[Path]:
    """Show each pattern, wait until panel and camera have settled, and write the photograph; return the files.

    Each photograph is the mean of `average` frames of the camera.

    Raises DeviceError when the camera gives no picture.
    """
    make_folder(folder)
    files = []
    for pattern in patterns.patterns:
        interrupts.check()
        show(frame_of(patterns, pattern.place, display))
        time.sleep(settle_s)
        for _ in range(STALE_FRAMES):
            camera.grab()
        total: npt.NDArray[np.float64] | None = None
        for _ in range(average):
            good, picture = camera.read()
            if not good:
                raise DeviceError(f"the camera gave no picture for {pattern.stem}; check its cable, and shoot again")
            total = picture.astype(np.float64) if total is None else total + picture
        assert total is not None
        files.append(folder / f"{pattern.stem}.png")
        with replacing(files[-1]) as partial:
            cv2.imwrite(str(partial), np.round(total / average).astype(np.uint8))
        progress(len(files), len(patterns.patterns))
    return files
