"""Traces a camera's projection of a display with POV-Ray, independently of our tracer; lenslets are glass solids.

The panel's colours encode the indices of its pixels, so that one trace serves the photographs of all patterns. The
camera is a pinhole. To simulate a pupil, the pinhole has another position for each sample of a pixel.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from lippmann.base import interrupts
from lippmann.calibration.simulated_camera import Camera
from lippmann.calibration.simulated_photographs import Bench, Projection, collect_projection
from lippmann.capturing.povray_optics import ARRAY_FACES, array_solids
from lippmann.capturing.povray_text import block, vector
from lippmann.display.description import Display, Panel
from lippmann.errors import InputError
from lippmann.optics.rays import Floats

from tools.povray_runs import run_povray

Words = npt.NDArray[np.uint16]
TOP = 65535
#: Minimum gap, mm, between panel and array at which POV-Ray distinguishes their surfaces.
LEAST_GAP_MM = 1e-3
#: Angle between successive points of a spiral that fills a disc evenly, and maximum rotation of a grid, radians.
GOLDEN_ANGLE, TURN = np.pi * (3.0 - np.sqrt(5.0)), 0.1
HEADER = "#version 3.7;\nglobal_settings {{ assumed_gamma 1.0 max_trace_level {levels} adc_bailout 0 }}\n"
INI = """Input_File_Name={name}.pov
Output_File_Name={name}.png
Output_File_Type=N
Bits_Per_Color=16
File_Gamma=1.0
Width={width}
Height={height}
Antialias=off
Display=off
Pause_When_Done=off
"""


@dataclass(frozen=True)
class Rays:
    """A grid of one ray per pixel: position in the pixel (0 to 1), rotation (radians), point in the unit pupil."""

    shift: tuple[float, float] = (0.5, 0.5)
    turn: float = 0.0
    pupil: tuple[float, float] = (0.0, 0.0)


class SolidsBench(Bench):
    """A bench whose projections POV-Ray traces with `samples` x `samples` rays per pixel.

    The camera needs a `blur_px` of 0.4 or more, because regular grids alias. Raises InputError for sub-pixels.
    """

    def __init__(self, samples: int = 3, seed: int = 0) -> None:
        self.samples, self.rng = samples, np.random.default_rng((seed, 0x907))

    def project(self, display: Display, camera: Camera, samples: int = 0, seed: int = 0) -> Projection:
        """Return the camera's projection of the display; the bench's samples and seed replace `samples` and `seed`."""
        pixels, places, lights = [], [], []
        with tempfile.TemporaryDirectory() as folder:
            write_model(display, Path(folder))
            write_picture(Path(folder) / "panel.png", numbered(display.panel))
            for grid in _spread(self.samples, self.rng):
                interrupts.check()
                values, u, v = render(Path(folder), camera, grid)
                place, lit = numbers(values, display.panel)
                u, v = (axis + camera.blur_px * self.rng.standard_normal(len(axis)) for axis in (u, v))
                within = (u >= 0.0) & (u < camera.width_px) & (v >= 0.0) & (v < camera.height_px)
                column, row = np.floor(u[within]).astype(np.int64), np.floor(v[within]).astype(np.int64)
                pixels.append(row * camera.width_px + column)
                places.append(place[within])
                lights.append(lit[within])
        band = np.concatenate(pixels), np.concatenate(places), np.concatenate(lights)
        return collect_projection(display, camera, iter([(0, camera.width_px * camera.height_px, *band)]))


def write_model(display: Display, folder: Path) -> None:
    """Write the display's model, `model.inc`: lenslets as solids, and a panel that shows `panel.png`."""
    array, panel = display.array, display.panel
    if panel.subpixels != "none":
        what = f"display '{display.name}' has colour sub-pixels"
        raise InputError(f"{what}, which the POV-Ray model does not have; set subpixels to none")
    plano_to_panel = array.plano_side == "panel"
    depth = max(display.gap_mm, LEAST_GAP_MM) + (array.thickness_mm if plano_to_panel else 0.0)
    picture = block(
        "polygon",
        "5, <0, 0>, <1, 0>, <1, 1>, <0, 1>, <0, 0>",
        'texture { pigment { image_map { png "panel.png" gamma 1.0 once } }',
        "finish { ambient 0 diffuse 0 emission 1 } }",
        f"scale {vector((panel.width_mm, panel.height_mm, 1.0))}",
        f"translate {vector((-0.5 * panel.width_mm, -0.5 * panel.height_mm, -depth))}",
    )
    solids = array_solids(display, 0.0, -1.0 if plano_to_panel else 1.0)
    (folder / "model.inc").write_text(f"{solids}\n{picture}\n")


def render(folder: Path, camera: Camera, grid: Rays = Rays()) -> tuple[Words, Floats, Floats]:
    """Render a folder's model; return the rays' values (N, 3), and their positions u, v (N,) in the photograph, px."""
    slopes = camera.slopes(*camera.border())
    c, s = math.cos(grid.turn), math.sin(grid.turn)
    # Compute the corners of the field of view along the axes of the rotated grid.
    x, y = (axis.ravel() for axis in np.meshgrid(*((slope.min(), slope.max()) for slope in slopes)))
    along, across = c * x + s * y, c * y - s * x
    step = 1.0 / camera.focal_px
    width, height = (int(np.ceil(np.ptp(side) / step)) + 1 for side in (along, across))
    first = along.min() - grid.shift[0] * step, across.min() - grid.shift[1] * step
    middle = first[0] + 0.5 * width * step, first[1] + 0.5 * height * step
    axes, focus = camera.axes, camera.focus_distance_mm
    to_right, down = c * axes[0] + s * axes[1], c * axes[1] - s * axes[0]
    place = np.asarray(camera.position_mm) + 0.5 * camera.pupil_mm * (grid.pupil[0] * axes[0] + grid.pupil[1] * axes[1])
    centre = np.asarray(camera.position_mm) + focus * (axes[2] + middle[0] * to_right + middle[1] * down)
    lens = block(
        "camera",
        f"perspective location {vector(place)} direction {vector(centre - place)}",
        f"right {vector(width * step * focus * to_right)} up {vector(-height * step * focus * down)}",
    )
    text = HEADER.format(levels=2 + ARRAY_FACES) + '#include "model.inc"\n' + lens + "\n"
    (folder / "view.pov").write_text(text)
    (folder / "view.ini").write_text(INI.format(name="view", width=width, height=height))
    run_povray(folder / "view.ini")
    along, across = first[0] + (np.arange(width) + 0.5) * step, first[1] + (np.arange(height) + 0.5) * step
    a, b = (axis.ravel() for axis in np.meshgrid(along, across))
    u, v = camera.pixel(c * a - s * b, s * a + c * b)
    return read_picture(folder / "view.png").reshape(-1, 3), u, v


def numbered(panel: Panel) -> Words:
    """Return a 16-bit picture: red encodes the panel's columns, green its rows; blue is the maximum."""
    picture = np.full((panel.height_px, panel.width_px, 3), TOP, np.uint16)
    picture[..., 0] = _steps(panel.width_px) * np.arange(1, panel.width_px + 1)
    picture[..., 1] = (_steps(panel.height_px) * np.arange(1, panel.height_px + 1))[:, None]
    return picture


def numbers(values: Words, panel: Panel) -> tuple[Floats, Any]:
    """Decode values (N, 3) of `numbered`; return the centres of the panel's pixels (N, 2), and which values are lit."""
    steps = np.array([_steps(panel.width_px), _steps(panel.height_px)])
    # `numbered` encodes the first pixel as one step.
    return np.rint(values[:, :2] / steps) - 0.5, values[:, 2] > TOP // 2


def _steps(count: int) -> int:
    """Return the difference between the values of neighbouring pixels; it exceeds any rounding error."""
    return TOP // (count + 1)


def write_picture(path: Path, values: Words) -> None:
    """Write 16-bit values (height, width, 3) as a PNG file that names no colour space."""
    cv2.imwrite(str(path), values[..., ::-1])


def read_picture(path: Path) -> Words:
    """Return the 16-bit values (height, width, 3) of a PNG file."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return np.asarray(picture[..., 2::-1], np.uint16)


def _spread(samples: int, rng: np.random.Generator) -> Iterator[Rays]:
    """Yield `samples` x `samples` grids of rays, each with its own part of the pixel and its own rotation.

    The grids' points in the pupil form a spiral (H. Vogel, 1979), centred so that they do not displace the camera.
    """
    count = samples * samples
    row, column = np.divmod(np.arange(count), samples)
    shift = np.stack([column + rng.random(count), row + rng.random(count)], axis=1) / samples
    order, turn = rng.permutation(count), rng.uniform(-TURN, TURN, count)
    disc = np.sqrt((order + 0.5) / count) * np.exp(1j * (GOLDEN_ANGLE * order + 2.0 * np.pi * rng.random()))
    disc -= disc.mean()
    for k in range(count):
        yield Rays((float(shift[k, 0]), float(shift[k, 1])), float(turn[k]), (float(disc[k].real), float(disc[k].imag)))
