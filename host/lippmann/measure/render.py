"""`lippmann bench render`: how fast integral images are rendered, and what that depends on.

Each figure is a ratio or a rate of medians over several rounds; what is compared is measured in turn, in one process.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lippmann.display import Display, load_display
from lippmann.errors import LippmannError
from lippmann.rendering.renderer import Settings, make_integrator, render_integral
from lippmann.rendering.scene import Scene, load_scene
from lippmann.variant import current_device, mitsuba

ROUNDS = 3
#: Distance and field of the plain perspective camera that rates are compared with: it sees what the display shows.
CAMERA_MM = 600.0


def _median_seconds(work: Callable[[int], float]) -> float:
    """Return the median over rounds; each round has another seed."""
    return float(np.median([work(number) for number in range(ROUNDS)]))


def with_lenslets_across(display: Display, across: int) -> Display:
    """Return the display with fewer, larger lenslets of the same shape behind the same window."""
    array = display.array
    factor = display.panel.width_mm / (across - 0.4) / array.pitch_mm
    grown = replace(
        array,
        pitch_mm=array.pitch_mm * factor,
        radius_mm=array.radius_mm * factor,
        thickness_mm=array.thickness_mm * factor,
    )
    return replace(display, array=grown, gap_mm=display.gap_mm * factor)


def lenslet_growth(scene: Scene, display: Display, integrator: str, samples: int) -> dict[str, float]:
    """Time the same window behind 102 x 102 lenslets and behind 11 x 11."""
    many, few = display, with_lenslets_across(display, 11)
    seconds: dict[str, list[float]] = {"many": [], "few": []}
    for number in range(ROUNDS):
        settings = Settings(samples=samples, integrator=integrator, seed=number)
        for name, one in (("many", many), ("few", few)):
            seconds[name].append(render_integral(scene, one, "exact", settings).seconds)
    pairs = np.array(seconds["many"]) / np.array(seconds["few"])
    return {
        "seconds_10404_lenslets": float(np.median(seconds["many"])),
        "seconds_121_lenslets": float(np.median(seconds["few"])),
        "ratio": float(np.median(pairs)),
        "ratio_least": float(pairs.min()),
        "ratio_most": float(pairs.max()),
    }


def against_perspective(scene: Scene, display: Display, integrator: str, samples: int) -> dict[str, float]:
    """Time an integral render against Mitsuba's own perspective sensor: same scene, integrator, samples, pixels."""
    mi = mitsuba()
    import drjit as dr

    panel = display.panel
    half_field = np.degrees(np.arctan2(0.5 * panel.width_mm, CAMERA_MM))
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": float(2.0 * half_field),
            "to_world": mi.ScalarTransform4f().look_at([0, 0, CAMERA_MM], [0, 0, 0], [0, 1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": panel.width_px,
                "height": panel.height_px,
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        }
    )
    own = make_integrator(scene, Settings(integrator=integrator))

    def plain(seed: int) -> float:
        started = time.perf_counter()
        image = mi.render(scene.mitsuba, sensor=sensor, integrator=own, spp=samples, seed=seed)
        dr.eval(image)
        dr.sync_thread()
        return time.perf_counter() - started

    def integral(seed: int) -> float:
        settings = Settings(samples=samples, integrator=integrator, seed=seed)
        return render_integral(scene, display, "exact", settings).seconds

    plain(0)  # compiles
    times = np.array([(integral(number), plain(number)) for number in range(ROUNDS)])
    return {
        "integral_seconds": float(np.median(times[:, 0])),
        "perspective_seconds": float(np.median(times[:, 1])),
        "rate_ratio": float(np.median(times[:, 1] / times[:, 0])),
    }


def optics_share(scene: Scene, display: Display, samples: int) -> dict[str, float]:
    """Time the whole render against one whose integrator looks at nothing: what optics and bookkeeping cost."""
    mi = mitsuba()

    base: Any = mi.SamplingIntegrator

    class Nothing(base):  # type: ignore[misc]
        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            # Uses all of the ray, so that none of the optics is left out by the compiler.
            return mi.Spectrum(ray.d.x + ray.d.y + ray.d.z + ray.o.x + ray.o.y), active, []

    mi.register_integrator("nothing", Nothing)

    def timed(integrator: str) -> float:
        return _median_seconds(
            lambda seed: (
                render_integral(
                    scene, display, "exact", Settings(samples=samples, integrator=integrator, seed=seed)
                ).seconds
            )
        )

    whole, optics = timed("lights"), timed("nothing")
    return {"render_seconds": whole, "optics_seconds": optics, "share": optics / whole}


def separately(device: str, scene_path: Path, display_path: Path, samples: int, model: str) -> dict[str, Any]:
    """Render with the command line in a process of its own, whose memory is then the render's alone.

    Raises
    ------
    LippmannError
        When it fails: what it says.
    """
    with TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-m", "lippmann", "render", str(scene_path), "--display", str(display_path)),
            *("--model", model, "--samples", str(samples), "--device", device, "-o", f"{folder}/out.exr", "--json"),
        ]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().splitlines()[-1:]
        raise LippmannError(f"{scene_path} for {display_path}: rendering in a process of its own failed: {said}")
    result: dict[str, Any] = json.loads(done.stdout)
    return {key: result[key] for key in ("seconds", "prepare_seconds", "samples_per_second", "peak_memory_mb")}


def bench_render(scenes: Path, report: Callable[[str, dict[str, Any]], None]) -> None:
    """Measure all rows; `report` is called with each row's name and figures as they come."""
    device = current_device()
    fish, square = scenes / "fish/fish.xml", scenes / "displays/paper-square.toml"
    report("fish, paper-square, exact, 4 samples", separately(device, fish, square, 4, "exact"))
    report(
        "fish, paper-hex, exact, 4 samples", separately(device, fish, scenes / "displays/paper-hex.toml", 4, "exact")
    )
    report("fish, uhd-4k, exact, 1 sample", separately(device, fish, scenes / "displays/uhd-4k.toml", 1, "exact"))
    report("fish, uhd-8k, exact, 1 sample", separately(device, fish, scenes / "displays/uhd-8k.toml", 1, "exact"))
    scene, display = load_scene(fish), load_display(square)
    report("optics' share, fish, lights, 4 samples", optics_share(scene, display, 4))
    for name in ("fish", "chart", "knot"):
        scene = load_scene(scenes / f"{name}/{name}.xml")
        for integrator in ("path", "lights"):
            row = lenslet_growth(scene, display, integrator, 4)
            report(f"10,404 lenslets against 121, {name}, {integrator}, 4 samples", row)
        for integrator in ("path", "direct", "lights"):
            row = against_perspective(scene, display, integrator, 4)
            report(f"against Mitsuba's perspective, {name}, {integrator}, 4 samples", row)
