"""The Pareto front: what nothing else beats in every respect."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def pareto_front(costs: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Tell which of some designs no other one dominates.

    One dominates another when it costs no more in any respect, and less in one. Designs that cost the same do not
    dominate each other.

    Parameters
    ----------
    costs
        (N, respects), less is better; what should be large goes in with its sign turned.
    """
    cost = np.asarray(costs, np.float64)
    no_more = (cost[:, None] <= cost[None]).all(axis=2)
    less = (cost[:, None] < cost[None]).any(axis=2)
    return np.asarray(~(no_more & less).any(axis=0))
