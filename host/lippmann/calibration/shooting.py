"""Show the patterns one after the other, and photograph each pattern with a webcam."""

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
from lippmann.base.progress_protocol import Progress
from lippmann.base.tones import encoded_values
from lippmann.calibration.coded_patterns import PatternSet, Pixels
from lippmann.calibration.photographs import decode_values
from lippmann.display.description import Display
from lippmann.errors import DeviceError, LippmannWarning

SIZE = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
logger = logging.getLogger("lippmann")


@contextmanager
def open_webcam(number: int) -> Iterator[cv2.VideoCapture]:
    """Open a webcam at its maximum size with fixed settings; warn about refused settings.

    Raises DeviceError if the webcam does not open.
    """
    # Silence OpenCV's driver messages; the DeviceError below reports the problem.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    camera = cv2.VideoCapture(number)
    try:
        if not camera.isOpened():
            raise DeviceError(f"camera {number} does not open; close programs that use it, or give another --camera")
        if refused := fix_settings(camera):
            what = f"camera {number} ({camera.getBackendName()}) did not accept the settings for {', '.join(refused)}"
            remedy = "fix these settings in the camera's own program"
            warnings.warn(f"{what}; {remedy}", LippmannWarning, stacklevel=3)
        size = [int(camera.get(side)) for side in SIZE]
        logger.info("camera %d: %d x %d pixels", number, *size)
        yield camera
    finally:
        camera.release()


def fix_settings(camera: cv2.VideoCapture) -> list[str]:
    """Set the maximum size, and disable automatic settings; return the names of refused settings."""
    # Set the size first, as it may reset other settings; the driver limits the size.
    sizes = [camera.set(side, 10_000) for side in SIZE]
    refused = [] if all(sizes) else ["the size"]
    # The value 1 is manual exposure in V4L2, which rounds 0.25 to 0 (automatic). In
    # all drivers but V4L2, 0.25 is manual exposure.
    manual = 1.0 if camera.getBackendName() in ("V4L", "V4L2") else 0.25
    settings = {
        "exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, manual),
        "focus": (cv2.CAP_PROP_AUTOFOCUS, 0.0),
        "white balance": (cv2.CAP_PROP_AUTO_WB, 0.0),
        # Writing a gain disables the automatic gain.
        "gain": (cv2.CAP_PROP_GAIN, camera.get(cv2.CAP_PROP_GAIN)),
    }
    for name, (prop, value) in settings.items():
        if not camera.set(prop, value) or abs(camera.get(prop) - value) > 1e-3:  # the driver may refuse silently
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
    """Show each pattern, wait `settle_s`, and save the mean of `average` frames; return the paths.

    Raises DeviceError if the camera returns no frame.
    """
    make_folder(folder)
    files = []
    for pattern in patterns.patterns:
        interrupts.check()
        show(patterns.panel_values(pattern, display))
        time.sleep(settle_s)
        for _ in range(4):  # discard buffered camera frames
            camera.grab()
        files.append(folder / f"{pattern.stem}.png")
        photograph = average_frames(camera, average, pattern.stem)
        with replacing(files[-1]) as partial:
            cv2.imwrite(str(partial), photograph)
        progress(len(files), len(patterns.patterns))
    return files


def average_frames(camera: cv2.VideoCapture, count: int, name: str) -> Pixels:
    """Return the mean of `count` camera frames, computed in linear light.

    Raises DeviceError if the camera returns no frame.
    """
    light = np.zeros(1, np.float32)
    for _ in range(count):
        good, frame = camera.read()
        if not good:
            raise DeviceError(f"the camera returned no frame for {name}; check the cable, and run the command again")
        light = light + decode_values(np.asarray(frame))
    return encoded_values(light / count, "srgb", 8).astype(np.uint8, copy=False)
