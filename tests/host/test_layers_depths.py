"""Depths of layers: disparities by geometry, partitions against every partition, and two planes found."""

import itertools
import math

import numpy as np
import pytest
from lippmann.layers.scene_cutting import depth_of, disparity, partition, slabs_of
from scene_cases import generator, on_screen

SEED = 1615


def test_the_disparity_is_how_far_a_point_moves_across_the_display():
    """Where the line from an eye to the point crosses z = 0, for two eyes 1 mm apart."""
    for z in (-300.0, -5.0, 0.0, 40.0, 250.0):
        before, after = (on_screen((3.0, 2.0, z), (x, 0.0, 600.0))[0] for x in (7.0, 8.0))
        assert -(after - before) == pytest.approx(float(disparity(z, 600.0)), abs=1e-12)
        assert depth_of(float(disparity(z, 600.0)), 600.0) == pytest.approx(z)
    assert float(disparity(-math.inf, 600.0)) == -1.0
    assert depth_of(-1.0, 600.0) == -math.inf


def spread(values, weights, ends):
    """Weighted squares about the means of the runs that end there."""
    total = 0.0
    for first, end in zip([0, *ends[:-1]], ends, strict=True):
        mean = np.average(values[first:end], weights=weights[first:end])
        total += float(weights[first:end] @ (values[first:end] - mean) ** 2)
    return total


@pytest.mark.parametrize("case", range(8))
def test_a_partition_is_the_best_of_all(case):
    random = generator(SEED, "partition", case)
    n = int(random.integers(3, 11))
    values, weights = np.sort(random.normal(size=n))[::-1], random.uniform(0.1, 5.0, n)
    for count in range(1, n + 1):
        found = partition(values, weights, count)
        assert len(found) == count
        assert found[-1] == n
        assert sorted(set(found)) == found
        best = min(spread(values, weights, [*cut, n]) for cut in itertools.combinations(range(1, n), count - 1))
        assert spread(values, weights, found) == pytest.approx(best, abs=1e-9)


def test_planes_at_three_depths_and_the_sky_are_found():
    random = generator(SEED, "planes")
    z = random.permutation(np.repeat([30.0, -10.0, -80.0, -np.inf], [50, 400, 200, 100]))
    slabs = slabs_of(z, np.ones(len(z)), 4, 600.0, 90.0)
    assert [slab.depth_mm for slab in slabs] == pytest.approx([30.0, -10.0, -80.0, -math.inf], abs=1e-9)
    assert [slab.front_mm for slab in slabs[1:]] == [slab.back_mm for slab in slabs[:-1]]
    assert (slabs[0].front_mm, slabs[-1].back_mm) == (90.0, -math.inf)
    # Halfway in disparity: the plane there is as far off from both depths.
    assert disparity(slabs[0].back_mm, 600.0) == pytest.approx((30 / 570 - 10 / 610) / 2)
    # More layers than depths give no more.
    assert len(slabs_of(z, np.ones(len(z)), 8, 600.0, 90.0)) == 4
    # With three layers, the nearest depths in disparity share one: 30 and -10 differ by 0.069, -10 and -80 by 0.101,
    # the sky by 0.88 from -80. By weight 50 x 400 / 450 against 400 x 200 / 600 they are nearer still.
    assert [round(slab.depth_mm, 1) for slab in slabs_of(z, np.ones(len(z)), 3, 600.0, 90.0)][1:] == [-80.0, -math.inf]


def test_detail_decides_where_layers_go():
    """Two planes nearby with detail, and two far apart with little of it."""
    z = np.repeat([20.0, 0.0, -60.0, -120.0], 100)
    slabs = slabs_of(z, np.repeat([0.0, 0.0, 1.0, 1.0], 100), 3, 600.0, 90.0)
    assert [round(s.depth_mm, 6) for s in slabs[1:]] == [-60.0, -120.0]
    slabs = slabs_of(z, np.repeat([1.0, 1.0, 0.0, 0.0], 100), 3, 600.0, 90.0)
    assert [round(s.depth_mm, 6) for s in slabs[:2]] == [20.0, 0.0]
