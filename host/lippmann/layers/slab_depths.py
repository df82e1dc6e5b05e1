"""Chooses the depths of layers from the depths that eyes see in a scene.

A layer shows all of its slab at one depth. For an eye that moves, a point then is off by the difference of two
disparities, u = z / (E - z) at the distance E of the eyes: so many mm does a point at depth z move across the display,
against the eye, for each mm of the eye. To first order the error of the view is this shift times the picture's
gradient. The slabs are those with the least mean square of it over all points that are seen; they are found exactly, by
dynamic programming over a histogram.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lippmann.errors import InputError
from lippmann.layers.stack import Floats

#: Bins of the histogram of disparities.
BINS = 512
#: What a point without any detail counts, in mean details.
PLAIN = 0.05
#: Least width of a bin: 0.001 mm for an eye that moves 100 mm. Rounding does not make two depths of one.
FINEST = 1e-5
#: Disparity at infinity.
SKY = -1.0


@dataclass(frozen=True)
class Slab:
    """The part of a scene that a layer shows: z from `front_mm` back to `back_mm`, at the depth `depth_mm`."""

    front_mm: float
    back_mm: float
    depth_mm: float


def disparity(z_mm: npt.ArrayLike, eye_mm: float) -> Floats:
    """Return the disparity of depths before an eye at a distance; -1 at z = -infinity."""
    z = np.asarray(z_mm, np.float64)
    far = np.isneginf(z)
    return np.where(far, SKY, np.where(far, 0.0, z) / (eye_mm - np.where(far, 0.0, z)))


def depth_of(u: float, eye_mm: float) -> float:
    """Return the depth of a disparity; the inverse of `disparity`."""
    return -math.inf if u <= SKY else eye_mm * u / (1.0 + u)


def slabs_of(z_mm: Floats, detail: Floats, count: int, eye_mm: float, front_mm: float) -> list[Slab]:
    """Return at most `count` slabs, from front to back, for the depths (N,) that eyes at a distance see.

    `detail` (N,) is the squared gradient of the picture there. Points without any count a little, too.

    Depths of -infinity, of a scene's surroundings, get a slab of their own or share the last one. `front_mm` is the
    front of the first slab; the last one has no back. There are fewer slabs than asked for where the depths have fewer
    values.

    Raises InputError when no eye sees anything.
    """
    if not z_mm.size:
        raise InputError("no eye sees any of the scene's surfaces; place it with --fit")
    u = disparity(z_mm, eye_mm)
    near = u[u > SKY]
    low, high = (float(near.min()), float(near.max())) if near.size else (0.0, 0.0)
    step = max((high - low) / (BINS - 1), FINEST)
    # Bin 0 is the sky; each other bin is known by the mean of its disparities.
    place = np.where(u > SKY, 1 + np.rint((u - low) / step).astype(np.int64), 0)
    mean_detail = float(detail.mean())
    share = detail + (PLAIN * mean_detail if mean_detail > 0.0 else 1.0)
    weight, total = (np.bincount(place, values, BINS + 1) for values in (share, share * u))
    used = np.flatnonzero(weight)[::-1]  # from front to back
    mean = total[used] / weight[used]
    ends = partition(mean, np.asarray(weight[used], np.float64), min(count, len(used)))
    slabs, front = [], front_mm
    for first, end in zip([0, *ends[:-1]], ends, strict=True):
        back = -math.inf if end == len(used) else depth_of(0.5 * (mean[end - 1] + mean[end]), eye_mm)
        depth = depth_of(float(np.average(mean[first:end], weights=weight[used][first:end])), eye_mm)
        slabs.append(Slab(front, back, depth))
        front = back
    return slabs


def partition(values: Floats, weights: Floats, count: int) -> list[int]:
    """Return the ends of `count` runs of ordered values with the least sum of weighted squares about their means."""
    n = len(values)
    sums = [np.concatenate([[0.0], np.cumsum(weights * values**power)]) for power in range(3)]

    def spread(end: int) -> Floats:
        """Return the sum of squares of the runs from each start before an end."""
        w, m, q = (one[end] - one[:end] for one in sums)
        return np.asarray(np.maximum(q - m * m / w, 0.0))

    runs = [spread(end) for end in range(1, n + 1)]
    best = np.array([run[0] for run in runs])
    starts = []
    for _ in range(count - 1):
        start, cost = np.zeros(n, np.int64), np.full(n, np.inf)
        for end in range(2, n + 1):
            through = best[: end - 1] + runs[end - 1][1:]
            start[end - 1] = 1 + int(np.argmin(through))
            cost[end - 1] = through[start[end - 1] - 1]
        starts.append(start)
        best = cost
    ends = [n]
    for start in reversed(starts):
        ends.append(int(start[ends[-1] - 1]))
    return ends[::-1]
