"""word_split: wide words to parts."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(("width", "parts"), [(16, 3), pytest.param(24, 2, marks=pytest.mark.full)])
def test_word_split(width, parts):
    run_cocotb("word_split", {"Width": width, "Parts": parts})
