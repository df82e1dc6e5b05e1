"""meet_dome against its twin: rays that hit, graze and miss the sphere, up and down, and words without any sense."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.lenslet_faces import meet_dome
from lippmann.fixed.words import extra_bits
from steps import FRACTIONS, stream_step
from words import mixed, signed, word


def rays(rng, count, depth, upward):
    """Points in radii and unit directions: through the dome, grazing the sphere, and past it."""
    cos = 1 - rng.random(count) * (0.5 if upward else 0.99)
    cos[:5] = 1
    turn = rng.random(count) * 2 * np.pi
    lateral = np.sqrt(1 - cos**2)
    d = np.stack([lateral * np.cos(turn), lateral * np.sin(turn), cos])
    # The foot of the perpendicular from the sphere's centre lies this far out; 1 grazes.
    foot = np.where(rng.random(count) < 0.3, 1 + rng.normal(0, 1e-4, count), rng.random(count) * 1.2)
    foot[:10] = 0
    along = d * np.array([1, 1, 1 if upward else -1])[:, None]
    across = np.cross(along.T, rng.normal(size=(count, 3))).T
    across /= np.linalg.norm(across, axis=0)
    height = depth if upward else 1.0
    start = across * foot + along * (height - (across * foot)[2]) / along[2]
    return start[0], start[1], d


@pytest.mark.parametrize("upward", [1, 0])
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, upward, seed, rng, seen):
    segments = []
    near, point, far = signed(f + 2), signed(f + 3), signed(f + 4)
    more = extra_bits(f)
    lateral, axial = signed(f + 2 + more), signed(f + 2 + 3 * more)
    for depth in (0.9, 0.5, 0.0, -1.0, -3.0, -4.9, *rng.uniform(-4, 0.9, 3)):
        zc = int(word(depth, f))
        x, y, d = rays(rng, 700, zc / (1 << f), upward)
        rest = int(word(1 - (zc / (1 << f)) ** 2, f + 3))
        hx, hy, wild = word(x, f), word(y, f), mixed(rng, 200, point, point, lateral, lateral, axial)
        dx, dy = np.minimum(word(d[:2], f + 1 + more), lateral[1])
        dz = np.minimum(word(d[2], f + 1 + 3 * more), axial[1])
        fits = (hx >= point[0]) & (hx <= point[1]) & (hy >= point[0]) & (hy <= point[1])
        assert fits.sum() > 100
        hx, hy, dx, dy, dz = (np.concatenate([w[fits], v]) for w, v in zip((hx, hy, dx, dy, dz), wild, strict=True))
        segments.append((zc, rest, (hx, hy, dx, dy, dz)))
    for zc, rest in zip(*(w[:25].tolist() for w in mixed(rng, 0, far, signed(f + 9))), strict=True):
        segments.append((zc, rest, mixed(rng, 50, point, point, lateral, lateral, axial)))
    streams = []
    for zc, rest, words in segments:
        met = meet_dome(*words, zc, rest, f, bool(upward))
        inputs = dict(zip(("hx_i", "hy_i", "dx_i", "dy_i", "dz_i"), words, strict=True))
        expected = {f"{k}_o": w.astype(np.int64) for k, w in met._asdict().items()}
        streams.append(Segment({"zc_i": zc, "oz_i": rest}, inputs, expected))
        square, one = (met.cos / (2 << f)) ** 2, 1 << (f + 3)
        seen.point("missed", met.missed)
        seen.point("beyond", met.beyond)
        seen.point("neither missed nor beyond", ~met.missed & ~met.beyond)
        seen.point("grazed, cosine below 0.05", ~met.missed & (square < 0.0025) & (square > 0))
        seen.point("straight, sine 0", met.s == 0)
        seen.point("sine held at the largest word", met.s == one - 1)
        for name, n in (("nx", met.nx), ("ny", met.ny), ("nz", met.nz)):
            seen.point(f"{name} saturated above", n == near[1])
            seen.point(f"{name} saturated below", n == near[0])
            seen.point(f"{name} between", (n > near[0]) & (n < near[1]))
    stream_step(f"meet_dome-{upward}", f, streams, seed)
