"""reply_writer: bytes, their order and their last, under every pair of pauses."""

import pytest
from runner import run_cocotb


@pytest.mark.parametrize("size", [4, 3])
def test_reply_writer(size):
    run_cocotb("reply_writer", {"Bytes": size})
