"""Runs the RTL on arrays of rays, as a library compiled from the harnesses in sim/batch/."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np

from lippmann.errors import LippmannError
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import Configuration
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.registers import build_word
from lippmann.fixed.scene_build import CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_pipeline import SceneWords
from lippmann.fixed.words import OFFSET_BITS, SLOPE_BITS, Bytes, Ints
from lippmann.simulation.compilation import FAST, UNCHECKED, cached_file, verilated
from lippmann.simulation.toolchain import build_folder, hardware, needed, rtl_sources

#: Size of the RTL type `scene_config_t` in 32-bit words.
_CONFIG_WORDS = 69
_POINTER, _NUMBER = ctypes.c_void_p, ctypes.c_int64
#: C types: seed of the pauses, and their probabilities (1/256) at input and output.
_PAUSES = ctypes.c_uint64, ctypes.c_uint32, ctypes.c_uint32


class RayHarness:
    """The compiled ray tracer RTL for the parameters `build`.

    Raises the errors of `verilated`.
    """

    def __init__(self, build: Build, flags: Sequence[str] = FAST) -> None:
        self._trace = ctypes.CDLL(str(ray_library(build, flags))).lippmann_trace
        self._trace.restype, self._trace.argtypes = _NUMBER, [_NUMBER, *[_POINTER] * 6, *_PAUSES]
        #: Clock cycles of the last trace.
        self.clocks = 0

    def trace(
        self,
        u: Ints,
        v: Ints,
        a: Ints,
        b: Ints,
        config: Configuration,
        seed: int = 0,
        idle: float = 0.0,
        stall: float = 0.0,
    ) -> FixedRays:
        """Trace rays through the RTL; arguments and result are those of the Python twin `ray_pipeline`.

        `idle` and `stall` are the probabilities of a pause at the RTL's input and
        output. Raises LippmannError if the RTL stops producing rays.
        """
        rays = [np.ascontiguousarray(words, np.int64) for words in (u, v, a, b)]
        out = np.empty((len(FixedRays._fields), len(u)), np.int64)
        registers = np.frombuffer(packed(config), np.uint32)
        pointers = [*(words.ctypes.data for words in rays), registers.ctypes.data, out.ctypes.data]
        self.clocks = self._trace(len(u), *pointers, seed, *_in_256ths(idle, stall))
        if self.clocks < 0:
            raise LippmannError("the simulated pipeline stopped before the last ray; run make test to find the fault")
        return FixedRays(*out)


class SceneHarness:
    """The scene RTL, compiled with `f` fraction bits.

    Raises the errors of `verilated`.
    """

    def __init__(self, build: SceneBuild, f: int, flags: Sequence[str] = FAST) -> None:
        self.build = build
        name, values = f"scene-{build.layers}-{f}", scene_parameters(build, f)
        path = _compiled(name, "draw.cpp", "lipp_scene", values, [*flags, f"-DLIPPMANN_F={f}"])
        self._library = library = ctypes.CDLL(str(path))
        library.lippmann_scene_new.restype = _POINTER
        library.lippmann_scene_delete.argtypes = [_POINTER]
        library.lippmann_scene_load.argtypes = [_POINTER, ctypes.c_int, _NUMBER, _POINTER]
        draw = library.lippmann_scene_draw
        draw.restype = _NUMBER
        draw.argtypes = [_POINTER, _NUMBER, _NUMBER, *[_POINTER] * 3, *_PAUSES, ctypes.c_int, _NUMBER, _POINTER]
        self._model = library.lippmann_scene_new()
        self._loaded: dict[int, bytes] = {}
        #: Clock cycles of the last frame.
        self.clocks = 0

    def __del__(self) -> None:
        if hasattr(self, "_model"):
            self._library.lippmann_scene_delete(self._model)

    def load(self, slot: int, content: Bytes) -> None:
        """Write a slot, or the panel's curve (slot 15), one byte per clock; skip unchanged content."""
        content = np.ascontiguousarray(content, np.uint8)
        if self._loaded.get(slot) != content.tobytes():
            self._library.lippmann_scene_load(self._model, slot, len(content), content.ctypes.data)
            self._loaded[slot] = content.tobytes()

    def draw(
        self,
        rays: FixedRays,
        words: SceneWords,
        seed: int = 0,
        idle: float = 0.0,
        stall: float = 0.0,
        meanwhile: tuple[int, Bytes] | None = None,
    ) -> Bytes:
        """Draw a frame of exit rays, and return the pixels (N, 3); pauses are those of `RayHarness.trace`.

        `meanwhile` is a slot and the content to load while the RTL draws the frame.
        Raises LippmannError if the RTL stops producing pixels, or marks a wrong pixel
        as the frame's first or last.
        """
        exits = np.array(rays, np.int64)
        out = np.empty((len(rays.i) // self.build.samples, 3), np.uint8)
        registers = np.frombuffer(words.bits.to_bytes(4 * _CONFIG_WORDS, "little"), np.uint32)
        slot, content = meanwhile or (-1, np.zeros(0, np.uint8))
        content = np.ascontiguousarray(content, np.uint8)
        self._loaded.pop(slot, None)
        pointers = exits.ctypes.data, registers.ctypes.data, out.ctypes.data
        pauses = seed, *_in_256ths(idle, stall)
        self.clocks = self._library.lippmann_scene_draw(
            self._model, len(rays.i), len(out), *pointers, *pauses, slot, len(content), content.ctypes.data
        )
        if self.clocks < 0:
            why = "stopped before the last pixel" if self.clocks == -1 else "marked a wrong pixel as first or last"
            raise LippmannError(f"the simulated scene pipeline {why}; run make test to find the fault")
        return out


#: Return the harness of a build; the first call compiles the RTL.
ray_harness = cache(RayHarness)
#: Idle scene models, keyed by build and number of fraction bits.
_models: dict[tuple[SceneBuild, int], list[SceneHarness]] = {}


def rtl_pipeline(u: Ints, v: Ints, a: Ints, b: Ints, config: Configuration, build: Build) -> FixedRays:
    """Trace rays through the RTL instead of the Python twin, with `cross_cells` True for speed."""
    return ray_harness(replace(build, cross_cells=True)).trace(u, v, a, b, config)


def rtl_scene(
    rays: FixedRays, words: SceneWords, slots: Mapping[int, Bytes], table: Bytes, build: SceneBuild, f: int
) -> Bytes:
    """Draw exit rays with the RTL instead of the Python twin's `scene`; each thread has its own model."""
    models = _models.setdefault((build, f), [])
    try:
        model = models.pop()
    except IndexError:  # all models are in use
        model = SceneHarness(build, f)
    for slot, content in {**slots, CURVE_SLOT: table}.items():
        model.load(slot, content)
    pixels = model.draw(rays, words)
    models.append(model)  # a model is not reused after an error
    return pixels


def packed(config: Configuration) -> bytes:
    """Return the bits of `optics_config_t` as 32-bit words, least significant first."""
    bits = length = 0
    # A packed struct's first field is the most significant.
    for field in reversed(fields(config)):
        width = 32
        if field.name in ("x_offset", "y_offset"):
            width = OFFSET_BITS
        elif "_from_" in field.name:
            width = SLOPE_BITS
        bits |= (getattr(config, field.name) & ((1 << width) - 1)) << length
        length += width
    return bits.to_bytes((length + 31) // 32 * 4, "little")


def optics_parameters(build: Build) -> dict[str, int | str]:
    """Return the RTL parameter `Build` for a build, as SystemVerilog."""
    return {"Build": f"16'h{build_word(build):04x}"}


def scene_parameters(build: SceneBuild, f: int) -> dict[str, int | str]:
    """Return the RTL parameters `F` and `Scene` for a build that draws scenes."""
    return {"F": f, "Scene": f"26'h{build.word:07x}"}


def ray_library(build: Build, flags: Sequence[str]) -> Path:
    """Return the ray tracer's library for a build, compiled at first use."""
    name, macro = f"rays-{build.grid}-{build.model}-{build.fraction_bits}", f"-DLIPPMANN_NEAR={build.near}"
    return _compiled(name, "batch.cpp", "lipp_ray_stream", optics_parameters(build), [*flags, macro])


def _compiled(name: str, driver: str, module: str, values: Mapping[str, int | str], flags: list[str]) -> Path:
    top = hardware()
    sources, main = needed(module, rtl_sources(top)), top / "sim" / "batch" / driver

    def make(path: Path) -> None:
        verilated(path, module, sources, [main], values, options=UNCHECKED, flags=flags)

    inputs: list[Path | str] = [*sources, main, repr(values), *flags, Path(__file__)]
    return cached_file(build_folder() / "sim" / name, inputs, make, ".so")


def _in_256ths(*chances: float) -> list[int]:
    return [min(round(chance * 256.0), 255) for chance in chances]  # at 256, no ray would pass
