"""Compares Lippmann's and POV-Ray's pictures and times of one scene through the same optics (`tools.bench peers`).

The pictures have one ray per pixel, through its centre. The times are for a scene with five lights. POV-Ray
anti-aliases it with threshold 0.3; Lippmann renders it with no more noise. Noise is the rms difference from a picture
of many samples, in 8-bit sRGB levels.
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

#: Sides, px, of the windows whose pictures are compared, and of the timed window.
PICTURE_PX, TIME_PX = 600, 2400
#: Samples per pixel of the noise's reference picture; numbers of samples per pixel that are tried.
REFERENCE_SAMPLES = 256
TRIED_SAMPLES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24, 32)
#: Differences up to this level (8-bit sRGB) do not count.
THRESHOLD = 2.0
#: Noise is measured in one of every sixteen strips of eight rows.
EVERY_STRIP, STRIP_ROWS = 16, 8
#: Displacements of rays to find outlines near a ray: distances, px, and number of directions.
OUTLINE_PX, OUTLINE_DIRECTIONS = (0.1, 0.25, 0.5), 16
#: Side, px, of the part of the pictures that the page shows, and the difference that is white in its maps.
SHOWN_PX, MAP_WHITE = 300, 32.0
#: Number of repeats of each timing of a complete process.
WHOLE_ROUNDS = 3
WORK = Path("out/peers")

Mask = npt.NDArray[np.bool_]


def shifted(source: RaySource, shift_px: tuple[float, float]) -> RaySource:
    """Return the picture's rays, displaced by `shift_px`."""
    mi = mitsuba()
    import drjit as dr

    # Make the shifts opaque to Dr.Jit, because each literal would compile a new program.
    du, dv = (dr.opaque(mi.Float, shift) for shift in shift_px)

    def lines(b: Any, u: Any, v: Any, square: Any) -> Lines:
        return source.lines(b, u + b.double(du), v + b.double(dv), square)

    return replace(source, lines=lines, owner=None)


def around(scene: Scene, source: RaySource, distances_px: Sequence[float] = OUTLINE_PX) -> npt.NDArray[np.float32]:
    """Render rays displaced from the pixel centres; return radiance (distances, directions, height, width, 3)."""

    def render(distance: float, direction: int) -> Radiance:
        angle = math.tau * direction / OUTLINE_DIRECTIONS
        shift = (distance * math.cos(angle), distance * math.sin(angle))
        return render_rays(scene, shifted(source, shift), Settings(shading="each")).radiance

    return np.stack([[render(px, k) for k in range(OUTLINE_DIRECTIONS)] for px in distances_px])


def compare(
    theirs: Radiance, ours: Radiance, surroundings: npt.NDArray[np.float32], setup: Setup
) -> tuple[dict[str, Any], npt.NDArray[np.float32]]:
    """Compare POV-Ray's picture with ours; return the row of differences and the map of differences.

    `surroundings` is the result of `around` for our picture. A difference is the maximum over the colours, in 8-bit
    sRGB levels. `differing` is the fraction of pixels above THRESHOLD. Fractions of the differing pixels are:
    `displaced`, if each value is in the range of the other picture's up to a pixel away; `outlines`, if POV-Ray's value
    is in the range of ours up to 0.1 px away; `near_outlines`, 0.5 px; `seams`, within a pixel of a lenslet's edge, or
    with a lost ray. `unexplained` is the fraction of all pixels that differ for none of these reasons.
    """
    a, b = (255.0 * encode(picture, "srgb") for picture in (theirs, ours))
    difference = np.abs(a - b).max(axis=-1)
    differs = difference > THRESHOLD
    displaced = differs & _among_neighbours(a, b) & _among_neighbours(b, a)

    def outlines(distances: int) -> Mask:
        near = 255.0 * encode(np.concatenate([ours[None], *surroundings[:distances]]), "srgb")
        return np.asarray(differs & _within(a, near.min(axis=0), near.max(axis=0)))

    nearest, near = outlines(1), outlines(len(surroundings))
    seams = differs & near_seams(setup)
    count = max(1, int(differs.sum()))
    kinds = {"displaced": displaced, "outlines": nearest, "near_outlines": near, "seams": seams}
    row = {"grid": setup.array.grid, "pixels": difference.size, "median": float(np.median(difference))}
    row |= {"mean": float(difference.mean()), "largest": float(difference.max()), "differing": float(differs.mean())}
    row |= {name: float(mask.sum()) / count for name, mask in kinds.items()}
    return {**row, "unexplained": float((differs & ~displaced & ~near & ~seams).mean())}, difference


def _among_neighbours(a: Radiance, b: Radiance) -> Mask:
    """Return which values of `a` are, within THRESHOLD, in the range of b's values up to one pixel away."""
    low, high = (extreme(b, (3, 3, 1), mode="nearest") for extreme in (ndimage.minimum_filter, ndimage.maximum_filter))
    return _within(a, low, high)


def _within(a: Radiance, low: Radiance, high: Radiance) -> Mask:
    return np.asarray(((a >= low - THRESHOLD) & (a <= high + THRESHOLD)).all(axis=-1))


def near_seams(setup: Setup) -> Mask:
    """Return which pixels are within a pixel of a lenslet's edge, or have a lost ray."""
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
    """Two compared pictures: row of differences, POV-Ray's picture, ours, map of 8-bit differences (height, width)."""

    row: Mapping[str, Any]
    theirs: Radiance
    ours: Radiance
    where: Radiance


def compare_pictures(scenes: Path, work: Path) -> list[Pair]:
    """Render the diffuse scene with both programs for each grid; compare the pictures."""
    pairs = []
    for grid, name in SETUPS.items():
        setup = load_setup(scenes / f"setups/{name}.toml")
        setup = with_window(setup, PICTURE_PX, setup.array.pitches_mm[0])
        scene = load_for(scenes / "seed/diffuse.xml", setup)
        theirs, _ = render_folder_once(write_folder(scene, setup_view(setup), work / f"picture-{grid}"))
        source = capture_source(setup)
        ours = render_rays(scene, source, Settings(shading="each")).radiance
        row, where = compare(theirs, ours, around(scene, source), setup)
        pairs.append(Pair(row, theirs, ours, where))
    return pairs


def noise_of(picture: Radiance, reference: Radiance) -> float:
    """Return the rms difference from the reference, in 8-bit sRGB levels."""
    return float(255.0 * np.sqrt(np.mean((encode(picture, "srgb") - encode(reference, "srgb")) ** 2)))


def samples_for(scene: Scene, setup: Setup, theirs: Radiance) -> tuple[int, float, float]:
    """Return the fewest samples with at most POV-Ray's noise, then POV-Ray's noise and ours."""

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
    """Time both programs at equal noise on the scene with five lights, 2400 x 2400 pixels behind lenslets of 1 mm.

    `povray` is POV-Ray's run; `seconds` (wall clock), `cpu_seconds` (of all threads) and `samples` per pixel are
    Lippmann's. `whole` has the median wall-clock times of complete processes; `ratio` is POV-Ray's CPU seconds divided
    by Lippmann's.
    """
    setup = load_setup(scenes / f"setups/{SETUPS['square']}.toml")
    setup = with_window(setup, TIME_PX, 1.0)
    scene = load_for(scenes / "seed/full.xml", setup)
    exported = write_folder(scene, setup_view(setup), work / "time")
    theirs, run = render_folder_once(exported, *ANTIALIAS)
    samples, allowed, noise = samples_for(scene, setup, theirs)
    ours = fastest(scene, capture_source(setup), samples)
    times = in_turn(_processes(scenes, exported, samples), WHOLE_ROUNDS)
    row = {"povray": asdict(run), "seconds": ours.seconds, "cpu_seconds": ours.cpu_seconds, "samples": samples}
    row |= {"povray_noise": allowed, "noise": noise}
    medians = {name: float(np.median(seconds)) for name, seconds in times.items()}
    return {**row, "whole": medians, "ratio": run.cpu_seconds / ours.cpu_seconds}


def _processes(scenes: Path, exported: Exported, samples: int) -> dict[str, Callable[[], float]]:
    """Return functions that run a complete process and return its seconds."""
    setup, scene = scenes / f"setups/{SETUPS['square']}.toml", scenes / "seed/full.xml"
    words = [sys.executable, "-m", "lippmann", "capture", str(scene), "--setup", str(setup), "--samples", str(samples)]

    def capture(shading: str) -> float:
        with TemporaryDirectory() as folder:
            started = time.perf_counter()
            command = [*words, "--shading", shading, "-o", f"{folder}/full.exr"]
            subprocess.run(command, check=True, capture_output=True)
            return time.perf_counter() - started

    captures = {shading: partial(capture, shading) for shading in ("each", "auto")}
    return {"POV-Ray": lambda: render_folder(exported, *ANTIALIAS)[1].seconds, **captures}


def draw_pair(pair: Pair) -> Plot:
    """Draw the middle parts of both pictures and of their map of differences side by side."""
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
    """Return the page of `tools.bench peers`."""
    rows = [pair.row for pair in pairs]
    context = {"rows": rows, "times": times, "constants": sys.modules[__name__]}
    return make_page("peers", origin, [draw_pair(pair) for pair in pairs], {"peers": rows}, context)


@measurement(page="peers")
def peers(bench: MeasurementRun) -> tuple[Mapping[str, Any], Page]:
    """Compare Lippmann's pictures and times with POV-Ray's. POV-Ray's pictures are cached in out/peers.

    Example: python -m tools.bench peers
    """
    POVRAY.path()
    WORK.mkdir(parents=True, exist_ok=True)
    pairs, times = compare_pictures(bench.scenes, WORK), compare_times(bench.scenes, WORK)
    json = {"pictures": [pair.row for pair in pairs], "times": times}
    return json, page(bench.origin, pairs, times)
