"""Pictures that prove a calibration by eye, and photographs of them judged by numbers.

`1-white` is white for an eye at X and black for eyes elsewhere; `2-dark` is its opposite. A camera at X sees the first
white and the second black all over the panel. Where the array is not as described, it sees the opposite.

`3-rings` gives each lenslet one colour, by its distance from the panel's middle: from any place without crosstalk, an
eye sees smooth concentric rings. They are broken where pixels have the wrong owner.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from lippmann.calibration.photographs import SUFFIXES, Light, read_photograph
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.eye.observer import Eye
from lippmann.eye.test_patterns import Pixels, draw
from lippmann.optics.lattice import Lattice
from lippmann.rendering.integral_image import IntegralImage

NAMES = ("1-white", "2-dark", "3-rings")
#: Width of a ring, in lenslets.
RING = 3.0
#: Diameter of the eye for which the picture is white, in steps from one view to the next.
VIEWS = 4.0
#: Light of a panel's pixel, as a share of the brightest part's, that belongs to the panel.
PANEL_SHARE = 0.2
#: Side of the blocks that are judged, as a share of the photograph's longer side.
BLOCK = 1 / 48
#: Most share of dark's light in a block that is right, and least share of the panel that must be right.
MOST_DARK, LEAST_RIGHT = 0.3, 0.95
Values = npt.NDArray[np.float32]


def rings(display: Display) -> Values:
    """Return the picture of rings, (height, width, 3): white and black by the distance of a pixel's lenslet."""
    panel, lattice = display.panel, Lattice.of(display.array)
    light = np.zeros((panel.height_px, panel.width_px, 3), np.float32)
    columns = np.arange(panel.width_px)[None]
    for row in range(panel.height_px):
        places = Pixels(display, columns, np.array([[row]]), (0, 0), None).places
        x, y = lattice.centre(places.i, places.j)
        # No lenslet's middle lies on the edge of a ring: 2.5, 5.5, ... are no distances of a lattice.
        ring = np.floor((np.hypot(x, y) / display.array.coarsest_mm + 0.5) / RING) % 2
        light[row] = ((ring == 0) & places.present)[0, :, None]
    return light


def pictures(display: Display, eye_mm: tuple[float, float, float]) -> dict[str, IntegralImage]:
    """Return the pictures by the names of their files."""
    # The pupil spans some views, so that the eye's place need not be exact.
    step = display.panel.coarsest_mm * eye_mm[2] / display.aperture_distance_mm
    white = draw(display, "white-for-eye", Eye(eye_mm, pupil_mm=VIEWS * step))
    dark = IntegralImage(1.0 - white.radiance, display, white.metadata)
    named = {"pattern": "rings"}
    return dict(zip(NAMES, (white, dark, IntegralImage(rings(display), display, named)), strict=True))


@dataclass(frozen=True)
class Verdict:
    """What photographs of white and dark say: whether they are right, and shares of the panel.

    `right_share` of the panel's blocks are white; `dark_share` is the light of dark in a block, as a share of both
    together: its median and its worst twentieth.
    """

    right: bool
    right_share: float
    dark_share: float
    worst_dark_share: float


def judge_folder(folder: Path) -> Verdict:
    """Judge the photographs 1-white and 2-dark of a folder, taken from the place of the eye."""
    if not folder.is_dir():
        raise input_error(str(folder), "there is no such folder", "name that of the photographs")
    found = []
    for name in NAMES[:2]:
        files = [one for suffix in SUFFIXES if (one := folder / f"{name}{suffix}").is_file()]
        if not files:
            remedy = f"photograph {name}.png from the eye's place, and put it there as {name}.jpg"
            raise input_error(str(folder), f"the photograph of {name} is missing", remedy)
        found.append(files[0])
    white = read_photograph(found[0])
    dark = read_photograph(found[1], white.light.shape)
    return judge(white.light, dark.light)


def judge(white: Light, dark: Light) -> Verdict:
    """Judge the light of two photographs."""
    side = max(2, round(BLOCK * max(white.shape)))
    height, width = (side * (length // side) for length in white.shape)
    shape = height // side, side, width // side, side
    means = [one[:height, :width].reshape(shape).mean(axis=(1, 3)) for one in (white, dark)]
    both = means[0] + means[1]
    panel = both > PANEL_SHARE * float(np.percentile(both, 95.0))
    if float(both.max()) < 1e-3:
        raise InputError("the photographs of white and dark are both black; expose longer, both alike")
    # Blocks on the panel's edge see the mount too.
    inside = ndimage.binary_erosion(panel)
    if inside.sum() < 9:
        raise InputError("the photographs show too little of the panel; come nearer")
    share = means[1][inside] / both[inside]
    right_share = float((share < MOST_DARK).mean())
    return Verdict(right_share >= LEAST_RIGHT, right_share, float(np.median(share)), float(np.percentile(share, 95.0)))
