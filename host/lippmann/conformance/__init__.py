"""Judges rays and engines: hard cases, test vectors, faults, coverage, and speed against error."""
