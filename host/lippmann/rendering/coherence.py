"""Whether rays that are traced side by side are said to go the same way.

Embree then takes a packet of them through its tree as one, else nearly each by itself. Neighbouring pixels of a
lenslet look 50 times further apart than those of a camera, and what a mirror sends on goes anywhere. In packets of 8
(AVX2) the fish's rays of 24 pixels a lenslet take a fifth less time each by itself, and those of 6 pixels half; in
packets of 16 (AVX-512) camera rays take longer. The hint changes no picture but where two surfaces meet.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any


def is_coherent(depth: Any) -> Any:
    """Return the hint for rays that met so many surfaces before (UInt32): Dr.Jit's Bool, or False for all."""
    return depth == 0 if has_wide_packets() else False


@functools.cache
def has_wide_packets() -> bool:
    """Tell whether Dr.Jit and Embree trace 16 rays at once, as they do with AVX-512."""
    information = Path("/proc/cpuinfo")
    return information.exists() and " avx512vl " in f"{information.read_text()} ".replace("\n", " ")
