"""Defines the array operations of the optics, for numpy (golden) and Dr.Jit (fast).

Coordinates across the panel are `double`; lens-local numbers are `real`. In the fast
engine, `real` is float32: it resolves 0.05 nm in a lenslet, but only 30 nm on a 700 mm
panel. Rays behind a capture's lens are `real`; their errors are below 1 um at 1 m.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

#: An array of the backend. All arrays of a call have equal lengths.
Arr = Any
State = tuple[Arr, ...]
#: The two coordinates of points or vectors.
Point = tuple[Arr, Arr]
Operation = Callable[..., Arr]
#: A function that takes a backend and a state, and returns a state.
Trace = Callable[..., State]


class Backend:
    """An interface to an array library; all arrays have equal lengths."""

    #: Convert arrays to the engine's floating-point format, to float64 and to integers.
    real: Operation
    double: Operation
    integer: Operation
    #: Rounds x down to an integer in x's number format.
    floor: Operation
    sqrt: Operation
    absolute: Operation
    maximum: Operation
    minimum: Operation
    #: Selects elements: where(condition, value if true, value if false).
    where: Operation

    def loop(self, active: Operation, body: Trace, state: State) -> State:
        """Repeat `state = body(*state)` for elements where `active(*state)` is true, until it is nowhere true."""
        raise NotImplementedError

    def refine(self, mask: Arr, trace: Trace, inputs: State, coarse: State) -> State:
        """Return `coarse`, with the elements in `mask` traced again in float64 by `trace(backend, *inputs)`."""
        return coarse


class NumpyBackend(Backend):
    """The numpy backend, which computes in float64."""

    def __init__(self) -> None:
        self.real = self.double = lambda x: np.asarray(x, np.float64)
        self.integer = lambda x: np.asarray(x).astype(np.int64)
        self.floor, self.sqrt, self.absolute = np.floor, np.sqrt, np.abs
        self.maximum, self.minimum, self.where = np.maximum, np.minimum, np.where

    def loop(self, active: Operation, body: Trace, state: State) -> State:
        # Compute only the active elements, because they are few.
        index = np.flatnonzero(active(*state))
        if index.size:
            state = tuple(np.array(x) for x in state)
        while index.size:
            part = body(*(x[index] for x in state))
            for column, piece in zip(state, part, strict=True):
                column[index] = piece
            index = index[active(*part)]
        return state


class DrJitBackend(Backend):
    """The Dr.Jit backend, on the CPU ("llvm") or a GPU ("cuda"), in float32, or in float64 if `precise`."""

    def __init__(self, device: str = "llvm", precise: bool = False) -> None:
        import drjit as dr  # golden must run without Dr.Jit

        module = getattr(dr, device).ad
        self._dr, self._device, self._precise = dr, device, precise
        self.double, self.integer = module.Float64, module.Int
        self.real = module.Float64 if precise else module.Float
        self.floor, self.sqrt, self.absolute = dr.floor, dr.sqrt, dr.abs
        self.maximum, self.minimum, self.where = dr.maximum, dr.minimum, dr.select

    def loop(self, active: Operation, body: Trace, state: State) -> State:
        result: State = self._dr.while_loop(state, active, body, mode="symbolic")
        return result

    def refine(self, mask: Arr, trace: Trace, inputs: State, coarse: State) -> State:
        if self._precise:
            return coarse
        double = DrJitBackend(self._device, precise=True)

        def fine(inputs: State, coarse: State) -> State:
            pairs = zip(coarse, trace(double, *inputs), strict=True)
            return tuple(type(old)(new) for old, new in pairs)

        result: State = self._dr.if_stmt((inputs, coarse), mask, fine, lambda _, coarse: coarse, mode="symbolic")
        return result
