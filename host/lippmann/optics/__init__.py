"""The path of a ray, over arrays of numpy (float64, the engine golden) or Dr.Jit (float32, the engine fast)."""
