"""The few array operations that the optics need, for numpy (golden) and Dr.Jit (fast).

Two real formats take part: `double` for coordinates that span the whole panel, and `real`, the engine's own,
for everything lens-local. In the golden engine both are float64; in the fast one `real` is float32, which
resolves 0.05 nm inside a lenslet but only 30 nm across a 700 mm panel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

#: An array of the backend at hand: numpy.ndarray, or a Dr.Jit array type. All of a call have one length.
Arr = Any
State = tuple[Arr, ...]


class Backend(Protocol):
    """What the optics ask of an array library."""

    def real(self, x: Arr) -> Arr:
        """Cast to the engine's own floating-point format."""

    def double(self, x: Arr) -> Arr:
        """Cast to float64."""

    def integer(self, x: Arr) -> Arr:
        """Cast whole numbers to signed integers."""

    def floor(self, x: Arr) -> Arr:
        """Largest whole number <= x, in x's format."""

    def sqrt(self, x: Arr) -> Arr:
        """Square root."""

    def absolute(self, x: Arr) -> Arr:
        """Magnitude."""

    def maximum(self, x: Arr, y: Arr | float) -> Arr:
        """Larger of two."""

    def minimum(self, x: Arr, y: Arr | float) -> Arr:
        """Smaller of two."""

    def where(self, condition: Arr, yes: Arr | float, no: Arr | float) -> Arr:
        """Choose element by element."""

    def loop(self, active: Callable[..., Arr], body: Callable[..., State], state: State) -> State:
        """Repeat `state = body(*state)` for the elements where `active(*state)`, until there are none."""

    def redo(self, doubtful: Arr, work: Callable[..., State], inputs: State, rough: State) -> State:
        """Return `rough` with its doubtful elements replaced by `work(backend, *inputs)` in double precision.

        `inputs` are double. A backend that works in double precision anyway returns `rough`.
        """


class NumpyBackend:
    """float64 throughout."""

    def real(self, x: Arr) -> Arr:
        return np.asarray(x, np.float64)

    double = real

    def integer(self, x: Arr) -> Arr:
        return np.asarray(x).astype(np.int64)

    def floor(self, x: Arr) -> Arr:
        return np.floor(x)

    def sqrt(self, x: Arr) -> Arr:
        return np.sqrt(x)

    def absolute(self, x: Arr) -> Arr:
        return np.abs(x)

    def maximum(self, x: Arr, y: Arr | float) -> Arr:
        return np.maximum(x, y)

    def minimum(self, x: Arr, y: Arr | float) -> Arr:
        return np.minimum(x, y)

    def where(self, condition: Arr, yes: Arr | float, no: Arr | float) -> Arr:
        return np.where(condition, yes, no)

    def loop(self, active: Callable[..., Arr], body: Callable[..., State], state: State) -> State:
        # Works on the active elements only: they are few, and the others must not change.
        state = tuple(np.array(x) for x in state)
        index = np.flatnonzero(active(*state))
        while index.size:
            part = body(*(x[index] for x in state))
            for whole, piece in zip(state, part, strict=True):
                whole[index] = piece
            index = index[active(*part)]
        return state

    def redo(self, doubtful: Arr, work: Callable[..., State], inputs: State, rough: State) -> State:
        return rough


class DrJitBackend:
    """float32, or float64 on request, on CPU threads ("llvm") or on an NVIDIA GPU ("cuda")."""

    def __init__(self, device: str = "llvm", precise: bool = False) -> None:
        import drjit as dr  # soft: the golden engine must run without it

        module = getattr(dr, device).ad
        self._dr = dr
        self._device = device
        self._precise = precise
        self.Double = module.Float64
        self.Real = module.Float64 if precise else module.Float
        self.Int = module.Int

    def real(self, x: Arr) -> Arr:
        return self.Real(x)

    def double(self, x: Arr) -> Arr:
        return self.Double(x)

    def integer(self, x: Arr) -> Arr:
        return self.Int(x)

    def floor(self, x: Arr) -> Arr:
        return self._dr.floor(x)

    def sqrt(self, x: Arr) -> Arr:
        return self._dr.sqrt(x)

    def absolute(self, x: Arr) -> Arr:
        return self._dr.abs(x)

    def maximum(self, x: Arr, y: Arr | float) -> Arr:
        return self._dr.maximum(x, y)

    def minimum(self, x: Arr, y: Arr | float) -> Arr:
        return self._dr.minimum(x, y)

    def where(self, condition: Arr, yes: Arr | float, no: Arr | float) -> Arr:
        return self._dr.select(condition, yes, no)

    def loop(self, active: Callable[..., Arr], body: Callable[..., State], state: State) -> State:
        result: State = self._dr.while_loop(state, active, body, mode="symbolic")
        return result

    def redo(self, doubtful: Arr, work: Callable[..., State], inputs: State, rough: State) -> State:
        if self._precise:
            return rough
        precise = DrJitBackend(self._device, precise=True)

        def again(inputs: State, rough: State) -> State:
            return tuple(type(old)(new) for old, new in zip(rough, work(precise, *inputs), strict=True))

        result: State = self._dr.if_stmt((inputs, rough), doubtful, again, lambda inputs, rough: rough, mode="symbolic")
        return result
