"""word_join: parts to wide words."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(("width", "parts"), [(16, 3), pytest.param(24, 2, marks=pytest.mark.full)])
def test_word_join(width, parts):
    parameters = {"Width": width, "Parts": parts}
    simulate(compiled("word_join", parameters), "word_join", "cocotb_word_join", seed(), plusargs=parameters)
