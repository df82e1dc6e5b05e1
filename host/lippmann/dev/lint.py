"""Lints every RTL module alone with Verilator: `python -m lippmann.dev.lint`, a part of `make lint`."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click

from lippmann.cli import run
from lippmann.cli.output import log
from lippmann.sim.tools import PREFIX, needed, repository, rtl_folders, rtl_sources, verilator_environment


def folder_of_modules() -> dict[str, str]:
    """Return the hand-written modules of rtl/, without their prefix, each with its folder."""
    paths = (path for path in rtl_sources(repository()) if path.parent.name != "registers")
    return {path.stem.removeprefix(PREFIX): path.parent.name for path in paths if not path.stem.endswith("_pkg")}


def elaborated(
    module: str, files: Sequence[Path], *options: str, parameters: Mapping[str, int | str], timeout: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Elaborate a module with Verilator; packages come first in `files`. The time-out is in seconds."""
    command = ["verilator_bin", "--lint-only", *options, "--top-module", module]
    command += [f"-G{name}={value}" for name, value in parameters.items()]
    command += map(str, files)
    environment = verilator_environment()
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=timeout)


def lint(module: str, parameters: Mapping[str, int | str] | None = None) -> subprocess.CompletedProcess[str]:
    """Elaborate a module alone, with all warnings, from the files that it needs.

    Only its folder is searched, and those that it may build upon. Raises MissingLibraryError without Verilator, and
    subprocess.TimeoutExpired after a minute: a refused module must not compute its tables first.
    """
    top = repository()
    found: list[Path] = []
    for some in rtl_folders(top).values():
        found += some
        if any(path.stem == PREFIX + module for path in some):
            break
    packages_first = sorted(found, key=lambda path: not path.stem.endswith("_pkg"))
    files = [top / "rtl" / "registers" / "lint.vlt", *needed(PREFIX + module, packages_first)]
    return elaborated(PREFIX + module, files, "-Wall", parameters=parameters or {}, timeout=60)


@click.command()
def main() -> None:
    """Lint every module with its default parameters; exit 1 when Verilator warns about one.

    Example: python -m lippmann.dev.lint
    """
    modules = sorted(folder_of_modules())
    bad = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lint, modules))
    for module, done in zip(modules, found, strict=True):
        if done.returncode or done.stderr.strip():
            bad.append(module)
            click.echo(done.stderr, err=True)
    log(f"{', '.join(bad)}: mend the warnings above" if bad else f"{len(modules)} RTL modules: no warning")
    sys.exit(bool(bad))


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))
