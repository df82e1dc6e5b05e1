"""Shared by `make mutation` and `make mutation-host`: faults in source files, tests in a copy, the report."""

from __future__ import annotations

import contextlib
import difflib
import functools
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from lippmann.cli.output import log
from lippmann.errors import LippmannError
from lippmann.provenance import provenance
from lippmann.report.tables import table, write_report
from lippmann.sim.tools import repository

#: Folders and files of the checkout that tests read.
TESTED = (
    "host", "rtl", "sim", "tests", "scenes", "docs", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE",
    "Makefile", "constraints.txt", "pyproject.toml",
)  # fmt: skip
#: Seconds that a test may take, and the whole of a stage.
TEST_S, STAGE_S = 300, 3600
#: Changed lines that are no faults: file and a part of the text, and the reason.
Same = Mapping[tuple[str, str], str]


@dataclass(frozen=True)
class Fault:
    """A change of a file: the lines from `line` (1-based) on as they were and as they are now."""

    file: str
    line: int
    was: str
    now: str

    def changed(self, text: str) -> str:
        """Return the file's text with the fault.

        Raises
        ------
        ValueError
            When the text has other lines there.
        """
        lines, was = text.split("\n"), self.was.split("\n")
        place = slice(self.line - 1, self.line - 1 + len(was))
        if lines[place] != was:
            raise ValueError(f"{self.file}:{self.line} is not what the fault changes")
        lines[place] = self.now.split("\n")
        return "\n".join(lines)

    def diff(self, text: str) -> str:
        """Return the change of the file's text as a unified diff."""
        lines = difflib.unified_diff(
            text.splitlines(), self.changed(text).splitlines(), self.file, self.file, n=2, lineterm=""
        )
        return "\n".join(lines)


def in_turn(groups: Sequence[Sequence[Fault]], random: np.random.Generator) -> Iterator[Fault]:
    """Yield faults of every group in turn, in random order, so that small groups are tried as often as large ones."""
    queues = [[faults[k] for k in random.permutation(len(faults))] for faults in groups if faults]
    while any(queues):
        for queue in queues:
            if queue:
                yield queue.pop()


class Scratch:
    """A copy of the checkout's tested files in a new folder, in which one file at a time is faulty.

    It has links to the compiled simulations; new compiled files go into the copy alone.
    """

    def __init__(self, folder: Path, jobs: int = 1) -> None:
        self.folder = folder
        self.jobs = jobs
        self.sound: set[str] = set()  # tests that pass without a fault
        self.left_out: list[str] = []  # tests that fail without one
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
    def faulty(self, file: str, fault: Fault) -> Iterator[str]:
        """Put a fault into a file for a while; yields the file's right text."""
        text = (self.folder / file).read_text()
        self._put(file, fault.changed(text))
        try:
            yield text
        finally:
            self._put(file, text)

    def _put(self, file: str, text: str) -> None:
        """Write a file, and forget its compiled form, which a write within a second would leave valid."""
        path = self.folder / file
        path.write_text(text)
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
            compiled.unlink()

    def fate(self, file: str, fault: Fault, *stages: list[str]) -> str:
        """Run tests with a faulty file, stage by stage: 'caught by' the first that passes without, or 'survived'."""
        with self.faulty(file, fault) as text:
            for tests in stages:
                while tests and (failed := self._failed(tests)) is not None:
                    if failed and failed not in self.sound:
                        self._put(file, text)
                        broken = self._failed([failed]) is not None
                        self._put(file, fault.changed(text))
                        if broken:
                            log(f"{failed} fails without a fault, too: left out from here on")
                            self.left_out.append(failed)
                            continue
                        self.sound.add(failed)
                    return f"caught by {failed or 'a crash or a time-out'}"
        return "survived"

    def _failed(self, tests: list[str]) -> str | None:
        """Run tests to the first that fails; return it, "" when pytest itself ended, None when all passed."""
        cache = self.folder / ".faults_cache"
        recorded = cache / "v" / "cache" / "lastfailed"
        recorded.unlink(missing_ok=True)
        command = [
            sys.executable, "-m", "pytest", "-q", "-x", "-m", "not full", "--tb=no", "-o", f"cache_dir={cache}",
            "-o", f"faulthandler_timeout={TEST_S}", "-o", "faulthandler_exit_on_timeout=true",
            *(["-n", str(self.jobs)] if self.jobs > 1 and len(tests) > 1 else []), *tests,
            *(word for test in self.left_out for word in ("--deselect", test)),
        ]  # fmt: skip
        environment = {"LIPPMANN_SEED": "1908", **os.environ, "PYTHONPATH": str(self.folder / "host")}
        with subprocess.Popen(
            command, cwd=self.folder, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
        ) as process:  # fmt: skip
            try:
                said, _ = process.communicate(timeout=STAGE_S)
            except BaseException as error:
                os.killpg(process.pid, signal.SIGKILL)  # its own group: simulators and servers that tests started
                if isinstance(error, subprocess.TimeoutExpired):
                    return ""
                raise
        if process.returncode in (0, 5):  # 5: every test is left out
            return None
        if process.returncode == 4:  # wrong call
            raise LippmannError(f"pytest does not run in the copy: {said.strip().splitlines()[-1]}")
        return next(iter(json.loads(recorded.read_text())), "") if recorded.exists() else ""


def options(count: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the decorator that gives a command the options of both programs: --count, --seed and --report."""
    made = (
        click.option("--count", default=count, show_default=True, type=click.IntRange(1), help="Number of faults."),
        click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="Seed of the faults."),
        click.option("--report", default="docs/reports", show_default=True, help="Folder of the report."),
    )
    return lambda command: functools.reduce(lambda decorated, option: option(decorated), reversed(made), command)


def try_faults(
    faults: Iterator[Fault], count: int, fate: Callable[[Fault], str], same: Same
) -> list[tuple[Fault, str]]:
    """Try faults until `count` have a fate other than "refused"; return them with their fates.

    A fault that survived is "no fault", with the reason, when `same` has it.
    """
    rows: list[tuple[Fault, str]] = []
    for fault in faults:
        if len(rows) == count:
            break
        end = fate(fault)
        if end == "survived":
            reasons = [why for (file, text), why in same.items() if fault.file == file and text in fault.now]
            end = f"no fault: {reasons[0]}" if reasons else end
        log(f"{len(rows) + 1}/{count} {fault.file}:{fault.line} {end}: {_line(fault.now)}")
        if end != "refused":
            rows.append((fault, end))
    return rows


def _line(text: str) -> str:
    return " ".join(text.split())


def write_faults(
    folder: Path, name: str, title: str, text: str, rows: list[tuple[Fault, str]], command: str, more: str = ""
) -> str:
    """Write the page `name`.md, with a table of the faults, and its CSV; return a line with the result.

    Parameters
    ----------
    folder, name, title
        Where to, and the heading.
    text
        What a fault is, and when it is caught.
    rows
        Faults with their fates.
    command
        The command that made them.
    more
        A part after the table.
    """
    survived = sum(end == "survived" for _, end in rows)
    same = sum(end.startswith("no fault") for _, end in rows)
    faults = len(rows) - same
    said = f"{faults - survived} of {faults} faults caught ({100.0 * (faults - survived) / max(faults, 1):.1f} %)"
    records = [
        {"file": fault.file, "line": fault.line, "was": _line(fault.was), "faulty": _line(fault.now), "fate": end}
        for fault, end in rows
    ]
    shown: dict[str, list[str]] = {key: [] for key in ("file", "line", "was", "faulty", "fate")}
    for record in records:
        for key, cell in record.items():
            words = f"`{cell}`" if key in ("was", "faulty") else str(cell)
            shown[key].append(words.replace("|", "\\|"))
    page = (
        f"# {title}\n\n{said}; {same} more changes are no faults: the results are the same, and the table says why. "
        f"{text}\n\n{table(shown)}{more}"
    )
    write_report(folder, name, provenance(command, ("verilator", "numpy")), page, {name: records})
    return f"{said}: {folder}/{name}.md"
