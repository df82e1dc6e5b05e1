"""`make peers`: Lippmann beside POV-Ray, the same scene through the same optics; time and picture.

The picture: the diffuse scene without anti-aliasing, one ray for each pixel's centre in both. The time: the scene of
five lights, anti-aliased by POV-Ray with threshold 0.3, by us with as many samples as leave no more noise. Noise is the
root mean square difference, in sRGB of 8 bits, from a picture of many samples.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.capturing.rays import CaptureSource, lines_of, rays_from_picture
from lippmann.capturing.setup import Setup, load_setup
from lippmann.dev.seed import ANTIALIAS, SETUPS, load_for, render_source, with_window
from lippmann.images import encode, write_picture
from lippmann.optics.backend import DrJitBackend, NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.panel import PanelFrame
from lippmann.povray.export import write_folder
from lippmann.povray.optics import setup_view
from lippmann.povray.program import Run
from lippmann.rendering.renderer import Settings, render_rays
from lippmann.rendering.scene import Scene
from lippmann.rendering.sources import Lines
from lippmann.report.tables import table
from lippmann.variant import current_device, mitsuba

#: Side of the windows whose pictures are compared, px.
PICTURE_PX = 600
#: Side of the window that is timed, and its scene.
TIME_PX = 2400
#: Samples of the picture that noise is measured against, and numbers of samples that are tried.
REFERENCE_SAMPLES = 256
TRIED_SAMPLES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24, 32)
#: Differences that are called so, of 255.
THRESHOLD = 2.0
#: Noise is measured in one row of so many.
EVERY_ROW = 16
#: How far rays are moved to see whether they pass an outline, px, and in how many directions: near ones, and all that
#: lie within a pixel's width.
OUTLINE_PX = (0.1, 0.25, 0.5)
OUTLINE_DIRECTIONS = 16
#: How much of the pictures the report shows, px, and the difference that its maps show white.
SHOWN_PX = 300
MAP_WHITE = 32.0

Image = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class PictureDifference:
    """How two pictures differ, in sRGB of 8 bits, the largest of a pixel's three colours.

    Attributes
    ----------
    grid, pixels
        Which set-up, and how many pixels.
    median, mean, largest
        Of the absolute difference.
    differing
        Share of pixels above THRESHOLD.
    displaced
        Share of those that a shift by one pixel explains: each value lies among the other picture's next to it.
    outlines, near_outlines
        Share of those whose ray passes an outline: POV-Ray's value lies among ours a tenth of a pixel around, or half
        a pixel.
    seams
        Share of those that look past a lenslet's edge: within a pixel of it, or lost in ours.
    unexplained
        Share of all pixels that differ for another reason.
    """

    grid: str
    pixels: int
    median: float
    mean: float
    largest: float
    differing: float
    displaced: float
    outlines: float
    near_outlines: float
    seams: float
    unexplained: float


@dataclass(frozen=True)
class Shifted:
    """A capture's rays through points beside its pixels' centres: one sample, moved by `shift_px`."""

    source: CaptureSource
    shift_px: tuple[float, float]
    stripes: None = None

    @property
    def width_px(self) -> int:
        """Picture's width."""
        return self.source.width_px

    @property
    def height_px(self) -> int:
        """Picture's height."""
        return self.source.height_px

    def lines(self, pixel: Any, sample: Any, stripe: tuple[Any, float]) -> Lines:
        """Return the lines of sight (see `RaySource`)."""
        mi = mitsuba()
        import drjit as dr

        b = DrJitBackend(self.source.device)
        row = pixel // self.width_px
        column = pixel - row * self.width_px
        # Opaque: a literal would be compiled in, each time anew.
        du, dv = (b.double(dr.opaque(mi.Float, 0.5 + shift)) for shift in self.shift_px)
        return lines_of(rays_from_picture(b, self.source.setup, b.double(column) + du, b.double(row) + dv))


@dataclass(frozen=True)
class Rows:
    """Every so many rows of a capture's picture, from the middle of the first so many on."""

    source: CaptureSource
    every: int = EVERY_ROW
    stripes: None = None

    @property
    def width_px(self) -> int:
        """Picture's width."""
        return self.source.width_px

    @property
    def height_px(self) -> int:
        """Rows that are taken."""
        return self.source.height_px // self.every

    def lines(self, pixel: Any, sample: Any, stripe: tuple[Any, float]) -> Lines:
        """Return the lines of sight of the whole picture's own samples (see `RaySource`)."""
        row = pixel // self.width_px
        whole = pixel + (row * (self.every - 1) + self.every // 2) * self.width_px
        return self.source.lines(whole, sample, stripe)


def around(scene: Scene, source: CaptureSource, distances_px: Sequence[float] = OUTLINE_PX) -> npt.NDArray[np.float32]:
    """Render our picture along rays beside the centres; (distances, directions, height, width, 3)."""

    def beside(distance: float, direction: int) -> Image:
        angle = math.tau * direction / OUTLINE_DIRECTIONS
        shift = (distance * math.cos(angle), distance * math.sin(angle))
        return render_rays(scene, Shifted(source, shift), Settings()).radiance

    return np.stack([[beside(px, k) for k in range(OUTLINE_DIRECTIONS)] for px in distances_px])


def compare(
    theirs: Image, ours: Image, beside: npt.NDArray[np.float32], setup: Setup
) -> tuple[PictureDifference, npt.NDArray[np.float32]]:
    """Return how POV-Ray's picture differs from ours, and the map of the differences; `beside` is `around`'s."""
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
    return (
        PictureDifference(
            setup.array.grid,
            difference.size,
            float(np.median(difference)),
            float(difference.mean()),
            float(difference.max()),
            float(differs.mean()),
            float(displaced.sum()) / count,
            float(nearest.sum()) / count,
            float(near.sum()) / count,
            float(seams.sum()) / count,
            float((differs & ~displaced & ~near & ~seams).mean()),
        ),
        difference,
    )


def _among_neighbours(a: Image, b: Image) -> Mask:
    """Tell which values of a lie between those of b one pixel around, to within THRESHOLD."""
    padded = np.pad(b, ((1, 1), (1, 1), (0, 0)), mode="edge")
    height, width = b.shape[:2]
    close = np.stack([padded[i : i + height, j : j + width] for i in range(3) for j in range(3)])
    return _within(a, close.min(axis=0), close.max(axis=0))


def _within(a: Image, low: Image, high: Image) -> Mask:
    """Tell which colours lie in a range, to within THRESHOLD."""
    return np.asarray(((a >= low - THRESHOLD) & (a <= high + THRESHOLD)).all(axis=-1))


def near_seams(setup: Setup) -> Mask:
    """Tell which pixels look within a pixel of a lenslet's edge, or along a ray that is lost."""
    panel = setup.display.panel
    row, column = np.mgrid[0 : panel.height_px, 0 : panel.width_px]
    u, v = column.ravel() + 0.5, row.ravel() + 0.5
    frame = PanelFrame.of(setup.captured)
    lattice = Lattice(setup.array.grid, setup.array.pitch_mm)
    _, _, x, y = lattice.locate(NumpyBackend(), *frame.array_from_panel(*frame.panel_from_pixel(u, v)))
    to_edge = np.min([0.5 * lattice.pitch_mm - np.abs(ax * x + ay * y) for ax, ay in lattice.axes], axis=0)
    rays = rays_from_picture(NumpyBackend(), setup, u, v)
    lost = ~(rays.through_array & rays.through_lens)
    return np.asarray((to_edge <= panel.pixel_pitch_mm) | lost).reshape(panel.height_px, panel.width_px)


@dataclass(frozen=True)
class TimeAtNoise:
    """Times at the same noise.

    Attributes
    ----------
    povray
        POV-Ray's run.
    seconds, cpu_seconds
        Ours: wall clock and CPU of all threads.
    samples
        Of each of our pixels.
    povray_noise, noise
        POV-Ray's and ours, of 255.
    """

    povray: Run
    seconds: float
    cpu_seconds: float
    samples: int
    povray_noise: float
    noise: float

    @property
    def ratio(self) -> float:
        """POV-Ray's CPU seconds over ours."""
        return self.povray.cpu_seconds / self.cpu_seconds


@dataclass(frozen=True)
class Pair:
    """POV-Ray's picture and ours, how they differ, and where: (height, width), of 255."""

    difference: PictureDifference
    theirs: Image
    ours: Image
    where: Image


def compare_pictures(scenes: Path, work: Path) -> list[Pair]:
    """Render the diffuse scene by both for each grid."""
    found = []
    for grid, name in SETUPS.items():
        setup = load_setup(scenes / f"setups/{name}.toml")
        setup = with_window(setup, PICTURE_PX, setup.array.pitch_mm)
        scene = load_for(scenes / "seed/diffuse.xml", setup)
        theirs, _ = write_folder(scene, setup_view(setup), work / f"picture-{grid}").render_once()
        source = CaptureSource(setup, 1, "chief", 0, current_device())
        ours = render_rays(scene, source, Settings()).radiance
        difference, where = compare(theirs, ours, around(scene, source), setup)
        found.append(Pair(difference, theirs, ours, where))
    return found


def noise_of(picture: Image, reference: Image) -> float:
    """Return the root mean square difference in sRGB of 8 bits."""
    return float(255.0 * np.sqrt(np.mean((encode(picture, "srgb") - encode(reference, "srgb")) ** 2)))


def samples_for(scene: Scene, setup: Setup, theirs: Image) -> tuple[int, float, float]:
    """Find how many of our samples leave no more noise than POV-Ray's picture has; returns both noises too."""

    def rows(samples: int, seed: int) -> Image:
        source = Rows(CaptureSource(setup, samples, "chief", seed, current_device()))
        return render_rays(scene, source, Settings(samples=samples, seed=seed)).radiance

    reference = rows(REFERENCE_SAMPLES, 1)
    allowed = noise_of(theirs[EVERY_ROW // 2 :: EVERY_ROW], reference)
    for samples in TRIED_SAMPLES:
        noise = noise_of(rows(samples, 0), reference)
        if noise <= allowed:
            break
    return samples, allowed, noise


def compare_times(scenes: Path, work: Path) -> TimeAtNoise:
    """Time the scene of five lights at the same noise, 2400 x 2400 pixels through lenslets of 1 mm."""
    setup = load_setup(scenes / f"setups/{SETUPS['square']}.toml")
    setup = with_window(setup, TIME_PX, 1.0)
    scene = load_for(scenes / "seed/full.xml", setup)
    theirs, run = write_folder(scene, setup_view(setup), work / "time").render_once(*ANTIALIAS)
    samples, allowed, noise = samples_for(scene, setup, theirs)
    source = CaptureSource(setup, samples, "chief", 0, current_device())
    seconds, cpu = render_source(scene, source, samples)
    return TimeAtNoise(run, seconds, cpu, samples, allowed, noise)


def write_pictures(folder: Path, pairs: Sequence[Pair]) -> None:
    """Write the middle of both pictures and the map of their differences, side by side, as `peers-GRID.png`."""
    for pair in pairs:
        height, width = pair.where.shape
        side = min(SHOWN_PX, height, width)
        middle = (slice((height - side) // 2, (height + side) // 2), slice((width - side) // 2, (width + side) // 2))
        shade = np.repeat(np.minimum(pair.where[middle] / MAP_WHITE, 1.0)[..., None], 3, axis=2)
        white = np.ones((side, 6, 3))
        row = [encode(pair.theirs[middle], "srgb"), white, encode(pair.ours[middle], "srgb"), white, shade]
        # All of it is encoded: "linear" writes values as they are.
        path = folder / f"peers-{pair.difference.grid}.png"
        write_picture(path, np.concatenate(row, axis=1), {"shows": "POV-Ray, Lippmann, difference"}, "linear")


def report_text(pairs: Sequence[Pair], times: TimeAtNoise) -> str:
    """Return the page."""
    rows = [dataclasses.asdict(pair.difference) for pair in pairs]
    shown = "".join(f"![{row['grid']}: POV-Ray, Lippmann, map](peers-{row['grid']}.png)\n\n" for row in rows)
    export = "    lippmann export povray scenes/seed/{scene}.xml --setup scenes/setups/{setup}.toml -o out/pov\n"
    commands = "".join(export.format(scene="diffuse", setup=SETUPS[row["grid"]]) for row in rows)
    timed: dict[str, list[Any]] = {
        "tracer": ["POV-Ray 3.7", "Lippmann"],
        "noise, of 255": [times.povray_noise, times.noise],
        "CPU seconds": [times.povray.cpu_seconds, times.cpu_seconds],
        "wall seconds": [times.povray.seconds, times.seconds],
    }
    return f"""# Beside POV-Ray

The founding paper's method, optics as objects of a general ray tracer, and ours: the same scene, imaging lens, lenslets
and camera.

## The picture

`scenes/seed/diffuse.xml`, point lights, one ray for each pixel's centre in both, a window of {PICTURE_PX} x
{PICTURE_PX} px. Differences are in sRGB of 8 bits, the largest of a pixel's three colours; `differing` is the share of
pixels above {THRESHOLD:g}. Of those, `displaced` lie among the other picture's values one pixel around (edges within a
pixel); of `outlines` the ray passes an outline, so that our colours a tenth of a pixel around span POV-Ray's, of
`near_outlines` half a pixel around; `seams` look within a pixel of a lenslet's edge, where POV-Ray's lenslets end in
walls and ours go on, or along rays that are lost; `unexplained` is what none of these holds for, as a share of all
pixels.

{table({key: [row[key] for row in rows] for key in rows[0]})}
Left POV-Ray, in the middle Lippmann, right the map: a difference of {MAP_WHITE:g} or more is white.

{shown}{commands}    cd out/pov && povray diffuse.ini

## The time

`scenes/seed/full.xml`: five lights, four stems, reflecting water; {TIME_PX} x {TIME_PX} px through lenslets of 1 mm.
POV-Ray anti-aliases with threshold 0.3; we take {times.samples} samples a pixel, the fewest tried that leave no more
noise: the root mean square difference, in sRGB of 8 bits, from a picture of {REFERENCE_SAMPLES} samples, in one row of
{EVERY_ROW}. CPU seconds are those of all threads, POV-Ray's with what it takes to read its files; wall-clock times
depend on what else the machine does. POV-Ray's pictures are kept and not rendered again: they may be older than this
page.

{table(timed)}
POV-Ray takes **{times.ratio:.0f} times** our CPU seconds; 100 times is the aim.

{export.format(scene="full", setup=SETUPS["square"])}    cd out/pov && {times.povray.command}
    lippmann capture scenes/seed/full.xml --setup scenes/setups/fig8a.toml --samples {times.samples} -o out/full.exr
"""
