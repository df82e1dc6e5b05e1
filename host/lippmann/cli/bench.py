"""`lippmann bench`: measured speed and error, a sub-command for each measurement."""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click

from lippmann.cli.frame import JSON, option, parameters
from lippmann.cli.options.common import DEVICE, SCENES, SEED
from lippmann.cli.output import emit, log
from lippmann.errors import InputError, MissingLibraryError
from lippmann.files import scratch_folder
from lippmann.images import check_output
from lippmann.measure.figures import row_of
from lippmann.provenance import provenance
from lippmann.report import benches
from lippmann.report.pages import Page
from lippmann.report.tables import figure, plain_table, write_csv
from lippmann.variant import start_mitsuba

#: Packages of a measurement that uses Mitsuba, or the fast engine.
ON_DEVICE = ("mitsuba", "drjit", "numpy")
#: Measurements that only return rows: help, module of the function `measure(scenes, seed)`, packages.
ROWS = {
    "trace": ("rays a second of golden and fast for each lens model, and fast's error", "engines", ON_DEVICE),
    "render": ("the renderer: time, rate, memory, rate against Mitsuba's own camera", "renderer", ON_DEVICE),
    "stages": ("where the time of a render goes: each stage, and the whole process", "render_time", ON_DEVICE),
    "live": ("pictures a second of a scene that turns, and the time until one that rests is fine", "live", ON_DEVICE),
    "animate": ("a film by two workers on this machine against one process", "animate", ON_DEVICE),
    "observe": ("PSNR of views through the lenslets against perspective renders", "observe", ON_DEVICE),
    "rtl": ("rays and pixels a second of the simulated RTL", "simulation", ("verilator", "numpy")),
}
#: Measurements of the maintainers' programs, which register them as entry points of the group "lippmann.bench".
REGISTERED = ("view", "seed", "peers")


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
            words = [f"lippmann bench {name} --scenes {scenes} --seed {seed}"]
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
                write_csv(kept / f"measured/{benches.measured_name(name, chosen)}.csv", origin, found["rows"])
                benches.measured_page(kept).write(kept)
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


def shipped_scenes(path: str) -> Path:
    """Return the project's folder of scenes; refuse another folder."""
    if not (Path(path) / "displays/paper-square.toml").is_file():
        raise InputError(f"{path}: the project's scenes are not there; run in the project's top folder")
    return Path(path)


def _plain(origin: Mapping[str, str], found: Mapping[str, Any]) -> str:
    lines = (f"{key}: {value}" for key, value in origin.items())
    return "\n".join([*lines, *(plain_table(rows) for rows in found.values())])


def _rows_command(name: str) -> click.Command:
    """Return the sub-command of a measurement of `ROWS`."""
    what, module, packages = ROWS[name]

    def measure(bench: Bench) -> tuple[Mapping[str, Any], None]:
        rows = importlib.import_module(f"lippmann.measure.{module}").measure(bench.scenes, bench.seed)
        return {"rows": bench.collect(rows)}, None

    measure.__name__, measure.__doc__ = name, f"Measure {what}.\n\nExample: lippmann bench {name}"
    return measurement(packages=packages)(measure)


class _Measurements(click.Group):
    """The measurements of this file, and those that are registered as entry points."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return all names."""
        return [*self.commands, *REGISTERED]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a measurement; refuse a registered one that is not installed."""
        if cmd_name not in REGISTERED:
            return super().get_command(ctx, cmd_name)
        for point in importlib.metadata.entry_points(group="lippmann.bench", name=cmd_name):
            found: click.Command = point.load()
            return found
        raise MissingLibraryError(f"bench {cmd_name}, a maintainers' measurement, is not installed; run make setup")

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the measurements; those of the maintainers by their names only."""
        with formatter.section("Measurements"):
            formatter.write_dl([(name, one.get_short_help_str(90)) for name, one in self.commands.items()])
            formatter.write_text(f"Maintainers: {', '.join(REGISTERED)}")

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

    Example: lippmann bench trace
    """


@measurement(page="fixed-point-error", packages=("numpy",))
def fixed(
    bench: Bench,
    configuration: tuple[str, ...] = option(
        "Measure only this; may be repeated.", (), str, multiple=True, metavar="NAME"
    ),
) -> tuple[Mapping[str, Any], Page]:
    """Measure the error of the fixed-point pipeline against golden, and the share of each step.

    Example: lippmann bench fixed --configuration widest-square
    """
    from lippmann.measure.fixed import measure_all

    rows, shares = measure_all(configuration, bench.scenes, bench.seed, log)
    return {"rows": rows, "budget": shares}, benches.fixed_page(bench.origin, rows, shares)


@measurement(page="link", packages=("verilator", "numpy", "pyserial"))
def link(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure a serial line's efficiency, and whole frames on the virtual board.

    Example: lippmann bench link
    """
    from lippmann.measure.link import measure_frames, measure_lines

    log("compiling the boards that are not compiled yet (half a minute each) ...")
    lines = bench.collect(measure_lines(bench.scenes, bench.seed))
    frames = bench.collect(measure_frames(bench.scenes, bench.seed))
    return {"efficiency": lines, "frames": frames}, benches.link_page(bench.origin, lines, frames)


@measurement(page="depth")
def depth(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure the depths that the founding paper's set-ups show, against the lens equations.

    Example: lippmann bench depth
    """
    from lippmann.measure.depth import fish_views, measure

    rows = bench.collect(measure(bench.scenes, bench.seed))
    views = None if bench.report is None else fish_views(bench.scenes, bench.seed)
    return {"rows": rows}, benches.depth_page(bench.origin, rows, views)


@measurement(page="hard-cases", packages=("numpy", "mpmath", "drjit", "verilator"))
def hard(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Compare every engine with 50 digits on the hard cases, and our formulas with naive ones.

    Example: lippmann bench hard
    """
    from lippmann.conditioning import formulas
    from lippmann.measure.hard import measure

    real, fixed = measure(bench.scenes, bench.seed, bench.device, log)
    gains = formulas.measure(bench.seed)
    rows = {"hard_cases": real, "hard_cases_fixed": fixed, "hard_cases_formulas": gains}
    return rows, benches.hard_page(bench.origin, real, fixed, gains)


@measurement(page="layers")
def layers(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure the eye's view of drawn layers and of a streamed frame against the full render.

    Example: lippmann bench layers
    """
    from lippmann.measure.layers import measure

    rows = bench.collect(measure(bench.scenes, bench.seed))
    return {"layers": rows}, benches.layers_page(bench.origin, rows)


@measurement(page="content")
def content(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure what an eye sees of views and depth pictures against the scene; picture each kind of content.

    Example: lippmann bench content
    """
    from lippmann.measure.content import gallery, measure

    with scratch_folder() as folder:
        rows = bench.collect(measure(bench.scenes, folder, bench.seed))
    with scratch_folder() as folder:
        views = None if bench.report is None else gallery(bench.scenes, folder, bench.seed)
    return {"rows": rows}, benches.content_page(bench.origin, rows, views)


@measurement(page="shading")
def shading(bench: Bench) -> tuple[Mapping[str, Any], Page]:
    """Measure time against error of light that each ray finds, that a pixel's surfaces share, and that lenslets share.

    And what samples could save that go where the noise is.

    Example: lippmann bench shading
    """
    from lippmann.measure import adaptive
    from lippmann.measure.shading import curves, error_map, likeness

    with scratch_folder() as folder:
        rows = bench.collect(curves(bench.scenes, folder, bench.seed))
    pairs = bench.collect(likeness(bench.scenes, bench.seed))
    saved = bench.collect(adaptive.measure(bench.scenes, bench.seed))
    views = None if bench.report is None else error_map(bench.scenes, bench.seed)
    tables = {"shading": rows, "shading-likeness": pairs, "shading-adaptive": saved}
    return tables, benches.shading_page(bench.origin, tables, views)


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

    Example: lippmann bench calibration --displays 4
    """
    from lippmann.measure.calibration import BOWED, largest, measure, sweep, views

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
    return tables, benches.calibration_page(bench.origin, tables, width_px)


for _one in (*(_rows_command(name) for name in ROWS), fixed, link, depth, hard, layers, content, shading, calibration):
    command.add_command(_one)
