"""Films: scenes that move, rendered frame by frame."""
