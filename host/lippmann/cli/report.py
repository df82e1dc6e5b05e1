"""`lippmann report`: speed against error of every engine, model and word length, as pages, plots and CSV."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click

from lippmann.cli.options.common import device_option, json_option, seed_option
from lippmann.cli.output import emit, log
from lippmann.errors import InputError, input_error
from lippmann.images import check_output
from lippmann.variant import start_mitsuba


@click.command("report")
@click.option("-o", "output", default="out/report", show_default=True, metavar="FOLDER", help="Made when missing.")
@click.option(
    "--against",
    metavar="FOLDER",
    help="Where the run to compare with was kept.  [default: the folder of -o]",
)
@click.option("--scenes", default="scenes", show_default=True, help="The project's folder of scenes.")
@click.option("--quick", is_flag=True, help="Little of everything, and no simulation: a look at the report.")
@seed_option
@device_option
@json_option
def command(output: str, against: str | None, scenes: str, quick: bool, seed: int, device: str, as_json: bool) -> None:
    """Measure speed against error of engines, models, word lengths and renderer, and tell what moved.

    Writes report.md, report.html, plots and CSV. Run it on a quiet machine, in the project's top folder.

    Example: lippmann report -o out/report
    """
    from lippmann.report.figures import read_stored
    from lippmann.report.plan import QUICK, WHOLE
    from lippmann.report.run import PAGE, TABLES, make_report, write

    shown = Path(scenes)
    if not (shown / "displays/paper-square.toml").is_file():
        raise InputError(f"{shown}: the project's scenes are not there; run in the project's top folder")
    folder = Path(output)
    before = read_stored(Path(against or output), TABLES)
    if against is not None and before is None:
        raise input_error(against, "no run of the report was kept there", "name a folder that holds report-*.csv")
    _make(folder)
    for name in (f"{PAGE}.md", f"{PAGE}.html"):
        check_output(folder / name, (".md", ".html"))
    start_mitsuba(device)
    said = f"lippmann report --scenes {scenes} --seed {seed} --device {device}{' --quick' if quick else ''}"
    report = make_report(shown, QUICK if quick else WHOLE, seed, said, before, log)
    files = write(report, folder)
    found = report.comparison
    moves = [{**dataclasses.asdict(move), "ratio": move.ratio} for move in found.moved]
    result = {
        **report.origin,
        "folder": output,
        "files": [str(file) for file in files],
        "seconds": report.seconds,
        "tables": {data.name: data.flat() for data in report.data},
        "comparison": {**dataclasses.asdict(found), "moved": moves},
    }

    def text() -> None:
        click.echo(f"{folder / PAGE}.html, .md: {report.seconds:.0f} s, load {report.origin['load']}")
        then = f"the run of {found.before.get('date')}"
        if not found.before:
            click.echo("no run before to compare with")
        elif found.differs:
            click.echo(f"not compared with {then}: another {' and '.join(found.differs)}")
        else:
            click.echo(f"{len(found.moved)} of {found.compared} figures moved by more than the noise since {then}")
        for move in found.moved:
            change = f"{move.before.median:.4g} to {move.now.median:.4g}"
            click.echo(f"  {move.table}: {move.row}: {move.figure} {change}")

    emit(result, as_json, text)


def _make(folder: Path) -> None:
    """Make the output folder, before any work is done."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise input_error(str(folder), f"cannot be made ({error.strerror})", "choose another place") from None
