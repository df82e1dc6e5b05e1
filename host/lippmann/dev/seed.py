"""`lippmann bench seed`: the founding paper's benchmark, its figure 9, by us and by POV-Ray on the same files.

Relative time t_R = t_SR / T (paper, equation 6) over the number of lenslets in the rendered window. T is the tracer's
own time for the base scene: 720 x 720 pixels, 2 lights, 2 stems, anti-aliased with threshold 0.3, no optics. Times are
CPU seconds of all threads: what one core would take, as in 2005, and little moved by what else the machine does.
POV-Ray's hold the parsing of its files; ours are counted without loading and compiling.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.capturing.rays import CaptureSource
from lippmann.capturing.setup import Setup, load_setup
from lippmann.display import MM_PER_INCH, Array, Display
from lippmann.povray.export import export_view, write_folder
from lippmann.povray.optics import setup_view
from lippmann.rendering.renderer import Settings, render_rays
from lippmann.rendering.scene import Scene, load_scene, placement_beside
from lippmann.rendering.sources import PerspectiveSource, RaySource, Window
from lippmann.report.tables import table
from lippmann.variant import current_device

#: Set-ups of the sweep by the grid of their array: the array 6 cm towards the imaging lens (paper, figure 8 a).
SETUPS = {"square": "fig8a", "hex": "hex"}
#: Rendered window sizes, px (at 600 dpi), and lenslet pitches, mm.
WINDOWS_PX = (720, 1200, 1800, 2400, 3600)
PITCHES_MM = (1.0, 2.0, 4.0, 9.0)
#: The largest windows that we render with anti-aliasing, and that POV-Ray renders.
ANTIALIASED_PX, POVRAY_PX = 2400, 720
#: Our samples for each pixel where POV-Ray anti-aliases with threshold 0.3: about its noise (`bench peers`).
SAMPLES = 8
#: How often our quick pictures, those without anti-aliasing, are taken.
ROUNDS = 2
ANTIALIAS = ("+WT2", "+A0.3")
BASE_PX = 720
#: `--quick`: what tests run. Windows as small as these take as long as starting does: they measure nothing.
QUICK: dict[str, Any] = {
    "windows": (48,),
    "pitches": (1.0, 2.0),
    "grids": ("square",),
    "povray_px": 48,
    "base_px": 96,
}
EYE_MM = (0.0, 0.0, 600.0)
#: What the paper says of its own tracer.
PAPER_HEX, PAPER_PLAIN = 0.10, -0.37


@dataclass(frozen=True)
class Timed:
    """One picture's time.

    Attributes
    ----------
    tracer
        "lippmann" or "POV-Ray".
    window_px, pitch_mm, grid
        Side of the square window, and the array; pitch None without one.
    lenslets
        In the window (paper, equation 5; rows of a hexagonal array stand closer).
    antialias
        Whether edges are smoothed.
    seconds, cpu_seconds
        Wall clock and CPU, all threads.
    relative
        CPU seconds over the tracer's own T.
    """

    tracer: str
    grid: str
    window_px: int
    pitch_mm: float | None
    lenslets: int
    antialias: bool
    seconds: float
    cpu_seconds: float
    relative: float


def with_window(setup: Setup, width_px: int, pitch_mm: float) -> Setup:
    """Return a set-up whose camera sees another number of equal pixels, through lenslets scaled to a pitch."""
    panel = dataclasses.replace(setup.display.panel, width_px=width_px, height_px=width_px)

    def scaled(array: Array) -> Array:
        share = pitch_mm / array.pitch_mm
        return dataclasses.replace(
            array,
            pitch_mm=pitch_mm,
            radius_mm=array.radius_mm * share,
            thickness_mm=array.thickness_mm * share,
        )

    display = dataclasses.replace(setup.display, panel=panel, array=scaled(setup.display.array))
    return dataclasses.replace(setup, display=display, array=scaled(setup.array))


def lenslets_in(display: Display) -> int:
    """Return the number of lenslets in the window: N = ceil(25.4 w / (p D))^2 (paper, equation 5)."""
    array, panel = display.array, display.panel
    dpi = MM_PER_INCH / panel.pixel_pitch_mm
    across = math.ceil(MM_PER_INCH * panel.width_px / (array.pitch_mm * dpi) - 1e-9)
    down = math.ceil(MM_PER_INCH * panel.height_px / (array.row_pitch_mm * dpi) - 1e-9)
    return across * down


def load_for(path: Path, setup: Setup) -> Scene:
    """Load a scene as it stands before a set-up."""
    return load_scene(path, placement_beside(path).then(setup.subject.placement))


def render_source(scene: Scene, source: RaySource, samples: int, rounds: int = 1) -> tuple[float, float]:
    """Return wall and CPU seconds of our picture, compiling left out: those of the quickest of some rounds."""
    times = []
    for _ in range(rounds):
        rendered = render_rays(scene, source, Settings(samples=samples))
        times.append((rendered.cpu_seconds, rendered.seconds))
    cpu, seconds = min(times)
    return seconds, cpu


def bench_seed(
    scenes: Path,
    work: Path,
    windows: Sequence[int] = WINDOWS_PX,
    pitches: Sequence[float] = PITCHES_MM,
    grids: Sequence[str] = tuple(SETUPS),
    povray_px: int = POVRAY_PX,
    base_px: int = BASE_PX,
) -> Iterator[Timed]:
    """Measure the base scene and the sweep, ours and POV-Ray's; the first two rows are the base scene's.

    Parameters
    ----------
    scenes
        The project's scenes.
    work
        Folder for POV-Ray's files.
    windows, pitches, grids
        Window sizes (px), pitches (mm), grids of lenslets; POV-Ray's windows end at `povray_px`.
    base_px
        Side of the base scene's picture.
    """
    ours, theirs = base_times(scenes, work, base_px)
    yield from (ours, theirs)
    setups = {grid: load_setup(scenes / f"setups/{name}.toml") for grid, name in SETUPS.items() if grid in grids}
    path = scenes / "seed/full.xml"
    for window in windows:
        for grid, setup in setups.items():
            scene = load_for(path, setup)
            for pitch in pitches:
                seen = with_window(setup, window, pitch)
                # Anti-aliasing costs several times as much: at the ends of the curves only.
                looks = (False, True) if pitch in (min(pitches), max(pitches)) else (False,)
                for antialias in looks:
                    if antialias and window > ANTIALIASED_PX:
                        continue
                    samples = SAMPLES if antialias else 1
                    source = CaptureSource(seen, samples, "chief", 0, current_device())
                    seconds, cpu = render_source(scene, source, samples, 1 if antialias else ROUNDS)
                    yield _row("lippmann", seen, antialias, seconds, cpu, ours.cpu_seconds)
                if window > povray_px:
                    continue
                exported = write_folder(scene, setup_view(seen), work / f"{grid}-{window}-{pitch:g}")
                for antialias in looks:
                    _, run = exported.render(*(ANTIALIAS if antialias else ()))
                    yield _row("POV-Ray", seen, antialias, run.seconds, run.cpu_seconds, theirs.cpu_seconds)


def base_times(scenes: Path, work: Path, base_px: int) -> tuple[Timed, Timed]:
    """Return the base scene's times through the display's window, ours and POV-Ray's: T."""
    scene = load_scene(scenes / "seed/base.xml")
    side = 2400 * MM_PER_INCH / 600.0
    window = Window(side, side, base_px, base_px)
    seconds, cpu = render_source(scene, PerspectiveSource(EYE_MM, window, SAMPLES, 0), SAMPLES)
    ours = Timed("lippmann", "none", base_px, None, 0, True, seconds, cpu, 1.0)
    _, run = export_view(scene, EYE_MM, window, work / "base").render(*ANTIALIAS)
    return ours, Timed("POV-Ray", "none", base_px, None, 0, True, run.seconds, run.cpu_seconds, 1.0)


def _row(tracer: str, setup: Setup, antialias: bool, seconds: float, cpu: float, base: float) -> Timed:
    display = setup.display
    return Timed(
        tracer,
        display.array.grid,
        display.panel.width_px,
        display.array.pitch_mm,
        lenslets_in(display),
        antialias,
        seconds,
        cpu,
        cpu / base,
    )


@dataclass(frozen=True)
class Findings:
    """What the sweep says, shares of CPU time; None where nothing was measured.

    Attributes
    ----------
    growth
        By window (px): most over least of our times, over the pitches; square, no anti-aliasing.
    povray_growth
        The same of POV-Ray.
    hex_share, povray_hex_share
        Hexagonal over square, less 1: median.
    plain_share, povray_plain_share
        No anti-aliasing over anti-aliasing, less 1: median.
    """

    growth: dict[int, float]
    povray_growth: dict[int, float]
    hex_share: float | None
    povray_hex_share: float | None
    plain_share: float | None
    povray_plain_share: float | None


def findings(rows: Sequence[Timed]) -> Findings:
    """Return what the rows say."""
    by_key = {(r.tracer, r.grid, r.window_px, r.pitch_mm, r.antialias): r.cpu_seconds for r in rows}

    def growth(tracer: str) -> dict[int, float]:
        found: dict[int, list[float]] = {}
        for r in rows:
            if r.tracer == tracer and r.grid == "square" and not r.antialias:
                found.setdefault(r.window_px, []).append(r.cpu_seconds)
        return {window: max(times) / min(times) for window, times in found.items()}

    def share(tracer: str, of: Callable[[Timed], tuple[Any, ...]], over: Callable[[Timed], bool]) -> float | None:
        shares = [
            r.cpu_seconds / by_key[of(r)] - 1.0 for r in rows if r.tracer == tracer and over(r) and of(r) in by_key
        ]
        return float(np.median(shares)) if shares else None

    def square(r: Timed) -> tuple[Any, ...]:
        return r.tracer, "square", r.window_px, r.pitch_mm, r.antialias

    def smoothed(r: Timed) -> tuple[Any, ...]:
        return r.tracer, r.grid, r.window_px, r.pitch_mm, True

    return Findings(
        growth("lippmann"),
        growth("POV-Ray"),
        share("lippmann", square, lambda r: r.grid == "hex"),
        share("POV-Ray", square, lambda r: r.grid == "hex"),
        share("lippmann", smoothed, lambda r: not r.antialias),
        share("POV-Ray", smoothed, lambda r: not r.antialias),
    )


def plot(rows: Sequence[Timed], path: Path) -> None:
    """Draw t_R over the number of lenslets: a curve for each window and tracer; hexagonal arrays dashed."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True, layout="constrained")
    windows = sorted({r.window_px for r in rows if r.grid != "none"})
    for axis, antialias in zip(axes, (False, True), strict=True):
        for tracer, marker in (("lippmann", "o"), ("POV-Ray", "s")):
            for window in windows:
                for grid, style in (("square", "-"), ("hex", "--")):
                    curve = sorted(
                        (r.lenslets, r.relative)
                        for r in rows
                        if (r.tracer, r.window_px, r.grid, r.antialias) == (tracer, window, grid, antialias)
                    )
                    if curve:
                        label = f"{tracer}, {window} px" if grid == "square" else None
                        colour = "black" if tracer == "POV-Ray" else f"C{windows.index(window)}"
                        axis.plot(*zip(*curve, strict=True), style, marker=marker, color=colour, label=label)
        axis.set(xscale="log", yscale="log", xlabel="lenslets in the window")
        axis.set_title("anti-aliasing" if antialias else "no anti-aliasing")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    axes[0].set_ylabel("relative time t_R, each tracer by its own T")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def report_text(rows: Sequence[Timed], trial: bool = False) -> str:
    """Return the page; `trial` says on it that its windows are too small to measure anything."""
    found = findings(rows)
    ours, theirs = (row for row in rows if row.grid == "none")

    def percent(value: float | None) -> str:
        return "-" if value is None else f"{100.0 * value:+.0f} %"

    windows = sorted(found.growth)
    growth: dict[str, list[Any]] = {
        "window, px": windows,
        "lippmann": [found.growth[window] for window in windows],
        "POV-Ray": [found.povray_growth.get(window) for window in windows],
    }
    shares = {
        "": ["hexagonal against square", "anti-aliasing off against on"],
        "lippmann": [percent(found.hex_share), percent(found.plain_share)],
        "POV-Ray": [percent(found.povray_hex_share), percent(found.povray_plain_share)],
        "the paper": [percent(PAPER_HEX), percent(PAPER_PLAIN)],
    }
    columns = ("tracer", "grid", "window_px", "pitch_mm", "lenslets", "antialias", "seconds", "cpu_seconds", "relative")
    sweep = [
        {**dataclasses.asdict(row), "antialias": "on" if row.antialias else "off"} for row in rows if row.grid != "none"
    ]
    heading = "The founding paper's benchmark"
    if trial:
        heading += (
            ", a trial\n\nThe windows are too small to measure anything: these times are mostly those of starting."
        )
    return f"""# {heading}

Relative time t_R over the number of lenslets in the window, as in the paper's figure 9: `scenes/seed/full.xml` through
`scenes/setups/fig8a.toml` and `hex.toml`, the lenslets scaled to the pitch, the window at 600 dpi. T is each tracer's
own time for `scenes/seed/base.xml`, {ours.window_px} x {ours.window_px} px, anti-aliased: {ours.cpu_seconds:.2f} s ours
({SAMPLES} samples a pixel), {theirs.cpu_seconds:.2f} s POV-Ray's (threshold 0.3); the paper's was 40 s. All times are
CPU seconds of all threads.

![t_R over the number of lenslets](seed.png)

Solid lines are square arrays, dashed ones hexagonal.

Growth at a fixed window, square, no anti-aliasing, the longest time over the shortest of all pitches:

{table(growth)}
Medians over the sweep:

{table(shares)}
{table({key: [row[key] for row in sweep] for key in columns})}"""
