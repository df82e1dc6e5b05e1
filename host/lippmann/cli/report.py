"""Command `lippmann report`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lippmann.base.files import make_folder
from lippmann.base.images import check_output
from lippmann.base.variant import start_mitsuba
from lippmann.cli.frame import KINDS, Folder, Name, make_command, option
from lippmann.cli.options import DEVICE, SCENES, SEED, shipped_scenes
from lippmann.cli.output import emit
from lippmann.errors import input_error

if TYPE_CHECKING:
    from lippmann.conformance.figures import Comparison, Stored
    from lippmann.conformance.pages import Page


@dataclass(frozen=True)
class ReportOptions:
    """Options of `lippmann report`."""

    output: Folder = option("Output folder for the report; created if missing.", Path("out/report"))
    against: Folder | None = option("Folder of the earlier run to compare with.  [default: the folder of -o]")
    scenes: str = SCENES
    quick: bool = option("Measure less, and run no RTL simulation.")
    seed: int = SEED
    device: str = DEVICE

    def words(self) -> str:
        """Return the command-line options on which the figures depend."""
        return f"--scenes {self.scenes} --seed {self.seed} --device {self.device}{' --quick' if self.quick else ''}"


@make_command("report")
def command(
    display: tuple[Name, ...] = option(
        "Display file; can be repeated.  [default: the shipped displays]", (), KINDS[Name], multiple=True
    ),
    options: ReportOptions = ReportOptions,  # type: ignore[assignment]
) -> None:
    """Measure speed and error of each engine and lens model on displays, and write a report.

    The report also lists changes since an earlier run. Run the command in the project's
    top folder on an idle machine.

    Example: lippmann report -o out/report
    """
    from lippmann.conformance.engine_report import QUICK, TABLES, Plan, display_sections, make_report

    plan = replace(QUICK if options.quick else Plan(), display_files=display)
    plan.load_displays(shipped_scenes(options.scenes))  # refuse invalid files before measuring
    words = "".join(f" --display {file}" for file in display)

    def measure(scenes: Path, before: Stored | None) -> tuple[Page, Comparison]:
        sections = display_sections(scenes, plan, options.seed)
        return make_report(sections, plan, options.seed, f"lippmann report{words} {options.words()}", before)

    write_report(options, TABLES, measure)


def write_report(
    options: ReportOptions, tables: Sequence[str], measure: Callable[[Path, Stored | None], tuple[Page, Comparison]]
) -> None:
    """Write a report with the given tables, and print the changes since the earlier run.

    The function `measure` receives the folder of scenes and the earlier run. Raises
    InputError if the earlier run is invalid or the output is not writable.
    """
    from lippmann.conformance.engine_report import PAGE
    from lippmann.conformance.figures import read_stored

    scenes, folder = shipped_scenes(options.scenes), options.output
    before = read_stored(options.against or folder, tables)
    if options.against and before is None:
        raise input_error(options.against, "contains no earlier report", "name a folder with report-*.csv")
    make_folder(folder, "choose another folder")
    for name in (f"{PAGE}.md", f"{PAGE}.html"):
        check_output(folder / name, (".md", ".html"))
    start_mitsuba(options.device)
    started = time.perf_counter()
    page, comparison = measure(scenes, before)
    seconds = time.perf_counter() - started
    files = page.write(folder, as_html=True)
    moves = [{**asdict(move), "ratio": move.ratio} for move in comparison.moved]
    result = {
        **page.origin,
        "folder": str(folder),
        "files": [str(file) for file in files],
        "seconds": seconds,
        "tables": {name: page.tables[name] for name in tables},
        "comparison": {**asdict(comparison), "moved": moves},
    }
    header = f"{folder / PAGE}.html, .md: {seconds:.0f} s, load {page.origin['load']}"
    emit(result, [header, *comparison_lines(comparison)])


def comparison_lines(comparison: Comparison) -> list[str]:
    """Describe the comparison with the earlier run, as lines of text."""
    then = f"the run of {comparison.before.get('date')}"
    if not comparison.before:
        return ["no earlier run to compare with"]
    if comparison.differs:
        return [f"not compared with {then}: different {' and '.join(comparison.differs)}"]
    moved = comparison.moved
    lines = [f"{len(moved)} of {comparison.compared} figures moved by more than the noise since {then}"]
    for move in moved:
        change = f"{move.before.median:.4g} to {move.now.median:.4g}"
        lines.append(f"  {move.table}: {move.row}: {move.figure} {change}")
    return lines
