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

#: Frames that a camera has in its buffers when the picture changes, which are dropped.
STALE_FRAMES = 4
#: A width and a height beyond those of all cameras: the driver takes its largest. Unasked, it takes 640 x 480.
LARGEST_PX = 10_000
SIZE = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
logger = logging.getLogger("lippmann")


@contextmanager
def open_webcam(number: int) -> Iterator[cv2.VideoCapture]:
    """Open a webcam of this machine at its largest size, and fix its exposure, gain, focus and white balance.

    Warns of settings that its driver does not take. Raises DeviceError when there is no such camera.
    """
    camera = cv2.VideoCapture(number)
    try:
        if not camera.isOpened():
            raise DeviceError(f"camera {number} does not open; choose another --camera, and close other programs")
        if refused := fix_settings(camera):
            text = (
                f"camera {number} ({camera.getBackendName()}) does not let {', '.join(refused)} be set; "
                "set it in the camera's own program, so that all photographs are alike"
            )
            warnings.warn(text, LippmannWarning, stacklevel=3)
        size = [int(camera.get(side)) for side in SIZE]
        logger.info("camera %d: %d x %d pixels", number, *size)
        yield camera
    finally:
        camera.release()


def fix_settings(camera: cv2.VideoCapture) -> list[str]:
    """Set a camera's largest size, and switch its automatic settings off; return the names of those it refused.

    A driver tells by `set` that it refuses a property, or silently keeps the old value: each one is read back.
    """
    # The size comes first: a new size may reset the rest.
    sizes = [camera.set(side, LARGEST_PX) for side in SIZE]
    refused = [] if all(sizes) else ["the size"]
    # "Manual" is 1 in V4L2's enumeration, where 0.25 is rounded to 0, which is automatic; other drivers take 0.25.
    manual = 1.0 if camera.getBackendName() in ("V4L", "V4L2") else 0.25
    settings = {
        "exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, manual),
        "focus": (cv2.CAP_PROP_AUTOFOCUS, 0.0),
        "white balance": (cv2.CAP_PROP_AUTO_WB, 0.0),
        # OpenCV cannot switch an automatic gain off; drivers do so when a gain is set.
        "gain": (cv2.CAP_PROP_GAIN, camera.get(cv2.CAP_PROP_GAIN)),
    }
    for name, (prop, value) in settings.items():
        if not camera.set(prop, value) or abs(camera.get(prop) - value) > 1e-3:
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
        show(patterns.panel_values(pattern, display))
        time.sleep(settle_s)
        for _ in range(STALE_FRAMES):
            camera.grab()
        files.append(folder / f"{pattern.stem}.png")
        photograph = average_frames(camera, average, pattern.stem)
        with replacing(files[-1]) as partial:
            cv2.imwrite(str(partial), photograph)
        progress(len(files), len(patterns.patterns))
    return files


def average_frames(camera: cv2.VideoCapture, count: int, name: str) -> Pixels:
    """Return the mean of `count` frames of a camera, for the photograph of the pattern `name`.

    The mean is taken in linear light: that of encoded values would be darker. Raises DeviceError without a frame.
    """
    light = np.zeros(1, np.float32)
    for _ in range(count):
        good, frame = camera.read()
        if not good:
            raise DeviceError(f"the camera gave no picture for {name}; check its cable, and shoot again")
        light = light + decode_values(np.asarray(frame))
    return encoded_values(light / count, "srgb", 8).astype(np.uint8, copy=False)
