"""Times pictures of a rotating scene (`tools.bench live`), and films by two workers (`tools.bench animate`)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lippmann.base.variant import current_device
from lippmann.display.description import load_display
from lippmann.motion.film import load_film
from lippmann.motion.film_frames import FramePlan, choose_shading, plan_film
from lippmann.motion.live_picture import MAX_SAMPLES, LivePicture
from lippmann.motion.live_windows import Hand
from lippmann.optics.rays import Model
from lippmann.rendering.executors import local_workers, render_on_cluster
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.sinks import bands_of_plan, render_picture
from lippmann.scenes.scene import Scene, load_scene

from tools.renderer_speed import gpu_name

#: `tools.bench live`: displays, keyed by device; lens models; number of steps of a rotation.
DISPLAYS = {"llvm": ("vga-square",), "cuda": ("vga-square", "uhd-4k")}
MODELS: tuple[Model, ...] = ("pinhole", "exact")
STEPS = 72
WORKERS = 2
#: Cases of `tools.bench animate`: display, film's scale, number of frames.
CASES = (("vga-square", 0.25, 24), ("paper-square", 1.0, 4))


def measure_live(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield rows for each display and model: with a ray per pixel, and with a ray per block as in `lippmann live`."""
    device = current_device()
    scene = load_scene(scenes / "fish/fish.xml")
    for name in DISPLAYS[device]:
        display = load_display(scenes / f"displays/{name}.toml")
        for model in MODELS:
            what = {"what": f"fish, {name}, {model}", "gpu": gpu_name() if device == "cuda" else ""}
            fine = LivePicture(scene, display, model, Settings(seed=seed), block=1)
            yield {**what, "block": 1, **_turn(fine, scene), "refined_seconds": _refine(fine)}
            coarse = LivePicture(scene, display, model, Settings(seed=seed))
            if coarse.block > 1:
                yield {**what, "block": coarse.block, **_turn(coarse, scene), "refined_seconds": None}


def _turn(picture: LivePicture, scene: Scene) -> dict[str, float]:
    """Rotate the scene once about the vertical axis; return frames per second and the slowest frame's seconds."""
    hand = Hand(scene.placement, picture.middle_mm, drag_mm=1.0)
    times = []
    for _ in range(STEPS):
        hand.turn(360.0 / STEPS)
        began = time.perf_counter()
        picture.quick(hand.placement())
        picture.values  # noqa: B018 - computed when read
        times.append(time.perf_counter() - began)
    return {"frames_per_second": 1.0 / float(np.median(times)), "slowest_seconds": max(times)}


def _refine(picture: LivePicture) -> float:
    """Return the seconds until a still picture has all samples, if each pass is shown."""
    began = time.perf_counter()
    while picture.samples < MAX_SAMPLES:
        picture.finer(lambda: False)
        picture.values  # noqa: B018 - computed when read
    return time.perf_counter() - began


def measure_animate(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Time the shipped film in one process and with workers, after compilation; CPU seconds are of all threads."""
    from distributed import Client

    film = load_film(scenes / "films/swim.toml")
    device = current_device()
    with local_workers(WORKERS) as (address, security), Client(address, security=security) as client:
        for name, scale, frames in CASES:
            display = load_display(scenes / f"displays/{name}.toml")
            options = RenderOptions(settings=Settings(samples=4, seed=seed))
            plans = choose_shading(plan_film(film, display, options, scale))[:frames]
            # This render loads the scene and compiles the programs, in this process and on every worker.
            render_picture(plans[0])
            client.run(_warm, device, plans[0])
            started, cpu = time.perf_counter(), time.process_time()
            ours = [render_picture(plan).radiance for plan in plans]
            one, one_cpu = time.perf_counter() - started, time.process_time() - cpu
            started, cpu = time.perf_counter(), _cpu_seconds(client)
            theirs = {plan.frame: np.empty_like(ours[0]) for plan in plans}
            bands = [band for plan in plans for band in bands_of_plan(plan)]
            for band, radiance, *_ in render_on_cluster(address, device, bands, security):
                assert isinstance(band.plan, FramePlan)
                theirs[band.plan.frame][band.rows.start : band.rows.stop] = radiance
            many, many_cpu = time.perf_counter() - started, _cpu_seconds(client) - cpu
            differ = sum(int((ours[k] != theirs[k]).any(axis=2).sum()) for k in range(frames))
            size = {"width_px": display.panel.width_px, "height_px": display.panel.height_px}
            alone = {"one_seconds": one, "one_cpu_seconds": one_cpu}
            workers = {"workers": WORKERS, "workers_seconds": many, "workers_cpu_seconds": many_cpu}
            compared = {"pixels_differ": differ, "ratio": many / one}
            yield {"display": name, "frames": frames, **size, **alone, **workers, **compared}


def _cpu_seconds(client: Any) -> float:
    return time.process_time() + float(sum(client.run(time.process_time).values()))


def _warm(device: str, plan: FramePlan) -> None:
    """Render a frame on a worker, so that the worker's programs are compiled."""
    from lippmann.base.variant import start_mitsuba

    start_mitsuba(device)
    render_picture(plan)
