"""scene_block: every register of builds of few and many layers, and the slots that are shown."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(
    "layers", [3, pytest.param(1, marks=pytest.mark.full), pytest.param(8, marks=pytest.mark.full)]
)
def test_scene_block(layers):
    slots, width_bits, height, bilinear, samples_bits = layers + 2, 6, 48, 1, 2
    word = layers | slots << 4 | width_bits << 8 | height << 12 | bilinear << 23 | samples_bits << 24
    program = compiled("scene_block", {"Scene": f"26'h{word:07x}"})
    simulate(program, "scene_block", "cocotb_scene_block", seed(), plusargs={"Layers": layers, "Word": word})
