"""Measures which lines quick tests execute (`make coverage`), and which RTL bits they toggle (`make toggles`).

The pages list lines and signal bits that no quick test reaches, with the reasons from code_coverage_holes.toml. Each
RTL file with such lines or bits needs a reason.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import click
from lippmann.base import toml
from lippmann.base.images import check_output
from lippmann.base.report_provenance import provenance
from lippmann.base.toml import documented, key
from lippmann.cli.frame import option
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import Plot
from lippmann.errors import InputError, LippmannError, input_error
from lippmann.simulation.compilation import COVERAGE, TOGGLES
from lippmann.simulation.toolchain import build_folder, repository

from tools.program import MAINTAINERS_REPORT, program
from tools.report_plots import draw_bar_charts, make_page

HOLES = Path(__file__).with_name("code_coverage_holes.toml")
#: Settings of coverage.py, which count every process, including those that a command starts or that a signal ends.
SETTINGS = """[run]
source =
    host/lippmann
    host/tools
data_file = {folder}/host
parallel = true
patch = subprocess
sigterm = true
"""
#: This test fails under coverage.py, because coverage.py writes its file where the test forbids writing.
BROKEN = "tests/host/test_images.py::test_a_file_that_does_not_fit_is_told"
#: Pattern of a key and its value in a coverage point of Verilator's file.
POINT = re.compile(r"\x01([^\x02]*)\x02([^\x01']*)")
BARS = 15


@documented
@dataclass(frozen=True, kw_only=True)
class Hole:
    """The reason why quick tests do not execute some lines of the files, or do not toggle some bits."""

    files: Annotated[tuple[str, ...], key("paths of the files, from the top of the checkout")]
    why: Annotated[str, key("the reason")]


@documented
@dataclass(frozen=True, kw_only=True)
class Holes:
    """The content of code_coverage_holes.toml."""

    hole: Annotated[tuple[Hole, ...], key("")] = ()
    still: Annotated[tuple[Hole, ...], key("")] = ()


@dataclass
class Counted:
    """The counts of a file's coverage points: of lines keyed by number, of toggles keyed by name."""

    lines: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    toggles: dict[str, int] = field(default_factory=lambda: defaultdict(int))


def read_rtl(files: Iterable[Path], top: Path) -> dict[str, Counted]:
    """Add up Verilator's coverage files; return the counts of the files in rtl/, keyed by the path below `top`."""
    counts: dict[bytes, int] = defaultdict(int)
    # Add up the counts of equal points first, because files of toggles take gigabytes.
    for file in files:
        for text in file.read_bytes().splitlines():
            if text.startswith(b"C "):
                keys, _, count = text.rpartition(b" ")
                counts[keys] += 0 if count == b"0" else int(count)
    files_counted: dict[str, Counted] = defaultdict(Counted)
    for keys, met in counts.items():
        point: dict[str, str] = dict(POINT.findall(keys.decode(errors="replace")))
        path = Path(point.get("f", ""))
        if not path.is_relative_to(top / "rtl"):
            continue
        counted = files_counted[str(path.relative_to(top))]
        if point["t"] == "toggle":
            counted.toggles[f"{point['l']}:{point['o']}"] += met
            continue
        # The key S lists lines, such as 4-6,9; a line is covered if any of its branches is.
        for part in point.get("S", point["l"]).split(","):
            first, _, last = part.partition("-")
            for line in range(int(first), int(last or first) + 1):
                counted.lines[line] += met
    return dict(sorted(files_counted.items()))


def rtl_rows(files: Mapping[str, Counted]) -> list[dict[str, Any]]:
    """Return each file's row: its numbers of lines and toggles, how many are covered, and which lines are not."""
    rows = []
    for name, one in files.items():
        row = {"file": name, "lines": len(one.lines), "met": sum(map(bool, one.lines.values()))}
        row |= {"toggles": len(one.toggles), "toggled": sum(map(bool, one.toggles.values()))}
        rows.append({**row, "missing": _ranges(line for line, count in one.lines.items() if not count)})
    return rows


def host_rows(measured: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the row of each file in the JSON report of coverage.py."""
    rows = []
    for name, one in sorted(measured["files"].items()):
        row = {"file": name, "lines": one["summary"]["num_statements"], "met": one["summary"]["covered_lines"]}
        rows += [{**row, "missing": _ranges(one["missing_lines"])}] if row["lines"] else []
    return rows


def _ranges(numbers: Iterable[int]) -> str:
    """Return line numbers as a text such as 4-6, 9."""
    parts: list[list[int]] = []
    for number in sorted(numbers):
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in parts)


def share(rows: Iterable[Mapping[str, Any]], met: str = "met", of: str = "lines") -> float:
    """Return the percentage of all files' lines or toggles that are covered."""
    totals = [sum(counts) for counts in zip(*((row[met], row[of]) for row in rows), strict=True)]
    return 100.0 * totals[0] / max(1, totals[1]) if totals else 0.0


def page(
    origin: Mapping[str, str], rtl: list[dict[str, Any]], host: list[dict[str, Any]], why: Mapping[str, str]
) -> Page:
    """Return the page of line coverage; `why` has the reasons, keyed by file."""
    missed = {row["file"].removeprefix("host/"): row["lines"] - row["met"] for row in (*rtl, *host)}
    plot = _draw_most("code-coverage", "lines that no quick test executes", missed)
    missing = [row for row in rtl if row["missing"]] + [row for row in host if row["missing"] and row["file"] in why]
    holes = [{**row, "why": why.get(row["file"], "")} for row in missing]
    context = {"rtl": rtl, "host": host, "share": {"rtl": share(rtl), "host": share(host)}, "holes": holes}
    lines = [{name: value for name, value in row.items() if name not in ("toggles", "toggled")} for row in rtl]
    tables = {"code-coverage-rtl": lines, "code-coverage-host": host}
    return make_page("code-coverage", origin, [plot], tables, context)


def toggles_page(origin: Mapping[str, str], rtl: list[dict[str, Any]], why: Mapping[str, str]) -> Page:
    """Return the page of toggle coverage; `why` has the reasons, keyed by file."""
    rows = [{**row, "still": row["toggles"] - row["toggled"], "why": why.get(row["file"], "")} for row in rtl]
    least = sorted((row for row in rows if row["still"]), key=lambda row: -row["still"])
    plot = _draw_most("toggles", "toggles that no quick test sees", {row["file"]: row["still"] for row in least})
    context = {"least": least, "share": share(rtl, "toggled", "toggles"), "toggles": sum(row["toggles"] for row in rtl)}
    columns = ("file", "toggles", "toggled", "still")
    table = [{name: row[name] for name in columns} for row in rows]
    return make_page("toggles", origin, [plot], {"toggles": table}, context)


def _draw_most(name: str, heading: str, counts: Mapping[str, int]) -> Plot:
    files = sorted(counts, key=lambda file: -counts[file])[:BARS]
    return draw_bar_charts(name, files, {heading: [float(counts[file]) for file in files]})


def reasons(top: Path, path: Path = HOLES, toggles: bool = False) -> dict[str, str]:
    """Return the reasons for holes (`toggles`: for idle bits), keyed by file. Raises InputError for a missing file."""
    read = toml.read(Holes, toml.load(path, "holes"), str(path))
    name, holes = ("still", read.still) if toggles else ("hole", read.hole)
    for number, hole in enumerate(holes):
        for file in hole.files:
            if not (top / file).is_file():
                raise input_error(f"{path}: {name}[{number}].files", f"there is no file {file}", "give its new path")
    return {file: hole.why for hole in holes for file in hole.files}


def check_reasons(files: Iterable[str], why: Mapping[str, str], name: str) -> None:
    """Raise InputError if files with lines or bits that tests do not reach have no reason."""
    if unexplained := ", ".join(file for file in files if file not in why):
        raise input_error(str(HOLES), f"has no reason for holes in {unexplained}", f"add a table [[{name}]] or a test")


def measure(folder: Path, jobs: int, toggles: bool) -> None:
    """Run the quick tests with counters into an emptied folder; raise LippmannError if a test fails."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "rtl").mkdir(parents=True)
    tests = [sys.executable, "-m", "pytest", "-q", "-n", str(jobs), "--dist", "loadfile", "--no-loadscope-reorder"]
    counted = ["tests/rtl"]
    if not toggles:
        settings = folder / "settings"
        settings.write_text(SETTINGS.format(folder=folder))
        counted = ["--cov", f"--cov-config={settings}", f"--cov-report=json:{folder / 'host.json'}"]
        counted += [f"--deselect={BROKEN}"]
    environment = {**os.environ, COVERAGE: str(folder / "rtl"), "LIPPMANN_SEED": "1908"}
    environment |= {TOGGLES: "1"} if toggles else {}
    if subprocess.run([*tests, "-m", "not full", *counted], cwd=repository(), env=environment, check=False).returncode:
        raise LippmannError("tests fail, so their coverage is not valid; correct these tests first")


@program
def main(
    jobs: int = option("Number of processes that run tests.", 2, click.IntRange(1)),
    toggles: bool = option("Count toggles of RTL bits instead of lines (an hour, tens of GB).", False),
    keep: bool = option("Run no test; use the counts of the last run.", False),
    report: str = MAINTAINERS_REPORT,
) -> None:
    """Measure which lines the quick tests execute, or which bits these tests toggle, and write the page.

    Example: python -m tools.code_coverage --keep --report out
    """
    check_output(Path(report) / ("toggles.md" if toggles else "code-coverage.md"), (".md",))
    top, folder = repository(), build_folder() / ("toggles" if toggles else "coverage")
    if not keep:
        measure(folder, jobs, toggles)
    if not (folder / "rtl").exists() or not (toggles or (folder / "host.json").exists()):
        raise InputError(f"{folder}: there are no counts of an earlier run; omit --keep")
    why = reasons(top, toggles=toggles)
    rtl = rtl_rows(read_rtl(sorted((folder / "rtl").glob("*.dat")), top))
    if toggles:
        toggles_page(provenance("make toggles", ("pytest",), {}), rtl, why).write(Path(report))
        click.echo(f"RTL: {share(rtl, 'toggled', 'toggles'):.1f} % of toggles")
        check_reasons([row["file"] for row in rtl if row["toggled"] < row["toggles"]], why, "still")
        return
    host = host_rows(json.loads((folder / "host.json").read_text()))
    origin = provenance("make coverage", ("coverage", "pytest"), {})
    page(origin, rtl, host, why).write(Path(report))
    click.echo(f"RTL: {share(rtl):.1f} % of lines")
    click.echo(f"host: {share(host):.1f} % of lines")
    check_reasons([row["file"] for row in rtl if row["missing"]], why, "hole")
