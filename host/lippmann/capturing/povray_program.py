"""Finds and runs the program `povray`, and measures its time."""

from __future__ import annotations

import resource
import time
from dataclasses import dataclass
from pathlib import Path

from lippmann.base.programs import run_program
from lippmann.errors import input_error
from lippmann.simulation.toolchain import Tool

POVRAY = Tool("povray", "renders what `export povray` writes", "run sudo apt-get install -y povray, or see povray.org")


@dataclass(frozen=True)
class Run:
    """Cost of a run of POV-Ray, parsing included; the command line is that in the exported folder.

    `seconds` are wall clock, `cpu_seconds` the processor time of all threads.
    """

    command: str
    seconds: float
    cpu_seconds: float


def run_povray(ini: Path, *options: str) -> Run:
    """Render an exported folder's .ini file; options of POV-Ray override the file's.

    Raises InputError when POV-Ray refuses the files, with its first error; MissingLibraryError when POV-Ray is not
    installed.
    """
    program = POVRAY.path()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.perf_counter()
    command = [str(program), ini.name, *options]
    done = run_program(command, folder=ini.parent)
    seconds = time.perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        complaints = [line for line in done.stderr.splitlines() if "error" in line.lower()] or [
            "it ended without a message"
        ]
        raise input_error(str(ini), f"POV-Ray refuses it ({complaints[0].strip()})", "export it again")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(" ".join(["povray", ini.name, *options]), seconds, cpu)
