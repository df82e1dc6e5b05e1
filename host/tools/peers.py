"""Lippmann against POV-Ray: picture and time of the same scene through the same optics (`tools.bench peers`).

The picture: the diffuse scene without anti-aliasing, one ray through each pixel's centre in both. The time: the scene
with five lights, anti-aliased by POV-Ray with threshold 0.3, and by Lippmann with enough samples for no more noise.
Noise is the root mean square difference, in 8-bit sRGB levels, from a picture of many samples.
"""

from __future__ import annotations

import io
import math
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from lippmann.base.images import Radiance
from lippmann.base.tones import encode
from lippmann.base.variant import mitsuba
from lippmann.capturing.capture import capture_source, rays_from_picture
from lippmann.capturing.capture_setup import Setup, load_setup
from lippmann.capturing.povray_export import POVRAY, Exported, write_folder
from lippmann.capturing.povray_optics import setup_view
from lippmann.conformance.engine_report import in_turn
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import Plot
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.system import PanelFrame
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_rays
from lippmann.rendering.sampling import Lines, RaySource
from lippmann.scenes.scene import Scene
from PIL import Image as PngImage
from scipy import ndimage

from tools.bench import MeasurementRun, measurement
from tools.povray_runs import render_folder, render_folder_once
from tools.report_plots import make_page
from tools.seed import ANTIALIAS, SETUPS, fastest, load_for, with_window
from tools.shading_speed import every_strip, rows_of_strips

#: Side of the windows whose pictures are compared, px.
PICTURE_PX = 600
#: Side of the window that is timed, px.
TIME_PX = 2400
#: Samples of the reference picture for noise, and numbers of samples that are tried.
REFERENCE_SAMPLES = 256
TRIED_SAMPLES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24, 32)
#: Smaller differences, of 255, do not count.
THRESHOLD = 2.0
#: Noise is measured in every sixteenth strip of eight rows.
EVERY_STRIP, STRIP_ROWS = 16, 8
#: Distances, px, and directions in which rays are moved to find outlines near them.
OUTLINE_PX = (0.1, 0.25, 0.5)
OUTLINE_DIRECTIONS = 16
#: Side of the part of the pictures on the page, px, and the difference that is white on its maps.
SHOWN_PX = 300
MAP_WHITE = 32.0
#: Times that whole processes are timed, in turn.
WHOLE_ROUNDS = 3
#: Where POV-Ray's files and pictures are kept.
WORK = Path("out/peers")

Mask = npt.NDArray[np.bool_]


def shifted(source: RaySource, shift_px: tuple[float, float]) -> RaySource:
    """Return a picture by rays through points beside those of its samples."""
    mi = mitsuba()
    import drjit as dr

    # Opaque: a literal would be compiled in, each time anew.
    du, dv = (dr.opaque(mi.Float, shift) for shift in shift_px)

    def lines(b: Any, u: Any, v: Any, square: Any) -> Lines:
        return source.lines(b, u + b.double(du), v + b.double(dv), square)

    return replace(source, lines=lines, owner=None)


def around(scene: Scene, source: RaySource, distances_px: Sequence[float] = OUTLINE_PX) -> npt.NDArray[np.float32]:
    """Render along rays beside the pixel centres; (distances, directions, height, width, 3)."""

    def beside(distance: float, direction: int) -> Radiance:
        angle = math.tau * direction / OUTLINE_DIRECTIONS
        shift = (distance * math.cos(angle), distance * math.sin(angle))
        return render_rays(scene, shifted(source, shift), Settings(shading="each")).radiance

    return np.stack([[beside(px, k) for k in range(OUTLINE_DIRECTIONS)] for px in distances_px])


def compare(
    theirs: Radiance, ours: Radiance, beside: npt.NDArray[np.float32], setup: Setup
) -> tuple[dict[str, Any], npt.NDArray[np.float32]]:
    """Return the row of differences between POV-Ray's picture and ours, and their map; `beside` comes from `around`.

    They are in 8-bit sRGB levels, of a pixel the largest of its three colours. `differing` is the share of the pixels
    that differ by more than THRESHOLD. Shares of these: `displaced`, where a shift by one pixel explains them, for each
    value lies within the other picture's values around it; `outlines`, whose ray passes an outline, for POV-Ray's value
    lies within ours 0.1 px around, and `near_outlines`, 0.5 px; `seams`, which lie within a pixel of a lenslet's edge,
    or whose ray is lost in Lippmann's picture. `unexplained` is the share of all pixels that differ for another reason.
    """
    a, b = (255.0 * encode(picture, "srgb") for picture in (theirs, ours))
    difference = np.abs(a - b).max(axis=-1)
    differs = difference > THRESHOLD
    displaced = differs & _among_neighbours(a, b) & _among_neighbours(b, a)

    def outlines(distances: int) -> Mask:
        near = 255.0 * encode(np.concatenate([ours[None], *beside[:distances]]), "srgb")
        return np.asarray(differs & _within(a, near.min(axis=0), near.max(axis=0)))

    nearest, near = outlines(1), outlines(len(beside))
    seams = differs & near_seams(setup)
    count = max(1, int(differs.sum()))
    kinds = {"displaced": displaced, "outlines": nearest, "near_outlines": near, "seams": seams}
    row = {
        "grid": setup.array.grid,
        "pixels": difference.size,
        "median": float(np.median(difference)),
        "mean": float(difference.mean()),
        "largest": float(difference.max()),
        "differing": float(differs.mean()),
        **{name: float(mask.sum()) / count for name, mask in kinds.items()},
        "unexplained": float((differs & ~displaced & ~near & ~seams).mean()),
    }
    return row, difference


def _among_neighbours(a: Radiance, b: Radiance) -> Mask:
    """Tell which values of a lie within those of b one pixel around, to THRESHOLD."""
    low, high = (extreme(b, (3, 3, 1), mode="nearest") for extreme in (ndimage.minimum_filter, ndimage.maximum_filter))
    return _within(a, low, high)


def _within(a: Radiance, low: Radiance, high: Radiance) -> Mask:
    """Tell which colours lie in a range, to THRESHOLD."""
    return np.asarray(((a >= low - THRESHOLD) & (a <= high + THRESHOLD)).all(axis=-1))


def near_seams(setup: Setup) -> Mask:
    """Tell which pixels are within a pixel of a lenslet's edge, or have a ray that is lost."""
    panel = setup.display.panel
    row, column = np.mgrid[0 : panel.height_px, 0 : panel.width_px]
    u, v = column.ravel() + 0.5, row.ravel() + 0.5
    frame = PanelFrame.of(setup.captured)
    lattice = Lattice.of(setup.array)
    _, _, x, y = lattice.locate(NumpyBackend(), *frame.array_from_panel(*frame.panel_from_pixel(u, v)))
    to_edge = np.min([lattice.half_mm - np.abs(ax * x + ay * y) for ax, ay in lattice.axes], axis=0)
    rays = rays_from_picture(NumpyBackend(), setup, u, v)
    lost = ~(rays.through_array & rays.through_lens)
    return np.asarray((to_edge <= panel.coarsest_mm) | lost).reshape(panel.height_px, panel.width_px)


class Pair(NamedTuple):
    """POV-Ray's picture and ours, the row of their differences, and the map of these: (height, width), of 255."""

    row: Mapping[str, Any]
    theirs: Radiance
    ours: Radiance
    where: Radiance


def compare_pictures(scenes: Path, work: Path) -> list[Pair]:
    """Render the diffuse scene with both programs, for each grid."""
    found = []
    for grid, name in SETUPS.items():
        setup = load_setup(scenes / f"setups/{name}.toml")
        setup = with_window(setup, PICTURE_PX, setup.array.pitches_mm[0])
        scene = load_for(scenes / "seed/diffuse.xml", setup)
        theirs, _ = render_folder_once(write_folder(scene, setup_view(setup), work / f"picture-{grid}"))
        source = capture_source(setup)
        ours = render_rays(scene, source, Settings(shading="each")).radiance
        row, where = compare(theirs, ours, around(scene, source), setup)
        found.append(Pair(row, theirs, ours, where))
    return found


def noise_of(picture: Radiance, reference: Radiance) -> float:
    """Return the root mean square difference in sRGB of 8 bits."""
    return float(255.0 * np.sqrt(np.mean((encode(picture, "srgb") - encode(reference, "srgb")) ** 2)))


def samples_for(scene: Scene, setup: Setup, theirs: Radiance) -> tuple[int, float, float]:
    """Return the fewest samples with which Lippmann has no more noise than POV-Ray, and the noise of both."""

    def rows(samples: int, seed: int) -> Radiance:
        source = every_strip(capture_source(setup), EVERY_STRIP, STRIP_ROWS)
        return render_rays(scene, source, Settings(samples=samples, seed=seed, shading="each")).radiance

    reference = rows(REFERENCE_SAMPLES, 1)
    allowed = noise_of(theirs[rows_of_strips(len(theirs), EVERY_STRIP, STRIP_ROWS)], reference)
    for samples in TRIED_SAMPLES:
        noise = noise_of(rows(samples, 0), reference)
        if noise <= allowed:
            break
    return samples, allowed, noise


def compare_times(scenes: Path, work: Path) -> dict[str, Any]:
    """Time the scene of five lights at the same noise, 2400 x 2400 pixels through lenslets of 1 mm.

    `povray` is its run; `seconds` (wall clock), `cpu_seconds` (of all threads) and `samples` a pixel are Lippmann's;
    both noises are of 255. `whole` are wall-clock times of whole processes in turn, medians: of POV-Ray, and of
    `capture` by its ways to shade. `ratio` is POV-Ray's CPU seconds over ours.
    """
    setup = load_setup(scenes / f"setups/{SETUPS['square']}.toml")
    setup = with_window(setup, TIME_PX, 1.0)
    scene = load_for(scenes / "seed/full.xml", setup)
    exported = write_folder(scene, setup_view(setup), work / "time")
    theirs, run = render_folder_once(exported, *ANTIALIAS)
    samples, allowed, noise = samples_for(scene, setup, theirs)
    ours = fastest(scene, capture_source(setup), samples)
    times = in_turn(_processes(scenes, exported, samples), WHOLE_ROUNDS)
    return {
        "povray": asdict(run),
        "seconds": ours.seconds,
        "cpu_seconds": ours.cpu_seconds,
        "samples": samples,
        "povray_noise": allowed,
        "noise": noise,
        "whole": {name: float(np.median(seconds)) for name, seconds in times.items()},
        "ratio": run.cpu_seconds / ours.cpu_seconds,
    }


def _processes(scenes: Path, exported: Exported, samples: int) -> dict[str, Callable[[], float]]:
    """Return functions that run whole processes and return their seconds."""

    def captured(shading: str) -> float:
        with TemporaryDirectory() as folder:
            setup = scenes / f"setups/{SETUPS['square']}.toml"
            words = ["capture", str(scenes / "seed/full.xml"), "--setup", str(setup), "--shading", shading]
            started = time.perf_counter()
            subprocess.run(
                [sys.executable, "-m", "lippmann", *words, "--samples", str(samples), "-o", f"{folder}/full.exr"],
                check=True, capture_output=True,
            )  # fmt: skip
            return time.perf_counter() - started

    ways = {shading: partial(captured, shading) for shading in ("each", "auto")}
    return {"POV-Ray": lambda: render_folder(exported, *ANTIALIAS)[1].seconds, **ways}


def shown(pair: Pair) -> Plot:
    """Return the middle of both pictures and of the map of their differences, side by side."""
    height, width = pair.where.shape
    side = min(SHOWN_PX, height, width)
    middle = (slice((height - side) // 2, (height + side) // 2), slice((width - side) // 2, (width + side) // 2))
    shade = np.repeat(np.minimum(pair.where[middle] / MAP_WHITE, 1.0)[..., None], 3, axis=2)
    white = np.ones((side, 6, 3))
    parts = [encode(pair.theirs[middle], "srgb"), white, encode(pair.ours[middle], "srgb"), white, shade]
    out = io.BytesIO()
    PngImage.fromarray(np.rint(255.0 * np.concatenate(parts, axis=1)).astype(np.uint8)).save(out, "png")
    return Plot(f"peers-{pair.row['grid']}", out.getvalue())


def page(origin: Mapping[str, str], pairs: Sequence[Pair], times: Mapping[str, Any]) -> Page:
    """Return the page."""
    rows = [pair.row for pair in pairs]
    context = {"rows": rows, "times": times, "constants": sys.modules[__name__]}
    return make_page("peers", origin, [shown(pair) for pair in pairs], {"peers": rows}, context)


@measurement(page="peers")
def peers(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Compare picture and time with POV-Ray. POV-Ray's pictures are kept in out/peers and not rendered again.

    Example: python -m tools.bench peers
    """
    POVRAY.path()
    WORK.mkdir(parents=True, exist_ok=True)
    pairs, times = compare_pictures(bench.scenes, WORK), compare_times(bench.scenes, WORK)
    json = {"pictures": [pair.row for pair in pairs], "times": times}
    return json, page(bench.origin, pairs, times)
