"""row_multiplier against the twin of `multiplier`, whose words it gives."""

from bench import Segment
from lippmann.fixed.words import multiplier as twin
from parts import ROW_MULTIPLIERS, row_multiplier, stream_parts
from words import mixed, signed


def words_of(a, b, wa, wb, drop):
    """The twin's product; where one word has no lower part, its cut may be above their places: then by definition."""
    la, lb = max(wa - 18, 0), max(wb - 18, 0)
    if drop >= la + lb:
        return twin(a, b, wa, wb, drop)
    assert min(la, lb) == 0
    low = a & ((1 << la) - 1) if la else b & ((1 << lb) - 1)
    upper = ((a - low) * b if la else a * (b - low)) >> drop
    return upper + ((low * (b if la else a)) >> drop)


def test_equals_twin_for_all_parameters(seed, rng, seen):
    batch = []
    for wa, wb, drop, square in ROW_MULTIPLIERS:
        a, b = mixed(rng, 600, signed(wa), signed(wb))
        b = a if square else b
        p = words_of(a, b, wa, wb, drop)
        low, high = signed(wa + wb - drop)
        fits = (p >= low) & (p <= high)
        assert fits.sum() > 600
        a, b, p = a[fits], b[fits], p[fits]
        one = row_multiplier(wa, wb, drop, square)
        batch.append((one, Segment({}, {"a_i": a, "b_i": b}, {"p_o": p})))
        seen.point("square" if square else "product", len(a))
        seen.point("cut above the lower part", drop < max(wa - 18, 0) + max(wb - 18, 0))
        seen.point("most negative by most positive", (a == signed(wa)[0]) & (b == signed(wb)[1]))
        seen.point("-1 by -1", (a == -1) & (b == -1))
    stream_parts(batch, seed)
