"""The path of a ray, over arrays of numpy (float64, golden) or Dr.Jit (float32, fast)."""
