"""The twin on the hard cases: what does not fit is refused or flagged, nothing wraps unseen."""

import dataclasses
import importlib
import itertools
import pkgutil
import sys

import lippmann.fixed
import numpy as np
import pytest
from lippmann.conformance.hard_cases import changed, hard_sets
from lippmann.conformance.ray_sets import PanelRays, fixed_words
from lippmann.engines import trace
from lippmann.fixed.conversion import aims_of_words, pixels_of_words, rays_of_words
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.words import fits, wrapped
from lippmann.optics.rays import gets_through
from optics_cases import GRIDS, SIDES
from test_conditioning_cases import SEED, base
from tools.hard_case_errors import measure_fixed

MODULES = [
    importlib.import_module(f"lippmann.fixed.{module.name}") for module in pkgutil.iter_modules(lippmann.fixed.__path__)
]


@pytest.fixture
def overflows(monkeypatch):
    """Watches every word that is cut to its bits: a list of (function, bits, bool array over the rays)."""
    seen = []

    def watched(x, bits):
        seen.append((sys._getframe(1).f_code.co_name, bits, ~fits(np.asarray(x), bits)))
        return wrapped(x, bits)

    for module in MODULES:
        if hasattr(module, "wrapped"):
            monkeypatch.setattr(module, "wrapped", watched)
    return seen


@pytest.mark.parametrize("fraction_bits", [14, 16, 23])
@pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))
def test_no_word_wraps_unseen(grid, side, fraction_bits, overflows):
    traced = flagged = 0
    print(f"seed {SEED}")
    for rays in hard_sets(base(grid, side), "all", SEED, 24):
        if not isinstance(rays, PanelRays):
            continue
        case, why = fixed_words(rays, fraction_bits)
        if case is None:
            assert why
            continue
        overflows.clear()
        out = ray_pipeline(*case.words, case.registers, case.build)
        # leave_flat cuts one near word: the cosine in the glass, which only a reflected ray keeps, far below 1 then.
        cuts = [cut for function, bits, cut in overflows if (function, bits) != ("leave_flat", fraction_bits + 2)]
        over = np.any([np.broadcast_to(cut, out.status.shape) for cut in cuts], axis=0)
        assert not (over & gets_through(out.status)).any(), rays.name
        traced += len(over)
        flagged += int(over.sum())
    print(f"{traced} rays, {flagged} with a word cut, all of them flagged")
    assert traced > 400


@pytest.mark.parametrize(("grid", "side"), list(itertools.product(GRIDS, SIDES)))
def test_twin_stays_with_golden_on_hard_rays(grid, side):
    """The stated microradian, over the cosine at the exit, wherever formats hold the set, for aims in the cell."""
    for name in ("chief-ray", "cell-edges", "cell-ties", "rotations", "offsets", "tiny-values"):
        for rays in hard_sets(base(grid, side), name, SEED, 24):
            if isinstance(rays, PanelRays):
                row = measure_fixed(rays, 23)
                assert not row["overflowed"], row
                case, _ = fixed_words(rays, 23)
                if case is None:
                    continue
                u, v, a, b = case.words
                pixels = pixels_of_words(rays.display, u, v)
                got = rays_of_words(rays.display, pixels, case.trace(), 23)
                golden = trace(rays.display, pixels, aims_of_words(rays.display, a, b, 23))
                same = gets_through(got.status) & (got.status == golden.status)
                turn = 1e6 * np.linalg.norm(got.direction - golden.direction, axis=1)[same]
                assert (turn < np.maximum(1.0, 0.5 / golden.direction[same, 2])).all(), row


def test_refusals_are_counted():
    """Of rays, one by one, and of whole sets; each with its reason."""
    display = base("square", "panel")
    pixels = np.full((3, 2), 100.5)
    rays = PanelRays("far aims", display, pixels, np.array([[0.0, 0.0], [0.1, 0.1], [9.0, 0.0]]))
    assert measure_fixed(rays, 23)["refused"] == 1
    flat = dataclasses.replace(rays, display=changed(display, radius_mm=1e6), aperture=None)
    row = measure_fixed(flat, 23)
    assert row["refused"] == 3
    assert "cell_half" in row["why"]
