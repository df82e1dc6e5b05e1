"""Judges rays and engines: hard cases, vectors, faults, coverage, speed against error."""
