"""`lippmann report`: speed against error of every engine and lens model, as pages, plots and CSV."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lippmann.base.files import make_folder
from lippmann.base.images import check_output
from lippmann.base.variant import start_mitsuba
from lippmann.cli.frame import Folder, make_command, option
from lippmann.cli.options import DEVICE, SCENES, SEED, shipped_scenes
from lippmann.cli.output import emit
from lippmann.errors import input_error

if TYPE_CHECKING:
    from lippmann.conformance.figures import Comparison, Stored
    from lippmann.conformance.pages import Page


@dataclasses.dataclass(frozen=True)
class ReportOptions:
    """The options of a report."""

    output: Folder = option("Output folder; created when missing.", Path("out/report"))
    against: Folder | None = option("Folder of the run to compare with.  [default: the folder of -o]", None)
    scenes: str = SCENES
    quick: bool = option("A trial: few measurements, no simulation.", False)
    seed: int = SEED
    device: str = DEVICE

    def words(self) -> str:
        """Return the options that the figures depend on, as they were given."""
        return f"--scenes {self.scenes} --seed {self.seed} --device {self.device}{' --quick' if self.quick else ''}"


@make_command("report")
def command(
    display: tuple[str, ...] = option(
        "Display file to measure; may be repeated.  [default: shipped displays]", (), str, multiple=True, metavar="FILE"
    ),
    options: ReportOptions = ReportOptions,  # type: ignore[assignment]
) -> None:
    """Measure speed and error of each engine and lens model on displays, and write a report.

    It lists what changed since an earlier run. The files are report.md, report.html, plots and CSV. Run it on a quiet
    machine, in the project's top folder.

    Example: lippmann report -o out/report
    """
    from lippmann.conformance.engine_report import QUICK, TABLES, Plan, display_sections, make_report

    plan = dataclasses.replace(QUICK if options.quick else Plan(), display_files=display)
    plan.load_displays(shipped_scenes(options.scenes))  # a wrong file is refused before anything is measured
    words = "".join(f" --display {file}" for file in display)

    def measure(scenes: Path, before: Stored | None) -> tuple[Page, Comparison]:
        sections = display_sections(scenes, plan, options.seed)
        return make_report(sections, plan, options.seed, f"lippmann report{words} {options.words()}", before)

    write_report(options, TABLES, measure)


def write_report(
    options: ReportOptions, tables: Sequence[str], measure: Callable[[Path, Stored | None], tuple[Page, Comparison]]
) -> None:
    """Write a report of some tables, and print what changed.

    `measure` gets the folder of the scenes and the run to compare with. Raises InputError before it is called when the
    folder of that run holds none or a broken one, or when the output cannot be written.
    """
    from lippmann.conformance.engine_report import PAGE
    from lippmann.conformance.figures import read_stored

    scenes, folder = shipped_scenes(options.scenes), options.output
    before = read_stored(options.against or folder, tables)
    if options.against is not None and before is None:
        raise input_error(str(options.against), "holds no run of the report", "name a folder that holds report-*.csv")
    make_folder(folder, "choose another place")
    for name in (f"{PAGE}.md", f"{PAGE}.html"):
        check_output(folder / name, (".md", ".html"))
    start_mitsuba(options.device)
    started = time.perf_counter()
    page, comparison = measure(scenes, before)
    seconds = time.perf_counter() - started
    files = page.write(folder, as_html=True)
    moves = [{**dataclasses.asdict(move), "ratio": move.ratio} for move in comparison.moved]
    result = {
        **page.origin,
        "folder": str(folder),
        "files": [str(file) for file in files],
        "seconds": seconds,
        "tables": {name: page.tables[name] for name in tables},
        "comparison": {**dataclasses.asdict(comparison), "moved": moves},
    }
    header = f"{folder / PAGE}.html, .md: {seconds:.0f} s, load {page.origin['load']}"
    emit(result, [header, *comparison_lines(comparison)])


def comparison_lines(comparison: Comparison) -> list[str]:
    """Return what a report tells in the terminal about the earlier run."""
    then = f"the run of {comparison.before.get('date')}"
    if not comparison.before:
        return ["no run before to compare with"]
    if comparison.differs:
        return [f"not compared with {then}: another {' and '.join(comparison.differs)}"]
    moved = comparison.moved
    lines = [f"{len(moved)} of {comparison.compared} figures moved by more than the noise since {then}"]
    for move in moved:
        change = f"{move.before.median:.4g} to {move.now.median:.4g}"
        lines.append(f"  {move.table}: {move.row}: {move.figure} {change}")
    return lines
