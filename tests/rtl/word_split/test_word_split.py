"""word_split: wide words to parts."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize(("width", "parts"), [(16, 3), pytest.param(24, 2, marks=pytest.mark.full)])
def test_word_split(width, parts):
    parameters = {"Width": width, "Parts": parts}
    simulate(compiled("word_split", parameters), "word_split", "cocotb_word_split", seed(), plusargs=parameters)
