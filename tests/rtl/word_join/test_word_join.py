"""word_join: parts to wide words."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize(("width", "parts"), [(16, 3), pytest.param(24, 2, marks=pytest.mark.full)])
def test_word_join(width, parts):
    run_cocotb("word_join", {"Width": width, "Parts": parts})
