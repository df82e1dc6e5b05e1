"""Traces rays in arrays of numpy (float64, engine golden) or Dr.Jit (float32, engine fast)."""
