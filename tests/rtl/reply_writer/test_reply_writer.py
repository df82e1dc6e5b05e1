"""reply_writer: bytes, their order and their last, under every pair of pauses."""

import pytest
from runner import compiled, seed, simulate


@pytest.mark.parametrize("size", [4, 3])
def test_reply_writer(size):
    program = compiled("reply_writer", {"Bytes": size})
    simulate(program, "reply_writer", "cocotb_reply_writer", seed(), plusargs={"Bytes": size})
