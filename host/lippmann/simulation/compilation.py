"""Compiles RTL with Verilator to a program or a library, and caches the result.

The compiler gets Verilator's C++ as one file, which compiles and runs faster.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from lippmann.base.files import is_full, moved, no_space, partial_folder
from lippmann.base.machine import features
from lippmann.base.programs import run_program
from lippmann.errors import LippmannError, input_error, to_install
from lippmann.simulation.toolchain import build_folder, hardware, verilator_environment, verilator_version

#: C++ compiler flags for a fast simulation. Hidden symbols allow inlining.
FAST = ("-O3", "-march=native", "-fvisibility=hidden")
#: C++ compiler flags for a simulation that is shorter than its compilation.
SHORT = ("-O1",)
#: Verilator options for a fast model without assertions.
UNCHECKED = ("--x-assign", "fast", "--x-initial", "fast", "--noassert")
#: Verilator options for a netlist: short C++ functions compile fast.
NETLIST = ("--output-split-cfuncs", "1000")

#: Environment variables: folder for coverage data, switch for toggle coverage.
COVERAGE, TOGGLES = "LIPPMANN_COVERAGE", "LIPPMANN_TOGGLES"

#: C++ include lines that every model needs.
HEADERS = '#include "verilated.h"\n#include "verilated_vpi.h"\n'

#: The text by which a compiler reports a full disk.
NO_SPACE = os.strerror(errno.ENOSPC)

# With -fno-gnu-unique, each library has its own copy of Verilator's runtime variables.
_ALWAYS = ("-std=gnu++17", "-fPIC", "-fno-gnu-unique", "-DVM_SC=0")


class RtlError(LippmannError):
    """Verilator or the compiler reports an error in the RTL."""

    exit_code = 3


def cached_file(path: Path, inputs: Iterable[Path | str], make: Callable[[Path], None], suffix: str = "") -> Path:
    """Return the path of a cached file; if it is missing, `make` writes it completely or not at all.

    One process makes the file and the others wait. The file name consists of `path`'s
    name, a hash (of inputs, processor and Verilator), and the suffix.
    """
    always = " ".join(sorted(features())) + verilator_version()
    key = hashlib.sha256(always.encode() + Path(__file__).read_bytes())
    key.update("".join(_counters()).encode())
    for one in inputs:
        key.update(b"\0" + (one.read_bytes() if isinstance(one, Path) else one.encode()))
    target = path.with_name(f"{path.name}-{key.hexdigest()[:16]}{suffix}")
    if not target.exists():
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            lock = target.with_name(f"{target.name}.lock").open("w")
        except OSError as error:
            if is_full(error):
                raise no_space(str(target.parent), error.strerror) from None
            why = f"compiled simulations cannot be stored there ({error.strerror})"
            raise input_error(target.parent, why, "make the folder writable, or set XDG_CACHE_HOME") from None
        with lock:
            import fcntl  # only on Unix

            fcntl.flock(lock, fcntl.LOCK_EX)  # keeps out other processes and other threads
            if not target.exists():
                with partial_folder(target) as work:
                    make(work / target.name)
                    moved(work / target.name, target)
    return target


def verilated(
    output: Path,
    top: str,
    sources: Sequence[Path],
    main: Sequence[Path],
    parameters: Mapping[str, int | str] | None = None,
    *,
    options: Sequence[str] = (),
    flags: Sequence[str] = FAST,
    link: Sequence[str] = (),
) -> None:
    """Compile RTL, and the C++ that drives it, to a program, or to a library if `output` ends in .so.

    `sources` are SystemVerilog files, packages first, and Verilator's control files.
    The C++ files `main` use the class `Vtop` of Vtop.h. `options`, `flags` and `link`
    are for Verilator, compiler and linker. Raises MissingLibraryError if a tool is
    missing, and RtlError with the first compilation error.
    """
    with partial_folder(output) as work:
        if _counters():
            (work / "bind.sv").write_text(f"bind {top} coverage i_coverage();\n")
            sources = [*sources, hardware() / "sim" / "coverage" / "coverage.sv", work / "bind.sv"]
            options = [*options, *_counters()]
            flags = [*flags, "-DVM_COVERAGE=1"]
        model = ["--cc", "--prefix", "Vtop", "-Mdir", str(work), "--top-module", top, "-O3"]
        values = [f"-G{name}={value}" for name, value in (parameters or {}).items()]
        _run(["verilator_bin", *model, *options, *values, *map(str, sources)])
        parts = sorted(work.glob("Vtop*.cpp"))
        process = "#include <unistd.h>\n" if _counters() else ""
        (work / "all.cpp").write_text(process + "".join(map(_include, [*parts, *main])))
        listed = (work / "Vtop_classes.mk").read_text().partition("VM_GLOBAL_FAST")[2]
        runtime = re.findall(r"verilated\w*", listed)
        headers = Path(verilator_environment()["VERILATOR_ROOT"], "include")
        common = [*_ALWAYS, f"-I{headers}", f"-I{headers / 'vltstd'}"]
        places = [f"-I{work}", *(f"-I{path}" for path in {path.parent for path in main})]
        # All models share precompiled headers, which do not depend on macros.
        shared = [flag for flag in flags if not flag.startswith("-D")]
        prefix = ["-include", str(_precompiled([*common, *shared]))]
        _run(["g++", *common, *flags, *prefix, *places, "-c", str(work / "all.cpp"), "-o", str(work / "all.o")])
        objects = [str(_runtime(headers / f"{name}.cpp", [*common, "-O1"])) for name in runtime]
        kind = ["-shared", "-Wl,-Bsymbolic"] if output.suffix == ".so" else []
        libraries = [*link, "-lpthread", *(["-llz4", "-lz"] if "verilated_fst_c" in runtime else [])]
        _run(["g++", *kind, str(work / "all.o"), *objects, *libraries, "-o", str(output)])


def _counters() -> list[str]:
    if not os.environ.get(COVERAGE):
        return []
    return ["--coverage-line", *(["--coverage-toggle"] if os.environ.get(TOGGLES) else [])]


def _runtime(source: Path, flags: Sequence[str]) -> Path:
    def make(path: Path) -> None:
        _run(["g++", *flags, "-c", str(source), "-o", str(path)])

    return cached_file(build_folder() / "verilator" / source.stem, [source, *flags], make, ".o")


def _precompiled(flags: Sequence[str]) -> Path:
    """Compile Verilator's headers, and return the path to include.

    g++ finds the precompiled file at this path plus .gch, if the flags are the same.
    """

    def make(path: Path) -> None:
        text = path.with_suffix(".txt")
        text.write_text(HEADERS)
        _run(["g++", *flags, "-x", "c++-header", str(text), "-o", str(path)])

    path = build_folder() / "verilator" / "headers"
    return cached_file(path, [HEADERS, *flags], make, ".h.gch").with_suffix("")


def _include(path: Path) -> str:
    line = f'#include "{path}"\n'
    if not path.stem.endswith("__Slow"):
        return line
    return f'#pragma GCC push_options\n#pragma GCC optimize ("O0")\n{line}#pragma GCC pop_options\n'


def _run(command: Sequence[str]) -> None:
    result = run_program(command, environment=verilator_environment())
    if result.returncode:
        lines = (result.stderr + result.stdout).strip().splitlines()
        errors = (line for line in lines if "rror" in line or "undefined" in line)
        wrong = next(errors, lines[-1] if lines else "no message")
        if any(NO_SPACE in line for line in lines):
            raise no_space(command[-1], f"{Path(command[0]).name}: {NO_SPACE}")
        raise RtlError(f"the RTL does not compile ({wrong.strip()}); correct the RTL, or {to_install('rtl')}")
