"""`lippmann report`: speed against error of every engine, model and word length, as pages, plots and CSV."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

from lippmann.base.files import make_folder
from lippmann.base.images import check_output
from lippmann.base.variant import start_mitsuba
from lippmann.cli.frame import make_command, option
from lippmann.cli.options.common import DEVICE, SCENES, SEED, shipped_scenes
from lippmann.cli.output import emit, log
from lippmann.errors import input_error


@make_command("report")
def command(
    output: str = option("Output folder; created when missing.", "out/report", flag="-o", metavar="FOLDER"),
    against: str | None = option(
        "Folder of the run to compare with.  [default: the folder of -o]", None, metavar="FOLDER"
    ),
    scenes: str = SCENES,
    quick: bool = option("A trial: few measurements, no simulation.", False),
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Measure speed and error of everything, and write a report.

    It covers engines, models, word lengths and the renderer, and lists what changed since an earlier run. The files are
    report.md, report.html, plots and CSV. Run it on a quiet machine, in the project's top folder.

    Example: lippmann report -o out/report
    """
    from lippmann.conformance.figures import read_stored
    from lippmann.conformance.report_plan import QUICK, WHOLE
    from lippmann.conformance.report_run import PAGE, TABLES, make_report

    shown, folder = shipped_scenes(scenes), Path(output)
    before = read_stored(Path(against or output), TABLES)
    if against is not None and before is None:
        raise input_error(against, "holds no run of the report", "name a folder that holds report-*.csv")
    make_folder(folder, "choose another place")
    for name in (f"{PAGE}.md", f"{PAGE}.html"):
        check_output(folder / name, (".md", ".html"))
    start_mitsuba(device)
    started = time.perf_counter()
    words = f"lippmann report --scenes {scenes} --seed {seed} --device {device}{' --quick' if quick else ''}"
    page, found = make_report(shown, QUICK if quick else WHOLE, seed, words, before, log)
    seconds = time.perf_counter() - started
    files = page.write(folder, as_html=True)
    moves = [{**dataclasses.asdict(move), "ratio": move.ratio} for move in found.moved]
    result = {
        **page.origin,
        "folder": output,
        "files": [str(file) for file in files],
        "seconds": seconds,
        "tables": {name: page.tables[name] for name in TABLES},
        "comparison": {**dataclasses.asdict(found), "moved": moves},
    }

    lines = [f"{folder / PAGE}.html, .md: {seconds:.0f} s, load {page.origin['load']}"]
    then = f"the run of {found.before.get('date')}"
    if not found.before:
        lines.append("no run before to compare with")
    elif found.differs:
        lines.append(f"not compared with {then}: another {' and '.join(found.differs)}")
    else:
        lines.append(f"{len(found.moved)} of {found.compared} figures moved by more than the noise since {then}")
    for move in found.moved:
        change = f"{move.before.median:.4g} to {move.now.median:.4g}"
        lines.append(f"  {move.table}: {move.row}: {move.figure} {change}")
    emit(result, lines)
