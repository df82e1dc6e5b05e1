"""composite against its twin: opaque, transparent and half transparent layers, any brightness and background."""

import numpy as np
import pytest
from bench import Segment
from lippmann.fixed.scene_pipeline import composite
from scene_steps import LAYERS, joined, stream_scene_step


@pytest.mark.parametrize("layers", LAYERS)
def test_equals_twin(layers, seed, rng, seen):
    segments = []
    for number in range(8):
        count = 800
        opacity = rng.integers(0, 65537, (count, layers))
        extreme = rng.choice([0, 1, 65535, 65536], (count, layers))
        opacity = np.where(rng.random((count, layers)) < 0.5, extreme, opacity)
        opacity[:20], opacity[20:40] = 0, 65536
        # Premultiplied: a layer has no more light than it has opacity.
        most = np.minimum((opacity * 65025 + 32768) >> 16, 65025)
        light = (most[..., None] * rng.choice([0.0, 1.0, 1.0, 0.37], (count, layers, 3))).astype(np.int64)
        brightness = rng.integers(0, 512, layers) if number else np.full(layers, 256)
        background = np.array([0, 65535, 65025]) if number == 1 else rng.integers(0, 65536, 3)
        draws = rng.random(count) < 0.8
        out = composite(list(light.transpose(1, 0, 2)), list(opacity.T), draws, brightness.tolist(), background)
        config = {
            "brightness_i": int(joined(brightness[None], 9)[0]),
            "background_i": int(joined(background[None, ::-1], 16)[0]),
        }
        words = {"light_i": joined(light[..., ::-1], 16), "opacity_i": joined(opacity, 17), "draws_i": draws}
        segments.append(Segment(config, words, {"light_o": joined(out[:, ::-1], 16)}))
        seen.point("black without an exit", ~draws)
        seen.point("the background shows whole", draws & (opacity == 0).all(axis=1))
        seen.point("the background is hidden", draws & (opacity == 65536).any(axis=1))
        seen.point("brightness above 1", (brightness > 256).sum())
        seen.point("white", draws & (out == 65025).any(axis=1))
    stream_scene_step(f"composite-{layers}", 16, segments, seed)
