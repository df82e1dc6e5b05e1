"""exit_line against its twin: rays of every status, along the axis, at the limit of steepness, and words of no ray."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.scene_pipeline import exit_line
from scene_steps import stream_scene_step
from steps import FRACTIONS
from words import mixed, signed


@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, seed, rng, seen):
    one = 1 << (f + 1)
    segments = []
    lattices = [(0, 0, 0), (*signed(32), 1), (1 << 30, 1 << 29, 930_000_000)]
    for lattice in [*lattices, *rng.integers(*signed(32), (4, 3)).tolist()]:
        # Unit directions, a quarter of them near the limit of dz; then any words.
        count = 400
        dz = np.where(rng.random(count) < 0.25, 0.25 + rng.uniform(-1e-3, 1e-3, count), rng.uniform(0.2, 1.0, count))
        angle = rng.uniform(0, 2 * np.pi, count)
        side = np.sqrt(1 - dz**2)
        unit = np.rint(np.stack([side * np.cos(angle), side * np.sin(angle), dz]) * one)
        unit = np.clip(unit, -one, one - 1).astype(np.int64)
        unit[2][:4] = one // 4 - 1, one // 4, one - 1, one // 4 + 1
        near = rng.integers(-60, 60, (2, count)), rng.integers(-(one << 1), one << 1, (3, count))
        rays = [*near[0], *near[1], *unit]
        wild = mixed(rng, 600, *[signed(12)] * 2, *[signed(f + 4)] * 3, *[signed(f + 2)] * 3)
        rays = [np.concatenate(pair) for pair in zip(rays, wild, strict=True)]
        rays = FixedRays(*rays, rng.integers(0, 8, len(rays[0])))
        lines = exit_line(rays, *lattice, f)
        words = {f"{name}_i": word for name, word in rays._asdict().items()}
        out = {f"{name}_o": word.astype(np.int64) for name, word in lines._asdict().items()}
        segments.append(Segment(dict(zip(("xi_i", "xj_i", "yj_i"), lattice, strict=True)), words, out))
        through = (rays.status == 0) | (rays.status == 4)
        seen.point("draws", lines.draws)
        seen.point("too steep", through & (rays.dz < one // 4))
        seen.point("just steep enough", through & (rays.dz == one // 4))
        seen.point("too far", through & (rays.dz >= one // 4) & ~lines.draws)
        seen.point("no exit", ~through & ~lines.draws)
    stream_scene_step("exit_line", f, segments, seed)
