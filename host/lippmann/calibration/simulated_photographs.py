"""Photographs of patterns on a display, as a camera takes them: a folder of pictures with the patterns' names."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from lippmann.base import interrupts
from lippmann.base.files import make_folder, replacing
from lippmann.base.tones import decode
from lippmann.calibration.simulated_camera import Camera
from lippmann.calibration.simulated_disturbances import (
    Disturbances,
    blurred,
    disturbed,
    reflected,
    with_outliers,
    without_dead,
)
from lippmann.calibration.simulated_projection import Light, Sight, sight_of
from lippmann.calibration.simulated_sensor import Sensor
from lippmann.display.description import Display, Panel
from lippmann.errors import input_error

#: Computes what a camera sees of a display.
Look = Callable[[Display, Camera], Sight]


def photograph_folder(
    display: Display,
    camera: Camera,
    patterns: str | Path,
    output: str | Path,
    seed: int = 0,
    sensor: Sensor = Sensor(),  # noqa: B008 (frozen)
    disturbances: Disturbances = Disturbances(),  # noqa: B008 (frozen)
    samples: int = 3,
    look: Look | None = None,
) -> list[Path]:
    """Photograph a folder of patterns on a display as built, and write the photographs under the patterns' names.

    Parameters
    ----------
    display
        The display as built; its panel shows the patterns.
    camera
        Where the camera stands and what it is. See `lippmann.calibration.simulated_camera.framed`.
    patterns
        Folder of PNG files of the panel's size, whose names begin with the order in which they are shown.
    output
        Folder for the photographs, which is made when missing, with its parents.
    seed
        Of the rays, the noise, reflections and outliers.
    sensor, disturbances
        Of the camera, and of the bench.
    samples
        Rays across each camera pixel, and down.
    look
        Computes what the camera sees: `simulated_solids.look_at_solids` by POV-Ray. `None` is our own tracer.

    Returns
    -------
    list of Path
        The photographs, in the patterns' order.

    Raises
    ------
    InputError
        When there are no patterns, one is not of the panel's size, or a photograph cannot be written.
    """
    names, output = pattern_files(patterns), Path(output)

    def see(camera: Camera) -> Sight:
        if look is not None:
            return look(display, camera)
        return sight_of(display, camera, samples, seed, disturbed(display, disturbances))

    before = after = see(camera)
    if any(disturbances.moved_mm):
        after = see(disturbances.after_move(camera))
    rng = np.random.default_rng((seed, 0xCA3))
    shape = camera.height_px, camera.width_px
    added = reflected(shape, disturbances.reflection, disturbances.bright_spot, seed)
    white = before.photograph(np.ones((display.panel.height_px, display.panel.width_px), np.float32))
    gain = sensor.gain(white)
    # The camera's light for the panel's white: that of the exposure.
    added *= sensor.exposure / max(gain, 1e-30)
    written = []
    make_folder(output)
    for number, name in enumerate(names):
        interrupts.check()
        light = without_dead(panel_light(name, display.panel), disturbances.dead_pixels, disturbances.seed)
        picture = (before if 2 * number < len(names) else after).photograph(light)
        picture = picture + (added if picture.ndim == 2 else added[..., None])
        if disturbances.blur_px > 0.0:
            picture = blurred(picture, disturbances.blur_px)
        values = sensor.values(picture, gain, rng)
        if disturbances.outliers > 0.0:
            values = with_outliers(values, disturbances.outliers, seed, rng)
        written.append(_save(output / name.name, values))
    return written


def pattern_files(patterns: str | Path) -> list[Path]:
    """Return the PNG files of a folder of patterns, in order; InputError when there are none."""
    found = sorted(Path(patterns).glob("*.png"))
    if not found:
        raise input_error(str(patterns), "holds no patterns", "write them: lippmann calibrate patterns")
    return found


def panel_light(path: Path, panel: Panel) -> Light:
    """Return the linear light of a panel that shows a PNG file's values, (height, width), or with 3 colours."""
    with Image.open(path) as picture:
        if picture.size != (panel.width_px, panel.height_px):
            size = f"{picture.size[0]} x {picture.size[1]}"
            what = f"is {size} pixels, the panel {panel.width_px} x {panel.height_px}"
            raise input_error(str(path), what, "write patterns for this display")
        values = np.asarray(picture if picture.mode in ("L", "RGB") or "I" in picture.mode else picture.convert("RGB"))
    scale = 255.0 if values.dtype == np.uint8 else 65535.0
    if values.ndim == 3 and (values == values[..., :1]).all():
        values = values[..., 0]
    light = decode(values / np.float32(scale), panel.transfer)
    return np.asarray(panel.black + (1.0 - panel.black) * light, np.float32)


def _save(path: Path, values: npt.NDArray[np.unsignedinteger[Any]]) -> Path:
    with replacing(path) as partial:
        # Noise has no runs to be found: Huffman's code alone is as small, and quicker.
        Image.fromarray(values).save(partial, "PNG", compress_level=1, compress_type=zlib.Z_HUFFMAN_ONLY)
    return path
