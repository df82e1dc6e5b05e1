"""Whether Embree is told that rays which are traced side by side go the same way.

It then takes a packet of them through its tree as one, else nearly each by itself. Neighbouring pixels of a lenslet
look 50 times further apart than those of a camera, and a mirror sends rays anywhere. In packets of 8 (AVX2) the fish
through lenslets of 24 pixels takes a fifth less time without the hint, and through those of 6 pixels half; in packets
of 16 (AVX-512) rays through lenslets took 15 % longer without. Pictures differ only where a ray meets two surfaces at
one place.
"""

from lippmann.processor import has_avx512


def is_coherent() -> bool:
    """Return the hint for all rays but shadow rays."""
    return has_avx512()
