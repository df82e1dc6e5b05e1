"""Draw pictures that test a calibration, and evaluate photographs of these pictures.

`1-white` looks white to an eye at a position X and black from elsewhere; `2-dark` is
its inverse. Where array and display file differ, an eye at X sees the inverse.

`3-rings` makes each lenslet white or black, depending on its distance from the panel's
middle. An eye that sees no crosstalk sees rings, with gaps where the display file
assigns pixels to a wrong lenslet.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from lippmann.calibration.photographs import SUFFIXES, Light, read_photograph
from lippmann.display.description import Display, Point3
from lippmann.errors import InputError, input_error
from lippmann.eye.observer import Eye
from lippmann.eye.test_patterns import Pixels, draw
from lippmann.optics.lattice import Lattice
from lippmann.rendering.integral_image import IntegralImage

NAMES = ("1-white", "2-dark", "3-rings")
#: Diameter of the pupil that sees `1-white` as white, in spacings of adjacent views.
VIEWS = 4.0
#: Maximum fraction of a correct block's light that comes from `2-dark`, and minimum
#: fraction of correct blocks.
MAX_DARK, MIN_RIGHT = 0.3, 0.95


def rings(display: Display) -> Light:
    """Draw white and black rings as linear light (height, width, 3)."""
    panel, lattice = display.panel, Lattice.of(display.array)
    light = np.zeros(panel.shape, np.float32)
    columns = np.arange(panel.width_px)[None]
    for row in range(panel.height_px):
        places = Pixels(display, columns, np.array([[row]]), (0, 0), None).places
        x, y = lattice.centre(places.i, places.j)
        # Rings are 3 lenslets wide. No lenslet's centre lies on a ring's edge, because
        # no centre is 2.5, 5.5, ... pitches from the middle.
        ring = np.floor((np.hypot(x, y) / display.array.coarsest_mm + 0.5) / 3.0) % 2
        light[row] = ((ring == 0) & places.present)[0, :, None]
    return light


def pictures(display: Display, eye_mm: Point3) -> dict[str, IntegralImage]:
    """Draw the three test pictures, keyed by file name without extension."""
    # The pupil spans several views, so the eye's position need not be exact.
    step = display.panel.coarsest_mm * eye_mm[2] / display.aperture_distance_mm
    white = draw(display, "white-for-eye", Eye(eye_mm, pupil_mm=VIEWS * step))
    dark = IntegralImage(1.0 - white.radiance, display, white.metadata)
    concentric = IntegralImage(rings(display), display, {"pattern": "rings"})
    return dict(zip(NAMES, (white, dark, concentric), strict=True))


@dataclass(frozen=True)
class Verdict:
    """Result for the photographs of white and dark; `right` is true if enough blocks are correct.

    A block's dark share is the light of `2-dark` divided by that of both pictures;
    `dark_share` is the median over blocks, `worst_dark_share` the 95th percentile.
    """

    right: bool
    right_share: float
    dark_share: float
    worst_dark_share: float


def judge_folder(folder: Path) -> Verdict:
    """Evaluate a folder's photographs of 1-white and 2-dark, taken from the eye's position."""
    if not folder.is_dir():
        raise input_error(folder, "the folder does not exist", "give the photographs' folder")
    paths = []
    for name in NAMES[:2]:
        files = [one for suffix in SUFFIXES if (one := folder / f"{name}{suffix}").is_file()]
        if not files:
            remedy = f"show {name}.png, photograph the panel from the eye's position, and save {name}.jpg there"
            raise input_error(folder, f"the photograph of {name} is missing", remedy)
        paths.append(files[0])
    white = read_photograph(paths[0]).light
    return judge(white, read_photograph(paths[1], white.shape).light)


def judge(white: Light, dark: Light) -> Verdict:
    """Compare the photographs of white and dark (light, height x width), block by block."""
    side = max(2, round(1 / 48 * max(white.shape)))  # side of a compared block, pixels
    height, width = (side * (length // side) for length in white.shape)
    shape = height // side, side, width // side, side
    means = [one[:height, :width].reshape(shape).mean(axis=(1, 3)) for one in (white, dark)]
    both = means[0] + means[1]
    panel = both > 0.2 * float(np.percentile(both, 95.0))  # darker blocks are outside the panel
    if float(both.max()) < 1e-3:
        raise InputError("photographs 1-white and 2-dark are both black; expose both longer, and equally")
    inside = ndimage.binary_erosion(panel)  # blocks on the panel's edge show the mount too
    if inside.sum() < 9:
        raise InputError("the photographs show too little of the panel; zoom in, or draw for a nearer eye")
    share = means[1][inside] / both[inside]
    right_share = float((share < MAX_DARK).mean())
    return Verdict(right_share >= MIN_RIGHT, right_share, float(np.median(share)), float(np.percentile(share, 95.0)))
