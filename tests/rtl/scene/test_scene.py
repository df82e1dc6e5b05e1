"""scene against its twin: no pixel differs, over random displays, stacks, registers of no stack, stalls and loads."""

import numpy as np
import pytest
from layer_cases import random_stack
from lippmann.errors import InputError
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.scene_build import CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_configuration import build_curve_table, scene_words, slot_bytes
from lippmann.fixed.scene_pipeline import LayerWords, SceneWords, scene
from lippmann.simulation.compilation import SHORT
from lippmann.simulation.harness import SceneHarness
from random_cases import configured_display
from words import mixed, signed

#: What is built, and F.
CASES = [
    (SceneBuild(3, 5, 64, 48, bilinear=True, samples=2), 16),
    (SceneBuild(4, 5, 32, 96, samples=1), 23),
    *(
        pytest.param(SceneBuild(layers, slots, width, height, bilinear, samples), f, marks=pytest.mark.full)
        for layers, slots, width, height, bilinear, samples, f in (
            (1, 1, 32, 32, False, 4, 14),
            (1, 2, 1024, 2, True, 1, 18),
            (2, 2, 128, 72, True, 4, 23),
            (4, 5, 256, 192, True, 1, 16),
            (4, 5, 256, 192, False, 2, 16),
            (5, 7, 512, 30, True, 2, 20),
            (6, 15, 32, 64, False, 1, 21),
            (7, 8, 1024, 255, False, 4, 22),
            (8, 9, 64, 80, True, 1, 23),
            (8, 15, 32, 32, True, 4, 16),
        )
    ),
]


def name(value):
    if not isinstance(value, SceneBuild):
        return str(value)
    kind = "bilinear" if value.bilinear else "nearest"
    return f"{value.layers}x{value.width}x{value.height}-{kind}-{value.samples}"


def pixel_rays(rng, display, build, config, pixels, samples):
    """Exit rays of random pixels' samples, of a fifth of them with an aim at the panel's edges."""
    panel = display.panel
    columns, rows = rng.integers(0, panel.width_px, pixels), rng.integers(0, panel.height_px, pixels)
    offsets = rng.integers(-8, 8, (2, pixels, samples))
    u = ((8 * (2 * columns + 1 - panel.width_px))[:, None] + offsets[0]).ravel()
    v = ((8 * (panel.height_px - 2 * rows - 1))[:, None] + offsets[1]).ravel()
    return ray_pipeline(u, v, np.zeros_like(u), np.zeros_like(u), config, build)


def wild_rays(rng, f, count):
    """Words of no ray among those that stand for steep, far and missed ones."""
    ranges = [signed(12)] * 2 + [signed(f + 4)] * 3 + [signed(f + 2)] * 3
    words = [word[-count:] for word in mixed(rng, count, *ranges)]
    words[7] = np.where(rng.random(count) < 0.8, rng.integers(1 << (f - 1), 1 << (f + 1), count), words[7])
    return FixedRays(*words, rng.choice([0, 0, 0, 4, 1, 2, 3], count))


def wild_words(rng, build):
    """Registers that no host writes: any words, slots that are not built or named twice, too much brightness."""
    layers = []
    for _ in range(8):
        scale = int(rng.choice([1, 1 << 8, 1 << 16]))
        moves = (rng.integers(*signed(32), 7) // scale).tolist()
        looks = rng.random(2) < (0.9, 0.2)
        slot = int(rng.choice([rng.integers(0, 16), rng.integers(0, build.slots_built)]))
        layers.append(LayerWords(*moves, bool(looks[0]), bool(looks[1]), slot, int(rng.integers(0, 512))))
    lattice = rng.integers(*signed(32), 3).tolist()
    return SceneWords(tuple(layers), *lattice, tuple(rng.integers(0, 65536, 3).tolist()))


@pytest.mark.parametrize(("built", "f"), CASES, ids=name)
def test_no_pixel_differs(built, f, rng, seen):
    harness = SceneHarness(built, f, SHORT)
    held = {slot: rng.integers(0, 256, built.slot_bytes, dtype=np.uint8) for slot in range(built.slots_built)}
    table = rng.integers(0, 256, 8192, dtype=np.uint8)
    for slot, content in {**held, CURVE_SLOT: table}.items():
        harness.load(slot, content)

    def compare(rays, words, case, meanwhile=None):
        stalls = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3), (0.5, 0.5)][int(rng.integers(4))]
        drawn = harness.draw(rays, words, int(rng.integers(1 << 30)), *stalls, meanwhile)
        wanted = scene(rays, words, held, table, built, f)
        differ = np.flatnonzero((drawn != wanted).any(axis=1))
        assert not len(differ), f"{case}, {stalls}: {len(differ)} of {len(wanted)} pixels, the first {differ[0]}"
        seen.point("pixels equal", len(wanted))
        seen.point("stalls", stalls != (0.0, 0.0))
        seen.point("one ray each clock", stalls == (0.0, 0.0))
        seen.point(case, len(wanted))

    for number in range(12):
        build = Build(f, ("square", "hex")[number % 2])
        display, config = configured_display(rng, build, "exact")
        try:
            stack = random_stack(rng, display, built, built.layers if number % 3 else None, smooth=number % 4 == 0)
        except (InputError, AssertionError):
            continue  # a display of the widest lenslets has no layer of this size
        # In any slots; those that are left are loaded while it is drawn.
        slots = rng.permutation(built.slots_built)[: len(stack.layers)].tolist()
        for slot, layer in zip(slots, stack.layers, strict=True):
            held[slot] = slot_bytes(layer, built)
            harness.load(slot, held[slot])
        if number == 3:
            table = build_curve_table(display)
            harness.load(CURVE_SLOT, table)
        free = [slot for slot in range(built.slots_built) if slot not in slots]
        meanwhile = None
        if free and number % 2:
            meanwhile = int(rng.choice(free)), rng.integers(0, 256, built.slot_bytes, dtype=np.uint8)
        words = scene_words(display, stack, built, tuple(slots))
        rays = pixel_rays(rng, display, build, config, 700, built.samples)
        compare(rays, words, f"{build.grid}{' while a slot is loaded' if meanwhile else ''}", meanwhile)
        if meanwhile:
            held[meanwhile[0]] = meanwhile[1]
        seen.point("turned arrays", display.array.rotation_deg % 90.0 != 0.0)
        seen.point("sky", sum(layer.sky for layer in stack.layers))
        seen.point("black without an exit", int((rays.status % 4 != 0).sum()))
    for _ in range(6):
        words = wild_words(rng, built)
        compare(wild_rays(rng, f, 600 * built.samples), words, "registers of no stack")
    rate = []
    for pixels in (500, 1000):
        harness.draw(wild_rays(rng, f, pixels * built.samples), wild_words(rng, built))
        rate.append(harness.clocks)
    assert rate[1] - rate[0] == 500 * built.samples, "one ray each clock"
    for missable in ("sky", "black without an exit", "square while a slot is loaded"):
        if not seen.seen.get(missable, 1):
            del seen.seen[missable]
