"""leave_flat against its twin: up to, at and beyond total internal reflection, thin and thick glass."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.lenslet_faces import Meeting, leave_flat
from steps import FRACTIONS, stream_step
from words import mixed, signed, word


def laterals(rng, count, n, f):
    """Lateral directions in the glass: every size below 1, more of them around the limit of total reflection."""
    size = np.where(rng.random(count) < 0.4, (1 + rng.normal(0, 1e-3, count)) / n, rng.random(count))
    size = np.minimum(size, 0.999)
    angle = rng.random(count) * 2 * np.pi
    return word(size * np.cos(angle), f + 1), word(size * np.sin(angle), f + 1)


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    near = signed(f + 2)
    segments = []
    optics = [(n, depth) for n in (1.16, 1.5, 2.2) for depth in (0.99, 0.0, -2.99)]
    optics += [(1.5, 7.99), (1.5, -8.0), (3.9, 1.5), (0.5, -6.5), (-1.5, 2.0)]
    optics += list(zip(rng.uniform(1.16, 2.2, 3), rng.uniform(-3, 1, 3), strict=True))
    for n, depth in optics:
        index, square, zc = int(word(n, f)), int(word(np.clip(n * abs(n), -8.0, 7.99), f)), int(word(depth, f))
        dx, dy = laterals(rng, 500, n, f)
        other = mixed(rng, 300, near, near)
        unit = (other[0] ** 2 + other[1] ** 2 < 1 << (2 * f + 2)) | (depth > 1.0)
        axis = np.array([(0, 0), (1, 0), (0, -1), (-1, -1)]).T
        dx, dy = np.concatenate([dx, other[0][unit], axis[0]]), np.concatenate([dy, other[1][unit], axis[1]])
        nx, ny, nz = (w[-len(dx) :] for w in mixed(rng, len(dx), near, near, near))
        nothing = np.zeros(len(dx), np.int64)
        met = Meeting(nx, ny, nz, nothing, nothing, nothing == 1, nothing == 1)
        out = leave_flat(met, dx, dy, zc, index, square, f)
        inputs = {"nx_i": nx, "ny_i": ny, "nz_i": nz, "dx_i": dx, "dy_i": dy}
        expected = {f"{k}_o": np.asarray(w).astype(np.int64) for k, w in out._asdict().items()}
        config = {"zc_i": zc, "index_i": index, "index_square_i": square}
        segments.append(Segment(config, inputs, expected))
        sine = (dx.astype(float) ** 2 + dy.astype(float) ** 2) / 4.0 ** (f + 1)
        assert out.beyond[sine > 1.0 + 2.0**-f].all()
        seen.point("beyond", out.beyond)
        seen.point("beyond, 60 degrees in the glass and less", out.beyond & (sine < 0.74))
        seen.point("lateral part of 1 or more", sine > 1.0)
        seen.point("along the axis", (dx == 0) & (dy == 0))
        seen.point("squares cut to less than 0", (dx == -1) & (dy == -1))
        seen.point("totally reflected", out.reflected)
        seen.point("just before total reflection", ~out.reflected & (sine * n * n > 0.998))
        seen.point("just beyond it", out.reflected & (sine * n * n < 1.002))
        seen.point("glass root in the lower octave", sine > 0.5)
        seen.point("glass root in the upper octave", sine < 0.5)
        seen.point("depth negative", nz < 2 * zc)
    stream_step("leave_flat", f, segments, seed)
