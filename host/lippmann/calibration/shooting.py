"""Patterns shown one after the other, each photographed by a webcam."""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from lippmann.base import interrupts
from lippmann.base.files import make_folder, replacing
from lippmann.base.progress import Progress
from lippmann.base.tones import encoded_values
from lippmann.calibration.coded_patterns import PatternSet, Pixels
from lippmann.calibration.photographs import decode_values
from lippmann.display.description import Display
from lippmann.errors import DeviceError, LippmannWarning

SIZE = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
logger = logging.getLogger("lippmann")


@contextmanager
def open_webcam(number: int) -> Iterator[cv2.VideoCapture]:
    """Open a webcam at its largest size with fixed settings; warn of refused ones.

    Raises DeviceError when there is no such camera.
    """
    # The error below says it, not OpenCV's lines about its drivers.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    camera = cv2.VideoCapture(number)
    try:
        if not camera.isOpened():
            raise DeviceError(f"camera {number} does not open; choose another --camera, and close other programs")
        if refused := fix_settings(camera):
            what = f"camera {number} ({camera.getBackendName()}) does not let {', '.join(refused)} be set"
            remedy = "set it in the camera's own program, so that all photographs are alike"
            warnings.warn(f"{what}; {remedy}", LippmannWarning, stacklevel=3)
        size = [int(camera.get(side)) for side in SIZE]
        logger.info("camera %d: %d x %d pixels", number, *size)
        yield camera
    finally:
        camera.release()


def fix_settings(camera: cv2.VideoCapture) -> list[str]:
    """Set the largest size and fix automatic settings; return the names of refused ones."""
    # The size, which the driver lowers to its largest, may reset other settings.
    sizes = [camera.set(side, 10_000) for side in SIZE]
    refused = [] if all(sizes) else ["the size"]
    # "Manual" is 1 in V4L2's enumeration, where 0.25 is rounded to 0, which is
    # automatic; other drivers take 0.25.
    manual = 1.0 if camera.getBackendName() in ("V4L", "V4L2") else 0.25
    settings = {
        "exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, manual),
        "focus": (cv2.CAP_PROP_AUTOFOCUS, 0.0),
        "white balance": (cv2.CAP_PROP_AUTO_WB, 0.0),
        # Setting a gain switches the automatic gain off.
        "gain": (cv2.CAP_PROP_GAIN, camera.get(cv2.CAP_PROP_GAIN)),
    }
    for name, (prop, value) in settings.items():
        if not camera.set(prop, value) or abs(camera.get(prop) - value) > 1e-3:  # refused silently
            refused.append(name)
    return refused


def shoot(
    patterns: PatternSet,
    display: Display,
    show: Callable[[Pixels], object],
    camera: cv2.VideoCapture,
    folder: Path,
    settle_s: float,
    average: int = 1,
    progress: Progress = lambda *_: None,
) -> list[Path]:
    """Show each pattern, wait, and write the mean of `average` frames; return the files.

    Raises DeviceError when the camera gives no picture.
    """
    make_folder(folder)
    files = []
    for pattern in patterns.patterns:
        interrupts.check()
        show(patterns.panel_values(pattern, display))
        time.sleep(settle_s)
        for _ in range(4):  # frames in the camera's buffers
            camera.grab()
        files.append(folder / f"{pattern.stem}.png")
        photograph = average_frames(camera, average, pattern.stem)
        with replacing(files[-1]) as partial:
            cv2.imwrite(str(partial), photograph)
        progress(len(files), len(patterns.patterns))
    return files


def average_frames(camera: cv2.VideoCapture, count: int, name: str) -> Pixels:
    """Return the mean of `count` frames in linear light; DeviceError without a frame for `name`."""
    light = np.zeros(1, np.float32)
    for _ in range(count):
        good, frame = camera.read()
        if not good:
            raise DeviceError(f"the camera gave no picture for {name}; check its cable, and shoot again")
        light = light + decode_values(np.asarray(frame))
    return encoded_values(light / count, "srgb", 8).astype(np.uint8, copy=False)
