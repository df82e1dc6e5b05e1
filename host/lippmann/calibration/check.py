"""Draw pictures that show whether a calibration is correct, and judge their photographs.

`1-white` looks white to an eye at X and black from other positions; `2-dark` is its
inverse. Where the array differs from its description, a camera at X sees the inverse.

`3-rings` gives each lenslet one colour, chosen by its distance from the panel's middle.
An eye at a position without crosstalk sees rings; a ring is broken where a pixel is
assigned to the wrong lenslet.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from lippmann.calibration.photographs import SUFFIXES, Light, read_photograph
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.eye.observer import Eye
from lippmann.eye.test_patterns import Pixels, draw
from lippmann.optics.lattice import Lattice
from lippmann.rendering.integral_image import IntegralImage

NAMES = ("1-white", "2-dark", "3-rings")
#: Diameter of the pupil that sees white, in distances between adjacent views.
VIEWS = 4.0
#: Maximum fraction of the light of `2-dark` in a correct block, and minimum fraction of
#: correct blocks.
MAX_DARK, MIN_RIGHT = 0.3, 0.95


def rings(display: Display) -> Light:
    """Return the picture of rings (height, width, 3), white and black."""
    panel, lattice = display.panel, Lattice.of(display.array)
    light = np.zeros((panel.height_px, panel.width_px, 3), np.float32)
    columns = np.arange(panel.width_px)[None]
    for row in range(panel.height_px):
        places = Pixels(display, columns, np.array([[row]]), (0, 0), None).places
        x, y = lattice.centre(places.i, places.j)
        # Rings are 3 lenslets wide. No lenslet's centre lies on a ring's edge, because
        # lattices have no distances 2.5, 5.5, ...
        ring = np.floor((np.hypot(x, y) / display.array.coarsest_mm + 0.5) / 3.0) % 2
        light[row] = ((ring == 0) & places.present)[0, :, None]
    return light


def pictures(display: Display, eye_mm: tuple[float, float, float]) -> dict[str, IntegralImage]:
    """Return the pictures, keyed by file name without extension."""
    # The pupil spans several views, so the eye's position need not be exact.
    step = display.panel.coarsest_mm * eye_mm[2] / display.aperture_distance_mm
    white = draw(display, "white-for-eye", Eye(eye_mm, pupil_mm=VIEWS * step))
    dark = IntegralImage(1.0 - white.radiance, display, white.metadata)
    concentric = IntegralImage(rings(display), display, {"pattern": "rings"})
    return dict(zip(NAMES, (white, dark, concentric), strict=True))


@dataclass(frozen=True)
class Verdict:
    """Verdict on the photographs of white and dark; `right`: enough blocks are correct.

    `dark_share` and `worst_dark_share` are the median and the 95th percentile over
    blocks: light of `2-dark` as a fraction of the light of both pictures.
    """

    right: bool
    right_share: float
    dark_share: float
    worst_dark_share: float


def judge_folder(folder: Path) -> Verdict:
    """Judge a folder's photographs 1-white and 2-dark, taken from the eye's position."""
    if not folder.is_dir():
        raise input_error(folder, "there is no such folder", "name the folder of the photographs")
    paths = []
    for name in NAMES[:2]:
        files = [one for suffix in SUFFIXES if (one := folder / f"{name}{suffix}").is_file()]
        if not files:
            remedy = f"photograph {name}.png from the eye's position, and save it there as {name}.jpg"
            raise input_error(folder, f"the photograph of {name} is missing", remedy)
        paths.append(files[0])
    white = read_photograph(paths[0]).light
    return judge(white, read_photograph(paths[1], white.shape).light)


def judge(white: Light, dark: Light) -> Verdict:
    """Judge the light (height, width) of the photographs of white and dark."""
    side = max(2, round(1 / 48 * max(white.shape)))  # side of a block, pixels
    height, width = (side * (length // side) for length in white.shape)
    shape = height // side, side, width // side, side
    means = [one[:height, :width].reshape(shape).mean(axis=(1, 3)) for one in (white, dark)]
    both = means[0] + means[1]
    panel = both > 0.2 * float(np.percentile(both, 95.0))  # darker blocks are outside the panel
    if float(both.max()) < 1e-3:
        raise InputError("the photographs of white and dark are both black; expose both longer, with equal exposure")
    inside = ndimage.binary_erosion(panel)  # blocks on the panel's edge show the mount too
    if inside.sum() < 9:
        raise InputError("the photographs show too little of the panel; come nearer")
    share = means[1][inside] / both[inside]
    right_share = float((share < MAX_DARK).mean())
    return Verdict(right_share >= MIN_RIGHT, right_share, float(np.median(share)), float(np.percentile(share, 95.0)))
