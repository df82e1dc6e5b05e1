"""texel_blend against its twin: all alphas and all bytes, single texels and four by all kinds of weights."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.scene_pipeline import texel_blend
from scene_steps import joined, stream_scene_step


@pytest.mark.parametrize("taps", [1, 4])
def test_equals_twin(taps, seed, rng, seen):
    count = 6000
    colours = rng.integers(0, 256, (count, taps, 4))
    colours[:256] = np.arange(256)[:, None, None]  # r = g = b = a
    special = rng.random(count) < 0.3
    colours[special] = rng.choice([0, 1, 127, 128, 254, 255], (special.sum(), taps, 4))
    colours[256:320] = 255
    if taps == 1:
        weights = rng.choice([0, 65536], (count, 1))
        weights[:320] = 65536
    else:
        f, g = rng.integers(0, 256, (2, count))
        f[::7], g[::5] = rng.choice([0, 1, 255], (count + 6) // 7), rng.choice([0, 128, 255], (count + 4) // 5)
        weights = np.stack([(256 - f) * (256 - g), f * (256 - g), (256 - f) * g, f * g], axis=1)
        outside = rng.random((count, 4)) < 0.2
        outside[256:320] = False
        weights = np.where(outside, 0, weights)
    light, opacity = texel_blend(colours, weights)
    assert light.max() == 65025
    assert opacity.max() == 65536
    # As texel_fetch gives them: the opacity of 9 bits above the three bytes.
    opacities = colours[..., 3] + (colours[..., 3] >> 7)
    entries = opacities << 24 | colours[..., 2] << 16 | colours[..., 1] << 8 | colours[..., 0]
    words = {"colour_i": joined(entries, 33), "weight_i": joined(weights, 17)}
    # The RTL's red is the highest.
    out = {"light_o": joined(light[:, ::-1], 16), "opacity_o": opacity}
    stream_scene_step(f"texel_blend-{taps}", 16, [Segment({}, words, out)], seed)

    if taps == 1:
        seen.values("alpha of a whole texel", colours[weights == 65536][:, 3], range(256))
    seen.point("nothing", (weights == 0).all(axis=1))
    seen.point("opaque white", (light == 65025).all(axis=1))
    if taps == 4:
        seen.point("one of four outside", (weights == 0).sum(axis=1) == 1)
