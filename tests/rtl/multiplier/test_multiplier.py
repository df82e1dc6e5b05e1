"""multiplier against its twin, and against the whole product: what is cut is less than two last places."""

from bench import Segment
from lippmann.fixed.words import multiplier as twin
from parts import MULTIPLIERS, multiplier, stream_parts
from words import mixed, signed


def test_equals_twin_for_all_parameters(seed, rng, seen):
    batch = []
    for wa, wb, drop, square in MULTIPLIERS:
        a, b = mixed(rng, 600, signed(wa), signed(wb))
        b = a if square else b
        p = twin(a, b, wa, wb, drop)
        la, lb = max(wa - 18, 0), max(wb - 18, 0)
        missing = a.astype(object) * b - (p.astype(object) << drop)
        assert (missing >= 0).all()
        assert (missing < (2 << drop) + (1 << (la + lb))).all(), (wa, wb, drop)
        if not (la or lb):
            assert (missing < 1 << drop).all()
        # The most negative square does not fit a word of its size: it never comes up in the pipeline's squares.
        fits = (p >= signed(wa + wb - drop)[0]) & (p <= signed(wa + wb - drop)[1])
        assert fits.sum() > 600
        a, b, p = a[fits], b[fits], p[fits]
        for cells in (0, 1):
            one = multiplier(wa, wb, drop, square, cells)
            batch.append((one, Segment({}, {"a_i": a, "b_i": b}, {"p_o": p})))
        seen.point("two most negative", (a == signed(wa)[0]) & (b == signed(wb)[0]))
        seen.point("-1 by -1", (a == -1) & (b == -1))
    stream_parts(batch, seed)
