"""saturate against its twin: both ends, the last words that fit, the first that do not."""

import numpy as np
from bench import Segment
from lippmann.fixed.words import beyond
from lippmann.fixed.words import saturate as twin
from parts import SATURATES, saturate, stream_parts
from words import around, mixed, signed


def test_equals_twin_for_all_parameters(seed, rng, seen):
    batch = []
    for width, to, slack in SATURATES:
        low, high = signed(to)
        (d,) = mixed(rng, 300, signed(width))
        edges = [low - (1 << slack), high + (1 << slack)]
        d = np.concatenate([d, around(edges, 2, *signed(width))])
        over = beyond(d, to, 1 << slack)
        q = twin(d, to)
        batch.append(
            (saturate(width, to, slack), Segment({}, {"d_i": d}, {"q_o": q, "beyond_o": over.astype(np.int64)}))
        )
        seen.point("held above", d > high)
        seen.point("held below", d < low)
        seen.point("last that fits above", d == high)
        seen.point("last that fits below", d == low)
        seen.point("first that does not above", d == high + 1)
        seen.point("first that does not below", d == low - 1)
        seen.point("last held without a flag above", d == edges[1])
        seen.point("first held with a flag above", over & (d == edges[1] + 1))
        seen.point("last held without a flag below", d == edges[0])
        seen.point("first held with a flag below", over & (d == edges[0] - 1))
        seen.point("no narrower", width == to)
    stream_parts(batch, seed)
