"""enter_flat against its twin: along the axis to 60 degrees, from the least to the largest index."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.lenslet_faces import enter_flat
from lippmann.fixed.words import extra_bits
from steps import FRACTIONS, stream_step
from words import mixed, signed, word


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    segments = []
    more = extra_bits(f)
    b = f + more
    most = int(np.sqrt(0.75) * (2 << b))
    for n in (1.16, 1.5, 2.2, *rng.uniform(1.16, 2.2, 3), 1.01, -1.0):
        inverse = int(np.clip(word(1 / n, f + 1), *signed(f + 2)))
        ex, ey = mixed(rng, 700, (-most, most), (-most, most))
        angle = rng.random(200) * 2 * np.pi
        ex = np.concatenate([ex, word(0.866 * np.cos(angle), b + 1)])
        ey = np.concatenate([ey, word(0.866 * np.sin(angle), b + 1)])
        within = (ex * ex + ey * ey <= most * most) | (n < 1.1)
        ex, ey = ex[within], ey[within]
        tx, ty, dz, beyond = enter_flat(ex, ey, inverse, f)
        out = {"tx_o": tx, "ty_o": ty, "dz_o": dz, "beyond_o": beyond.astype(np.int64)}
        segments.append(Segment({"index_inverse_i": inverse}, {"ex_i": ex, "ey_i": ey}, out))
        sine = ((ex / n) ** 2 + (ey / n) ** 2) / 4.0 ** (b + 1)
        # The argument is a word below 1, and so is a word of its root, but for the root's own error.
        largest = dz >= (2 << f + 3 * more) - 1 - 2 * more
        seen.point("along the axis, dz the largest word", (ex == 0) & (ey == 0) & largest)
        seen.point("squares cut to less than 0", (ex <= 0) & (ey <= 0) & (ex >= -2) & (ey >= -2))
        seen.point("root in the lower octave", sine > 0.5)
        seen.point("root in the upper octave", sine < 0.5)
        # From 90 degrees on the root's argument wraps; unit_slope flags such rays before.
        assert (beyond == (sine > 0.75))[(np.abs(sine - 0.75) > 2.0**-f) & (sine < 1.0)].all()
        seen.point("beyond 60 degrees", beyond)
        seen.point("steepest", sine > 0.99 * 0.75 / 1.16**2)
    stream_step("enter_flat", f, segments, seed)
