"""cocotb under Verilator for pytest: compile a bench once, run its cocotb tests, fail when one fails or none ran.

Two departures from cocotb's own runner: `--public-flat-rw`, which makes every signal of the design public and costs
minutes of compilation, gives way to a control file that names the ports; and a bench is compiled as all RTL of the
project is (lippmann.simulation.compilation), from the files that its top needs.
"""

import os
import secrets
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

import cocotb_tools.config
from cocotb_tools.check_results import get_results
from cocotb_tools.runner import Verilator
from lippmann.simulation.compilation import SHORT, cached_file, verilated
from lippmann.simulation.toolchain import PREFIX, needed, repository, rtl_sources

TOP = repository()
BUILD = TOP / "build" / "rtl-tests"
CHECKS = TOP / "sim" / "checks"
#: Verilator's options for a bench.
OPTIONS = (
    "-Wno-fatal", "-Wno-lint", "-Wno-style", "--x-initial", "unique", "--assert", "--timescale", "1ns/1ps",
)  # fmt: skip
#: Where asserts say what differed. By itself cocotb has pytest rewrite every module, numpy's too: a second each run.
ASSERTS = "cocotb_*.py *_frames.py packets*.py streams.py neighbours.py"


def seed() -> int:
    """The seed of this test: LIPPMANN_SEED, or another each time. Printed, for pytest shows it when the test fails."""
    value = int(os.environ.get("LIPPMANN_SEED") or secrets.randbits(32))
    print(f"seed: LIPPMANN_SEED={value}")
    return value


def full_name(module: str) -> str:
    """The name in SystemVerilog of a module of rtl/, which has a prefix, or of a bench."""
    return PREFIX + module if list((TOP / "rtl").glob(f"*/{PREFIX}{module}.sv")) else module


class Compiled(Verilator):
    """cocotb's runner for a program that Verilator's model was compiled to."""

    def __init__(self, program: Path) -> None:
        super().__init__()
        self._program = program

    def _test_command(self) -> list[list[str]]:
        return [[str(self._program), *self.test_args, *self.plusargs]]


def compiled(
    top: str,
    parameters: Mapping[str, int | str] | None = None,
    bench: str = "",
    name: str | None = None,
    main: Path | None = None,
) -> Path:
    """Compile a top with its parameters, unless that was done; return the program.

    The top is a module of rtl/, named without its prefix, or one of `bench`, the text of SystemVerilog modules beside
    those of rtl/. `main` is the C++ that drives the top where cocotb does not. Beside every instance of a module that
    has a file in sim/checks, the assertions of that file run.
    """
    parameters = parameters or {}
    name = name or "-".join([top, *(f"{key}{value}".replace("'", "") for key, value in parameters.items())])
    module = full_name(top)
    sources = needed(bench or module, rtl_sources(TOP))
    sources += [CHECKS / f"{path.stem}_checks.sv" for path in sources if (CHECKS / f"{path.stem}_checks.sv").exists()]
    options, link = list(OPTIONS), []
    # A C++ main is through before an optimiser would be.
    flags = SHORT if main is None else ("-O0",)
    if main is None:
        main = cocotb_tools.config.share_dir / "lib" / "verilator" / "verilator.cpp"
        libraries = cocotb_tools.config.libs_dir
        options.append("--vpi")
        link = [f"-Wl,-rpath,{libraries}", f"-L{libraries}", "-lcocotbvpi_verilator"]
    ports = f'`verilator_config\npublic_flat_rw -module "{module}" -var "*"\n' if link else ""

    def make(program: Path) -> None:
        beside = {"bench.sv": bench, "ports.vlt": ports}
        for file, text in beside.items():
            program.with_name(file).write_text(text)
        files = [*sources, *(program.with_name(file) for file, text in beside.items() if text)]
        verilated(program, module, files, [main], parameters, options=options, flags=flags, link=link)

    inputs = [*sources, main, bench, *map(repr, (top, parameters, options, flags)), *link, version("cocotb")]
    return cached_file(BUILD / name, inputs, make)


def seed_options(seed: int) -> list[str]:
    """The options with which a compiled bench draws what its registers hold at first."""
    return [f"+verilator+seed+{seed % (1 << 31) or 1}", "+verilator+rand+reset+2"]


def simulate(
    program: Path,
    top: str,
    module: str,
    seed: int,
    environment: Mapping[str, str] | None = None,
    plusargs: Mapping[str, object] | None = None,
) -> None:
    """Run the cocotb tests of a Python module on a compiled bench; tell what it printed if one fails, or none ran."""
    case = os.environ["PYTEST_CURRENT_TEST"].split(" ")[0].rsplit("/", 1)[-1]
    work = BUILD / "runs" / "".join(c if c.isalnum() or c in "-_." else "-" for c in case)
    work.mkdir(parents=True, exist_ok=True)
    log = work / "simulation.log"
    results = work / "results.xml"
    runner = Compiled(program)
    try:
        runner.test(
            test_module=module,
            hdl_toplevel=full_name(top),
            hdl_toplevel_lang="verilog",
            build_dir=program.parent,
            test_dir=work,
            results_xml=str(results),
            seed=seed,
            test_args=seed_options(seed),
            plusargs=[f"+{key}={value}" for key, value in (plusargs or {}).items()],
            log_file=log,
            extra_env={
                **(environment or {}),
                "LIPPMANN_SEED": str(seed),
                "COCOTB_ANSI_OUTPUT": "0",
                "COCOTB_REWRITE_ASSERTION_FILES": ASSERTS,
                "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            },
        )
    except (SystemExit, RuntimeError) as error:
        raise AssertionError(f"cocotb: {error}, seed {seed}\n{_tail(log)}") from None
    ran, failed = get_results(results)
    assert ran > 0, f"no cocotb test ran\n{_tail(log)}"
    assert failed == 0, f"{failed} of {ran} cocotb tests failed, seed {seed}\n{_tail(log)}"


def run_cocotb(
    top: str,
    parameters: Mapping[str, int | str] | None = None,
    bench: str = "",
    name: str | None = None,
    environment: Mapping[str, str] | None = None,
    tests: str = "",
) -> None:
    """Compile a top and run its cocotb tests, which find its parameters in `cocotb.plusargs`.

    `tests` is the Python module that holds them, where its name does not follow from the top's.
    """
    tests = tests or f"cocotb_{top.removesuffix('_bench')}"
    simulate(compiled(top, parameters, bench, name), top, tests, seed(), environment, parameters)


def _tail(log: Path, lines: int = 60) -> str:
    return "\n".join(log.read_text().splitlines()[-lines:]) if log.exists() else "(no log)"
