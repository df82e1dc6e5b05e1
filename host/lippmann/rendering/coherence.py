"""Whether Embree is told that rays which are traced side by side go the same way.

Without AVX-512 never, with AVX-512 until a mirror has turned them. Told so, Embree takes a packet of rays through its
tree together, else nearly each by itself. Neighbouring pixels of a lenslet look 50 times further apart than those of a
camera, and a mirror sends rays anywhere. Measured with the fish, where the hint is
- given to packets of 8 (AVX2): a fifth more time through lenslets of 24 pixels, twice the time through those of 6;
- given to mirrored rays in packets of 16 (on AVX2): 1.8 times their time;
- not given with AVX-512: 15 % more time.

Pictures differ only where a ray meets two surfaces at one place.
"""

from typing import Any

from lippmann.base.machine import has_avx512


def coherence_hint(depth: Any) -> Any:
    """Return Embree's hint for rays that have met `depth` surfaces (UInt32): Dr.Jit's Bool, or False for all."""
    return depth == 0 if has_avx512() else False
