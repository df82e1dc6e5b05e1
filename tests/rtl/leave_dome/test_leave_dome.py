"""leave_dome against its twin: up to, at and beyond total internal reflection, and words without any sense."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.lenslet_faces import Meeting, leave_dome
from lippmann.fixed.words import extra_bits
from steps import FRACTIONS, stream_step
from words import around, mixed, signed, word

#: The cosine in the glass goes through its own words: 1 - cos^2 = s need not hold for what a port is given.
PORTS = ("nx", "ny", "nz", "cos", "ex", "ey", "dz", "s")


def rays(rng, count, n):
    """Unit normals, cosine and squared sine to them in the glass, around the limit of total reflection too."""
    limit = 1 / n**2
    s = np.where(rng.random(count) < 0.3, limit * (1 + rng.normal(0, 1e-3, count)), limit * rng.random(count))
    s = np.clip(s, 0, 1)
    cos = np.sqrt(1 - s)
    normal = rng.normal(size=(3, count))
    normal[2] = np.abs(normal[2]) + 0.3
    normal /= np.linalg.norm(normal, axis=0)
    tangent = np.cross(normal.T, rng.normal(size=(count, 3))).T
    tangent /= np.linalg.norm(tangent, axis=0)
    d = cos * normal + np.sqrt(s) * tangent
    return normal, cos, s, d


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    near, far = signed(f + 2), signed(f + 4)
    one, more = 1 << (f + 3), extra_bits(f)
    into = [*[near] * 4, *[signed(f + 2 + more)] * 2, signed(f + 2 + 3 * more)]
    segments = []
    for n in (1.16, 1.5, 2.2, *rng.uniform(1.16, 2.2, 3)):
        index, square = int(word(n, f)), int(word(n * n, f))
        normal, cos, s, d = rays(rng, 600, n)
        # Words around C' = 0, the ray straight through, and everything else.
        edge = around([one / n**2, 0, one - 1], 12, 0, one - 1)
        words = [*word(normal, f + 1), word(cos, f + 1), *word(n * d[:2], f + 1 + more), word(d[2], f + 1 + 3 * more)]
        words += [word(s, f + 3)]
        limits = [*into, (0, one - 1)]
        wild = mixed(rng, 300, *limits)
        words = [np.concatenate([np.clip(w, *r), v]) for w, r, v in zip(words, limits, wild, strict=True)]
        words[7][300 : 300 + len(edge)] = edge
        segments.append((index, square, words))
    for index, square in zip(*(w[:9].tolist() for w in mixed(rng, 0, (1, signed(f + 3)[1]), (1, far[1]))), strict=True):
        segments.append((index, square, mixed(rng, 30, *into, far)))
    streams = []
    for index, square, words in segments:
        given = dict(zip(PORTS, words, strict=True))
        met = Meeting(*(given[k] for k in ("nx", "ny", "nz", "cos", "s")), *np.zeros((2, len(words[0])), bool))
        dx, dy, dz, reflected, beyond = leave_dome(met, given["ex"], given["ey"], given["dz"], index, square, f)
        expected = {"dx_o": dx, "dy_o": dy, "dz_o": dz, "reflected_o": reflected, "beyond_o": beyond}
        inputs = {f"{k}_i": w for k, w in given.items()}
        streams.append(Segment({"index_i": index, "index_square_i": square}, inputs, expected))
        c = one - (given["s"].astype(object) * square >> f)
        assert (beyond & reflected).sum() == 0
        assert beyond[c > one + 1024].all()
        seen.point("beyond", beyond)
        seen.point("neither beyond nor reflected", ~beyond & ~reflected)
        seen.point("cosine behind above 1", c > one + 1024)
        seen.point("totally reflected", reflected)
        seen.point("last before total reflection", (c > 0) & (c <= 8) & ~reflected)
        seen.point("first beyond it", (c <= 0) & (c > -8) & reflected)
        seen.point("straight through", given["s"] == 0)
        seen.point("downward", dz < 0)
        for name, out in (("dx", dx), ("dy", dy), ("dz", dz)):
            seen.point(f"{name} saturated above", out == near[1])
            seen.point(f"{name} saturated below", out == near[0])
    stream_step("leave_dome", f, streams, seed)
