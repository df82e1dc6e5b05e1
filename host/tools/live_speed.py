"""Pictures of a scene that turns, and one that rests, as `lippmann live` makes them (`tools.bench live`)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.machine import gpu_name
from lippmann.base.variant import current_device
from lippmann.display.description import load_display
from lippmann.motion.hand import Hand
from lippmann.motion.live_loop import MOST_SAMPLES
from lippmann.motion.live_picture import LivePicture
from lippmann.optics.rays import Model
from lippmann.rendering.renderer import Settings
from lippmann.scenes.scene import Scene, load_scene

#: Displays, the larger one for a GPU; and the steps of a turn, of 5 degrees each.
DISPLAYS = {"llvm": ("vga-square",), "cuda": ("vga-square", "uhd-4k")}
MODELS: tuple[Model, ...] = ("pinhole", "exact")
STEPS = 72


def measure(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield rows for each display and model: a ray for each pixel, and for each block of pixels that live chooses."""
    device = current_device()
    scene = load_scene(scenes / "fish/fish.xml")
    for name in DISPLAYS[device]:
        display = load_display(scenes / f"displays/{name}.toml")
        for model in MODELS:
            what = {"what": f"fish, {name}, {model}", "gpu": gpu_name() if device == "cuda" else ""}
            whole = LivePicture(scene, display, model, Settings(seed=seed), block=1)
            yield {**what, "block": 1, **_turned(whole, scene), "refined_seconds": _refined(whole)}
            chosen = LivePicture(scene, display, model, Settings(seed=seed))
            if chosen.block > 1:
                yield {**what, "block": chosen.block, **_turned(chosen, scene), "refined_seconds": None}


def _turned(picture: LivePicture, scene: Scene) -> dict[str, float]:
    """Return frames a second of a whole turn about the upright axis, and the slowest frame's seconds."""
    hand = Hand(scene.placement, picture.middle_mm, drag_mm=1.0)
    times = []
    for _ in range(STEPS):
        hand.turn(360.0 / STEPS)
        began = time.perf_counter()
        picture.quick(hand.placement())
        picture.values  # noqa: B018 - made on asking
        times.append(time.perf_counter() - began)
    return {"frames_per_second": 1.0 / float(np.median(times)), "slowest_seconds": max(times)}


def _refined(picture: LivePicture) -> float:
    """Return the seconds until a picture that rests has all its samples, each pass shown."""
    began = time.perf_counter()
    while picture.samples < MOST_SAMPLES:
        picture.finer(lambda: False)
        picture.values  # noqa: B018 - made on asking
    return time.perf_counter() - began
