"""Judge rays and engines: hard cases, test vectors, faults, coverage, speed and error."""
