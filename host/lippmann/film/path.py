"""A path: where something stands at each frame, between keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from lippmann.errors import input_error
from lippmann.rendering.placement import SCALE_RANGE, Placement
from lippmann.toml import Table

#: How a path runs from key to key.
Motion = Literal["smooth", "linear"]
MOTIONS: tuple[Motion, ...] = get_args(Motion)

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Key:
    """Where something stands at a frame: scaled, turned about x, y, then z, and moved."""

    frame: int
    offset_mm: Triple = (0.0, 0.0, 0.0)
    rotation_deg: Triple = (0.0, 0.0, 0.0)
    scale: float = 1.0


@dataclass(frozen=True)
class Path:
    """Keys, and how to go from one to the next.

    Attributes
    ----------
    keys
        At least one, in the order of their frames. Before the first and after the last, things stand still.
    pivot_mm
        The point, in the display's frame, that turns and scales leave where it is.
    motion
        "linear": evenly; "smooth": by cubics that never go beyond a key (F. Fritsch, J. Butland, "A method for
        constructing local monotone piecewise cubic interpolants", 1984), each number for itself.
    """

    keys: tuple[Key, ...]
    pivot_mm: Triple = (0.0, 0.0, 0.0)
    motion: Motion = "smooth"

    def at(self, frame: int) -> Placement:
        """Return the motion of a frame, from where things stand at rest, in the display's frame."""
        from scipy.interpolate import PchipInterpolator

        frames = np.array([key.frame for key in self.keys], np.float64)
        numbers = np.array([(*key.offset_mm, *key.rotation_deg, key.scale) for key in self.keys])
        place = np.clip(frame, frames[0], frames[-1])
        if self.motion == "smooth" and len(frames) > 1:
            now = PchipInterpolator(frames, numbers)(place)
        else:
            now = np.array([np.interp(place, frames, column) for column in numbers.T])
        turned = Placement(float(now[6]), (float(now[3]), float(now[4]), float(now[5])))
        pivot = np.array(self.pivot_mm)
        offset = now[:3] + pivot - turned.display_from_scene[:3, :3] @ pivot
        return Placement(turned.scale, turned.rotation_deg, (float(offset[0]), float(offset[1]), float(offset[2])))


def read_path(table: Table, frames: int, motion: Motion) -> Path:
    """Read `keys`, `pivot_mm` and `motion` of a table; `motion` is the film's.

    Raises
    ------
    InputError
        Naming file, key and remedy.
    """
    pivot = table.triple("pivot_mm", (0.0, 0.0, 0.0))
    own: Motion = "linear" if table.choice("motion", MOTIONS, motion) == "linear" else "smooth"
    keys: list[Key] = []
    for one in table.tables("keys"):
        frame = one.integer("frame", 0, frames - 1)
        if keys and frame <= keys[-1].frame:
            raise input_error(one.where("frame"), f"{frame} does not come after {keys[-1].frame}", "put keys in order")
        keys.append(
            Key(
                frame,
                one.triple("offset_mm", (0.0, 0.0, 0.0)),
                one.triple("rotation_deg", (0.0, 0.0, 0.0)),
                one.number("scale", 1.0, at_least=SCALE_RANGE[0], at_most=SCALE_RANGE[1]),
            )
        )
        one.refuse_leftovers()
    if not keys:
        raise input_error(table.where("keys"), "there is none", "add one, such as { frame = 0, offset_mm = [0, 0, 0] }")
    return Path(tuple(keys), pivot, own)
