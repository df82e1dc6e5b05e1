"""A function of a scene that Dr.Jit traces once and then launches.

Tracing the program of a render takes Python a tenth of a second, as long as a small picture takes to compute. A frozen
function is traced at its first call, and again only for arguments of other types; their sizes may change.
"""

from __future__ import annotations

import contextlib
import gc
import re
import weakref
from collections.abc import Callable, Iterator
from typing import Any

from lippmann.base.variant import current_device
from lippmann.scenes.scene import Scene

#: A lamp that shows a picture, as Mitsuba writes it: Dr.Jit 1.5 ends the process that replays one on a GPU.
PICTURE = re.compile(r"BitmapTexture|EnvironmentMap")


class Recorded:
    """A function of Dr.Jit values and a scene, recorded at its first call (`drjit.freeze`).

    What changes from call to call must be among its arguments: numbers that it reads elsewhere become part of the
    recording. A function that Dr.Jit cannot record, because of the scene's plugins, is traced at every call.
    """

    def __init__(self, function: Callable[..., Any], scene: Scene) -> None:
        import drjit as dr

        held = _Held(function, scene)

        def call(*arguments: Any) -> Any:
            return held.function(*arguments)

        frozen: Any = dr.freeze(call, state_fn=lambda *_: held.scene.mitsuba)
        self._function, self._frozen = function, frozen
        # Their Python objects belong to what tells one recording from another: made now, not in the first recording.
        self._parts = lamps, _ = scene.mitsuba.emitters(), scene.mitsuba.shapes()
        self._recordable = current_device() != "cuda" or not any(PICTURE.search(str(lamp)) for lamp in lamps)
        weakref.finalize(self, held.release, frozen)

    def __call__(self, *arguments: Any) -> Any:
        """Return what the function returns."""
        if self._recordable:
            with contextlib.suppress(RuntimeError), garbage_kept():
                return self._frozen(*arguments)
            self._recordable = False
        return self._function(*arguments)


class _Held:
    """What a frozen function needs, one step away from it.

    What it refers to itself is compared at each call, and waits for the garbage collector, since Dr.Jit's object is
    part of a cycle. But a scene must go in time: all programs contain the code of every shape and light that is alive.
    """

    def __init__(self, function: Callable[..., Any], scene: Scene) -> None:
        self.function, self.scene = function, scene

    def release(self, frozen: Any) -> None:
        """Let go of all, and of the recordings."""
        del self.function, self.scene
        frozen.clear()


@contextlib.contextmanager
def garbage_kept() -> Iterator[None]:
    """Keep Python from collecting garbage: Dr.Jit ends the process when a scene is freed while it records.

    In a process of several threads it stops for ever when one frees a value of Dr.Jit's while another is in Dr.Jit.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
