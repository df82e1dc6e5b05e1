"""delay: the same word, as many clocks later as its parameter says."""

import numpy as np
from bench import Segment
from parts import DELAYS, delay, rings, stream_parts
from rtl_coverage import Coverage
from runner import seed


def test_keeps_every_word_for_all_parameters():
    s = seed()
    rng = np.random.default_rng(s)
    seen = Coverage("delay", "all")
    batch = []
    for width, cycles in DELAYS:
        words = rng.integers(0, 1 << min(width, 62), 300).astype(object)
        if width > 62:
            words = (words << (width - 62)) + rng.integers(0, 1 << (width - 62), 300)
        batch.append((delay("delay", width, cycles), Segment({}, {"d_i": words}, {"q_o": words})))
        if width != 1:
            batch.append((rings(width, cycles), Segment({}, {"d_i": words}, {"q_o": words})))
        seen.point(f"{cycles} cycles", len(words))
    stream_parts(batch, s)
    seen.close()
