"""Measurements: speed, always beside the error. Nothing here is asserted by tests; machines are noisy."""
