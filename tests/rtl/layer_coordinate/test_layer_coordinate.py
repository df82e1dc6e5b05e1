"""layer_coordinate against its twin: layers in front, behind and at infinity, and words at the ends of their ranges."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.scene_pipeline import LayerWords, Lines, layer_coordinate
from scene_steps import stream_scene_step
from steps import FRACTIONS
from words import mixed, signed

MOVES = ("s0", "t0", "depth", "a", "b", "c", "d")


def layers(rng):
    """Registers of layers: of textures in view, at the ends of the words, and any."""
    low, high = signed(32)
    yield LayerWords(**dict.fromkeys(MOVES, low))
    yield LayerWords(**dict.fromkeys(MOVES, high))
    yield LayerWords()
    for _ in range(5):
        # A texel to a radius or so, at 1 to 100 radii.
        scale = rng.uniform(-4, 4, 4) * (1 << 24)
        zero = rng.uniform(-100, 300, 2) * (1 << 16)
        depth = rng.uniform(-100, 100) * (1 << 20)
        yield LayerWords(*(int(w) for w in (*zero, depth, *scale)))
    for _ in range(4):
        yield LayerWords(*(int(w) for w in rng.integers(low, high, 7, endpoint=True)))


@pytest.mark.parametrize("bilinear", [False, True], ids=["nearest", "bilinear"])
@pytest.mark.parametrize("f", FRACTIONS)
def test_equals_twin(f, bilinear, seed, rng, seen):
    segments = []
    for number, words in enumerate(layers(rng)):
        infinite = bool(number % 3 == 2)
        layer = LayerWords(*(getattr(words, name) for name in MOVES), infinite=infinite)
        ranges = (signed(f + 9), signed(f + 9), signed(f + 4), signed(f + 4))
        # Of rays that leave a display of some 20 lenslets.
        rays = (*rng.integers(-(20 << (f - 3)), 20 << (f - 3), (2, 500)), *rng.integers(-(1 << f), 1 << f, (2, 500)))
        lines = [np.concatenate(pair) for pair in zip(mixed(rng, 300, *ranges), rays, strict=True)]
        s_, t_, beyond = layer_coordinate(Lines(*lines, np.ones(len(lines[0]), bool)), layer, bilinear, f)
        config = {f"{name}_i": getattr(layer, name) for name in MOVES} | {"infinite_i": int(infinite)}
        ports = dict(zip(("x_i", "y_i", "slope_x_i", "slope_y_i"), lines, strict=True))
        segments.append(Segment(config, ports, {"s_o": s_, "t_o": t_, "beyond_o": beyond.astype(np.int64)}))
        seen.point("beyond", beyond)
        seen.point("not beyond", ~beyond)
        seen.point("in a texture", ~beyond & (s_ >= 0) & (s_ < 256 << 8) & (t_ >= 0) & (t_ < 192 << 8))
    stream_scene_step(f"layer_coordinate-{int(bilinear)}", f, segments, seed)
