"""delay: the same word, as many clocks later as its parameter says."""

from bench import Segment
from parts import DELAYS, delay, rings, stream_parts


def test_keeps_every_word_for_all_parameters(seed, rng):
    batch = []
    for width, cycles in DELAYS:
        words = rng.integers(0, 1 << min(width, 62), 300).astype(object)
        if width > 62:
            words = (words << (width - 62)) + rng.integers(0, 1 << (width - 62), 300)
        batch.append((delay("delay", width, cycles), Segment({}, {"d_i": words}, {"q_o": words})))
        if width != 1:
            batch.append((rings(width, cycles), Segment({}, {"d_i": words}, {"q_o": words})))
    stream_parts(batch, seed)
