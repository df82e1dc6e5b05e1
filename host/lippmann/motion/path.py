"""A path: the motion of a part of a scene at each frame, interpolated between keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from msgspec import Meta

from lippmann.base.toml import documented, key
from lippmann.scenes.placement import ORIGIN, Placement, Scale, Triple

#: Interpolation of a path between keys.
Motion = Literal["smooth", "linear"]


def interpolated(
    frames: npt.NDArray[np.float64], numbers: npt.NDArray[np.float64], motion: Motion | None, frame: float
) -> npt.NDArray[np.float64]:
    """Return the numbers (N,) at a frame, from those (K, N) at the frames (K,) of keys; beyond them nothing moves."""
    from scipy.interpolate import PchipInterpolator

    place = np.clip(frame, frames[0], frames[-1])
    if motion != "linear" and len(frames) > 1:
        now: npt.NDArray[np.float64] = PchipInterpolator(frames, numbers)(place)
        return now
    return np.array([np.interp(place, frames, column) for column in numbers.T])


@documented
@dataclass(frozen=True)
class Key:
    """The motion at one frame: scaling, rotation and shift."""

    frame: Annotated[int, key("frame number; greater than that of the key before", low=0)]
    offset_mm: Annotated[Triple, key("shift from the position at rest")] = ORIGIN
    rotation_deg: Annotated[Triple, key("rotation about x, then y, then z; 360 is a turn")] = ORIGIN
    scale: Annotated[Scale, key("factor of the size")] = 1.0


@documented
@dataclass(frozen=True)
class Path:
    """Keys, and the interpolation between them.

    Before the first key and after the last, nothing moves. `motion` is "linear": evenly; or "smooth": by cubics
    that never go beyond a key (F. Fritsch, J. Butland, "A method for constructing local monotone piecewise cubic
    interpolants", 1984), each component separately. None means the film's `motion` in a film file, elsewhere "smooth".
    """

    keys: Annotated[tuple[Key, ...], key("positions at some frames; at least one"), Meta(min_length=1)]
    pivot_mm: Annotated[Triple, key("centre of rotation and scaling, before the motion")] = ORIGIN
    motion: Annotated[Motion | None, key("interpolation between keys", default="the film's")] = None

    def at(self, frame: int) -> Placement:
        """Return the motion at a frame, relative to the position at rest, in the display's coordinates."""
        frames = np.array([key.frame for key in self.keys], np.float64)
        numbers = np.array([(*key.offset_mm, *key.rotation_deg, key.scale) for key in self.keys])
        now = interpolated(frames, numbers, self.motion, frame)
        turned = Placement(float(now[6]), (float(now[3]), float(now[4]), float(now[5])))
        pivot = np.array(self.pivot_mm)
        offset = now[:3] + pivot - turned.display_from_scene[:3, :3] @ pivot
        return Placement(turned.scale, turned.rotation_deg, (float(offset[0]), float(offset[1]), float(offset[2])))
