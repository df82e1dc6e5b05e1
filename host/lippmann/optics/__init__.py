"""The path of a ray: panel, lattice, aim, flat face, dome.

One file for each surface. They are written once over arrays of any kind (`backend.py`): with numpy float64 they are
the golden engine, with Dr.Jit float32 the fast one. The tests check both against physics, independently.
"""
