"""The batch harness: a build of the RTL under Verilator, arrays in, arrays out (sim/batch/batch.cpp)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np

from lippmann.errors import LippmannError
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.registers import build_word
from lippmann.fixed.words import OFFSET_BITS, SLOPE_BITS, Ints
from lippmann.simulation.compilation import FAST, UNCHECKED, kept, verilated
from lippmann.simulation.toolchain import build_folder, hardware, needed, optics_sources

#: The C++ around the model.
MAIN = Path("sim", "batch", "batch.cpp")


class Harness:
    """A build, compiled with some of the compiler's flags. Raises as `verilated`."""

    def __init__(self, build: Build, flags: Sequence[str] = FAST) -> None:
        self.build = build
        self._library = ctypes.CDLL(str(_compiled(build, flags)))
        self._trace = self._library.lippmann_trace
        self._trace.restype = ctypes.c_int64
        seed_and_chances = ctypes.c_uint64, ctypes.c_uint32, ctypes.c_uint32
        self._trace.argtypes = [ctypes.c_int64, *[ctypes.c_void_p] * 6, *seed_and_chances]
        #: Clocks that the last trace took.
        self.clocks = 0

    def trace(
        self, u: Ints, v: Ints, a: Ints, b: Ints, config: Configuration,
        seed: int = 0, idle: float = 0.0, stall: float = 0.0,
    ) -> FixedRays:  # fmt: skip
        """Run rays through the RTL, with chances of a pause at the input and at the output in each clock.

        Words as `lippmann.fixed.ray_pipeline.ray_pipeline` takes and gives them. Raises LippmannError when rays stop
        coming out.
        """
        rays = [np.ascontiguousarray(words, np.int64) for words in (u, v, a, b)]
        out = np.empty((len(FixedRays._fields), len(u)), np.int64)
        registers = np.frombuffer(packed(config), np.uint32)
        pointers = [*(words.ctypes.data for words in rays), registers.ctypes.data, out.ctypes.data]
        # In 256ths; 1 would never let a ray pass.
        chances = (min(round(chance * 256.0), 255) for chance in (idle, stall))
        self.clocks = self._trace(len(u), *pointers, seed, *chances)
        if self.clocks < 0:
            raise LippmannError("the simulated pipeline gives no more rays; run the RTL's tests, make test")
        return FixedRays(*out)


@cache
def harness(build: Build, flags: Sequence[str] = FAST) -> Harness:
    """Return the harness of a build, compiled at first use and kept in `build_folder`."""
    return Harness(build, flags)


def rtl_pipeline(u: Ints, v: Ints, a: Ints, b: Ints, config: Configuration, build: Build) -> FixedRays:
    """Trace through the RTL, in the place of `lippmann.fixed.ray_pipeline.ray_pipeline`.

    With the cross terms in multiplier cells: the build that simulates fastest.
    """
    return harness(replace(build, cross_cells=True)).trace(u, v, a, b, config)


def packed(config: Configuration) -> bytes:
    """Return the bits of `optics_config_t`, padded to 32-bit words, least significant first."""
    bits = 0
    length = 0
    # A packed struct's first field is the most significant.
    for field in reversed(fields(config)):
        width = OFFSET_BITS if field.name in ("x_offset", "y_offset") else SLOPE_BITS if "_from_" in field.name else 32
        bits |= (getattr(config, field.name) & ((1 << width) - 1)) << length
        length += width
    return bits.to_bytes((length + 31) // 32 * 4, "little")


def parameters(build: Build) -> dict[str, str]:
    """Return the RTL's parameter of a build, as a number of SystemVerilog: what its register `build` holds."""
    return {"Build": f"16'h{build_word(build):04x}"}


def _compiled(build: Build, flags: Sequence[str]) -> Path:
    """Return the library of a build, compiled unless it is there."""
    top = hardware()
    sources = needed("lipp_ray_stream", optics_sources(top))
    flags = [*flags, f"-DLIPPMANN_NEAR={build.near}"]

    def make(path: Path) -> None:
        verilated(path, "lipp_ray_stream", sources, [top / MAIN], parameters(build), options=UNCHECKED, flags=flags)

    inputs: list[Path | str] = [*sources, top / MAIN, repr(build), *flags, Path(__file__)]
    return kept(build_folder() / "sim" / f"rays-{build.grid}-{build.model}-{build.fraction_bits}", inputs, make, ".so")
