"""Test ray tracers: hard cases, test vectors, fault diagnosis, coverage, speed and error."""
