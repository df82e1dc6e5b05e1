"""wide_product against the twin of `multiplier`, whose words it gives."""

from bench import Segment
from lippmann.fixed.words import multiplier as twin
from parts import MULTIPLIERS, stream_parts, wide_product
from words import mixed, signed


def test_equals_twin_for_all_parameters(seed, rng, seen):
    batch = []
    for wa, wb, drop, square in MULTIPLIERS:
        a, b = mixed(rng, 600, signed(wa), signed(wb))
        b = a if square else b
        p = twin(a, b, wa, wb, drop)
        # The most negative square does not fit a word of its size: it never comes up in the pipeline's squares.
        low, high = signed(wa + wb - drop)
        fits = (p >= low) & (p <= high)
        assert fits.sum() > 600
        a, b, p = a[fits], b[fits], p[fits]
        one = wide_product(wa, wb, drop, square)
        batch.append((one, Segment({}, {"a_i": a, "b_i": b}, {"p_o": p})))
        seen.point("square" if square else "product", len(a))
        seen.point("most negative by most positive", (a == signed(wa)[0]) & (b == signed(wb)[1]))
        seen.point("-1 by -1", (a == -1) & (b == -1))
    stream_parts(batch, seed)
