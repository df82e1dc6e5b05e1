"""byte_square: all 256 bytes."""

import numpy as np
from bench import Segment
from parts import BYTE_SQUARE, stream_parts
from runner import seed


def test_all_bytes():
    values = np.arange(256)
    stream_parts([(BYTE_SQUARE, Segment({}, {"value_i": values}, {"square_o": values**2}))], seed())
