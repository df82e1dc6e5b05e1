"""Lints every RTL module separately with Verilator: `python -m tools.lint`, a part of `make lint`."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click
from lippmann.board.fpga_boards import FpgaBoard, fpga_boards
from lippmann.cli.output import log
from lippmann.simulation.toolchain import PREFIX, needed, repository, rtl_folders, rtl_sources, verilator_environment

from tools.program import program


def folder_of_modules() -> dict[str, str]:
    """Return the folders of the hand-written modules in rtl/, keyed by module name without the prefix."""
    paths = (path for path in rtl_sources(repository()) if path.parent.name != "registers")
    return {path.stem.removeprefix(PREFIX): path.parent.name for path in paths if not path.stem.endswith("_pkg")}


def elaborated(
    module: str, files: Sequence[Path], *options: str, parameters: Mapping[str, int | str], timeout: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Elaborate a module with Verilator, and return the finished run; `files` must begin with the packages."""
    command = ["verilator_bin", "--lint-only", *options, "--top-module", module]
    command += [*(f"-G{name}={value}" for name, value in parameters.items()), *map(str, files)]
    environment = verilator_environment()
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=timeout)


def lint(module: str, parameters: Mapping[str, int | str] | None = None) -> subprocess.CompletedProcess[str]:
    """Elaborate a module with all warnings from the files of its own folder and of the folders below it."""
    top = repository()
    sources: list[Path] = []
    for folder_files in rtl_folders(top).values():
        sources += folder_files
        if any(path.stem == PREFIX + module for path in folder_files):
            break
    packages_first = sorted(sources, key=lambda path: not path.stem.endswith("_pkg"))
    files = [top / "rtl" / "registers" / "lint.vlt", *needed(PREFIX + module, packages_first)]
    return elaborated(PREFIX + module, files, "-Wall", parameters=parameters or {}, timeout=60)


def lint_board(board: FpgaBoard) -> subprocess.CompletedProcess[str]:
    """Elaborate an FPGA board's top module with all warnings; the vendor's cells are black boxes."""
    top = repository()
    own = {path.stem: path for folder in board.folders for path in sorted(folder.glob("*.sv"))}
    settings = [top / "rtl" / folder / "lint.vlt" for folder in ("registers", "ecp5")]
    files = needed(board.top, {path.stem: path for path in rtl_sources(top)} | own)
    return elaborated(board.top, [*settings, *files, top / "rtl" / "ecp5" / "black_boxes.v"], "-Wall", parameters={})


@program
def main() -> None:
    """Lint every module and every FPGA board with default parameters; exit with code 1 if Verilator warns.

    Example: python -m tools.lint
    """
    modules, boards = sorted(folder_of_modules()), fpga_boards()
    bad = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        runs = [*pool.map(lint, modules), *pool.map(lint_board, boards.values())]
    for name, run in zip([*modules, *boards], runs, strict=True):
        if run.returncode or run.stderr.strip():
            bad.append(name)
            click.echo(run.stderr, err=True)
    good = f"{len(modules)} RTL modules and {len(boards)} boards: no warning"
    log(f"{', '.join(bad)}: correct the warnings above" if bad else good)
    sys.exit(bool(bad))
