"""The batch harness of the drawing: its RTL under Verilator, exit rays in, pixels out (sim/batch/draw.cpp)."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.errors import LippmannError
from lippmann.fixed.ray_pipeline import FixedRays
from lippmann.fixed.scene_build import CURVE_SLOT, SceneBuild
from lippmann.fixed.scene_pipeline import SceneWords
from lippmann.simulation.compilation import FAST, UNCHECKED, kept, verilated
from lippmann.simulation.toolchain import build_folder, hardware, needed, rtl_sources

Bytes = npt.NDArray[np.uint8]

#: The C++ around the model.
MAIN = Path("sim", "batch", "draw.cpp")
#: 32-bit words of `scene_config_t`.
_CONFIG_WORDS = 69


class SceneHarness:
    """A build of the drawing for F fraction bits, compiled with some of the compiler's flags, as one running model.

    What is loaded into its slots stays. Raises as `verilated`.
    """

    def __init__(self, build: SceneBuild, f: int, flags: Sequence[str] = FAST) -> None:
        self.build = build
        self._library = ctypes.CDLL(str(_compiled(build, f, flags)))
        pointer, number = ctypes.c_void_p, ctypes.c_int64
        calls = {
            "new": (pointer, []),
            "delete": (None, [pointer]),
            "load": (None, [pointer, ctypes.c_int, number, pointer]),
            "draw": (
                number,
                [pointer, number, number, *[pointer] * 3, ctypes.c_uint64, *[ctypes.c_uint32] * 2, ctypes.c_int, number,
                 pointer],
            ),
        }  # fmt: skip
        for name, (result, arguments) in calls.items():
            call = getattr(self._library, f"lippmann_scene_{name}")
            call.restype, call.argtypes = result, arguments
        self._model = self._library.lippmann_scene_new()
        self._held: dict[int, bytes] = {}
        #: Clocks that the last frame took.
        self.clocks = 0

    def __del__(self) -> None:
        """End the model."""
        if hasattr(self, "_model"):
            self._library.lippmann_scene_delete(self._model)

    def load(self, slot: int, content: Bytes) -> None:
        """Write a slot, or the panel's curve (slot 15), one byte a clock."""
        held = np.ascontiguousarray(content, np.uint8)
        self._library.lippmann_scene_load(self._model, slot, len(held), held.ctypes.data)
        self._held[slot] = held.tobytes()

    def hold(self, slot: int, content: Bytes) -> None:
        """Write a slot, or the panel's curve, unless it is what was written there last."""
        if self._held.get(slot) != content.tobytes():
            self.load(slot, content)

    def draw(
        self, rays: FixedRays, words: SceneWords, seed: int = 0, idle: float = 0.0, stall: float = 0.0,
        meanwhile: tuple[int, Bytes] | None = None,
    ) -> Bytes:  # fmt: skip
        """Draw a frame of exit rays; returns its pixels (N, 3).

        `idle` and `stall` are the chances of a pause at the input and at the output in each clock. `meanwhile` is a
        slot and what is loaded into it while the frame is drawn. Raises LippmannError when pixels stop coming out, or
        the marks of the frame's first and last pixel are wrong.
        """
        packed = np.stack([np.asarray(word, np.int64) for word in rays])
        out = np.empty((len(rays.i) // self.build.samples, 3), np.uint8)
        registers = np.frombuffer(words.bits.to_bytes(4 * _CONFIG_WORDS, "little"), np.uint32)
        slot, loaded = (-1, np.zeros(0, np.uint8)) if meanwhile is None else meanwhile
        loaded = np.ascontiguousarray(loaded, np.uint8)
        self._held.pop(slot, None)
        # In 256ths; 1 would never let a ray pass.
        chances = (min(round(chance * 256.0), 255) for chance in (idle, stall))
        pointers = packed.ctypes.data, registers.ctypes.data, out.ctypes.data
        self.clocks = self._library.lippmann_scene_draw(
            self._model, len(rays.i), len(out), *pointers, seed, *chances, slot, len(loaded), loaded.ctypes.data
        )
        if self.clocks < 0:
            why = "gives no more pixels" if self.clocks == -1 else "marks a wrong pixel as the frame's first or last"
            raise LippmannError(f"the simulated drawing {why}; run the RTL's tests, make test")
        return out


def rtl_scene(
    rays: FixedRays, words: SceneWords, slots: Mapping[int, Bytes], table: Bytes, build: SceneBuild, f: int
) -> Bytes:
    """Draw through the RTL, in the place of `lippmann.fixed.scene_pipeline.scene`.

    Threads may call it at once: each call has a model of its own, and the models are kept with what they hold, since a
    load takes longer than some rows.
    """
    models = _models.setdefault((build, f), [])
    try:
        harness = models.pop()
    except IndexError:  # all are at work
        harness = SceneHarness(build, f)
    for slot, content in {**slots, CURVE_SLOT: table}.items():
        harness.hold(slot, content)
    drawn = harness.draw(rays, words)
    models.append(harness)  # not after an error
    return drawn


#: Models that are not at work, by their build and its fraction bits.
_models: dict[tuple[SceneBuild, int], list[SceneHarness]] = {}


def scene_parameters(build: SceneBuild, f: int) -> dict[str, str | int]:
    """Return the RTL's parameters of a build."""
    return {"F": f, "Scene": f"26'h{build.word:07x}"}


def _compiled(build: SceneBuild, f: int, flags: Sequence[str]) -> Path:
    """Return the library of a build, compiled unless it is there."""
    top = hardware()
    sources = needed("lipp_scene", rtl_sources(top, "common", "math", "optics", "scene"))
    flags = [*flags, f"-DLIPPMANN_F={f}"]
    values = scene_parameters(build, f)

    def make(path: Path) -> None:
        verilated(path, "lipp_scene", sources, [top / MAIN], values, options=UNCHECKED, flags=flags)

    inputs: list[Path | str] = [*sources, top / MAIN, repr(values), *flags, Path(__file__)]
    return kept(build_folder() / "sim" / f"scene-{build.layers}-{f}", inputs, make, ".so")
