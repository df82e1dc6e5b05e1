"""The way of a ray: panel, lattice, aim, flat face, dome, exit.

One file a step. The steps are written once over arrays of any kind (`backend.py`): numpy float64 makes
the golden tracer, Dr.Jit float32 the fast engine. Their independent leg is physics, in the tests.
"""
