"""Whether Embree is told that rays which are traced side by side go the same way.

It then takes a packet of them through its tree as one, else nearly each by itself. Neighbouring pixels of a lenslet
look 50 times further apart than those of a camera, and a mirror sends rays anywhere. In packets of 8 (AVX2) the fish
through lenslets of 24 pixels takes a fifth less time without the hint, and through those of 6 pixels half. In packets
of 16, as AVX-512 has them, mirrored rays take 1.8 times as long with it; but with AVX-512 the rays that come through
the lenslets took 15 % longer without. Pictures differ only where a ray meets two surfaces at one place.
"""

from typing import Any

from lippmann.processor import has_avx512


def is_coherent(depth: Any) -> Any:
    """Return the hint for rays that have met so many surfaces (UInt32): Dr.Jit's Bool, or False for all."""
    return depth == 0 if has_avx512() else False
