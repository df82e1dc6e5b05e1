"""pixel_to_lattice against its twin, and against the affine map in integers of any length."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_start import pixel_to_lattice
from steps import FRACTIONS, stream_step
from words import mixed, signed

NAMES = ("x_from_u", "x_from_v", "x_offset", "y_from_u", "y_from_v", "y_offset")


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    ranges = [signed(52 if name.endswith("offset") else 35) for name in NAMES]
    rows = np.array([w[:-8] if len(w) > 8 else w for w in mixed(rng, 8, *ranges)])
    columns = np.concatenate([rows[:, :3], rng.permutation(rows[:, 3:], axis=1)[:, :4],
                              np.array([rng.integers(*r, 6) for r in ranges])], axis=1)  # fmt: skip
    segments = []
    for column in columns.T.tolist():
        config = dict(zip(NAMES, column, strict=True))
        u, v = mixed(rng, 400, signed(18), signed(18))
        out = {}
        wraps = np.zeros(len(u), bool)
        for axis in "xy":
            names = (f"{axis}_from_u", f"{axis}_from_v", f"{axis}_offset")
            k_u, k_v, offset = (config[name] for name in names)
            out[f"{axis}_o"], beyond = pixel_to_lattice(u, v, k_u, k_v, offset, f)
            # The whole sum at once: 40 fraction bits, cut to F, the index wrapped to 12 bits.
            whole = (u.astype(object) * k_u + v.astype(object) * k_v + offset) >> (40 - f)
            half = 1 << (11 + f)
            assert (((whole + half) % (2 * half)) - half == out[f"{axis}_o"]).all(), config
            seen.point("lower half carries", ((u * (k_u & 0x1FFFF) + v * (k_v & 0x1FFFF)) >> 17) > 0)
            seen.point("lower half borrows", ((u * (k_u & 0x1FFFF) + v * (k_v & 0x1FFFF)) >> 17) < 0)
            assert (beyond == (whole >= half) | (whole < -half)).all()
            wraps |= beyond
            seen.point("index wraps", beyond)
        out["beyond_o"] = wraps.astype(np.int64)
        segments.append(Segment({f"{k}_i": w for k, w in config.items()}, {"u_i": u, "v_i": v}, out))
    stream_step("pixel_to_lattice", f, segments, seed)
