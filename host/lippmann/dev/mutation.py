"""`make mutation`: puts faults into the RTL one at a time and counts how many of them the tests catch.

A fault changes one operator, negates one condition, swaps the branches of one choice, or flips one bit of one number
in one line of rtl/optics. The faulty RTL is compiled into the batch harness and compared with the twin, ray by ray,
over random displays, rays and stalls, as tests/rtl/test_batch.py does. A fault that passes, or that is in a module
outside the harness, goes to the tests of its module, tests/rtl/<module>, in a copy of the checkout. A fault is caught
when a word differs, rays stop coming, one build does not elaborate where others do, or a test fails.

Lines without hardware stay as they are: comments, elaboration checks, and lines that only silence the linter.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from lippmann.cli import run
from lippmann.dev.faults import Fault, Scratch, in_turn, options, try_faults, write_faults
from lippmann.dev.random_cases import configured_display, random_rays
from lippmann.errors import LippmannError
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.images import check_output
from lippmann.sim.compilation import RtlError
from lippmann.sim.harness import Harness, compile_library
from lippmann.sim.tools import optics_sources, repository, verilator_environment

#: The builds that a fault is tried in, until one shows it; together they instantiate every module.
BUILDS = (
    Build(20, "square"),
    Build(18, "hex", aims=True, max_cell_steps=1),
    Build(18, "square", viewer=True, aims=True, max_cell_steps=1),
    Build(17, "hex", "paraxial", aims=True),
    Build(19, "square", cross_cells=True),
    Build(23, "square", viewer=True),
)

#: Modules of rtl/optics that the harness does not contain.
OUTSIDE = ("optics_block", "raster")

#: Changes that no test can detect, because the results are the same: file, changed line, and the reason.
SAME = {
    ("meet_dome.sv", ".Wb(Wh), .Drop(SquareDrop), .Square(1'b0)) i_hx2 ("): "a square as a product of two equal words",
    ("delay.sv", "for (genvar k = 0; k <= Cycles; k++) begin : gen_stage"): "nobody reads a stage behind the last",
    ("enter_dome.sv", "clamped_q <= c_q < 1 ? '0"): "0 is 0 either way",
    ("fifo.sv", "- (AddressBits + 0)'(ask);"): "a bit is as large in a narrower word",
    ("pixel_to_panel.sv", "+ (2 * MulBits + 0)'(lo_v);"): "lo_v has so many bits",
    ("optics_pkg.sv", "f + 2 - segment_bits(f) <= MulBits"): "the smaller of two equal numbers is either",
    ("optics_pkg.sv", "return f < 14 ? 5"): "an F below 14 is refused by every module",
    ("cell_product.sv", "localparam logic [63:1] Low"): "the mask has fewer bits",
}

#: Operators, and the wrong one in place of each.
SWAPS = {
    " + ": " - ",
    " - ": " + ",
    " * ": " + ",
    " < ": " <= ",
    " >= ": " > ",
    " <= ": None,  # nearly always an assignment
    " == ": " != ",
    " != ": " == ",
    " && ": " || ",
    " || ": " && ",
    " ^ ": " | ",
    " <<< ": " >>> ",
    " >>> ": " <<< ",
    " << ": " >> ",
    " >> ": " << ",
}


def _flipped(match: re.Match[str]) -> str:
    """Return a sized number with its lowest bit flipped: decimal, binary, or all bits alike."""
    for head, digits in ((match[1], match[2]), (match[3], match[4])):
        if head:
            return f"{head}{digits[:-1]}{int(digits[-1]) ^ 1}" if head.endswith("b") else f"{head}{int(digits) ^ 1}"
    return f"'{int(match[5]) ^ 1}"


#: Places of a change in a line, and the text that comes there (None: leave it).
CHANGES: tuple[tuple[str, Callable[[re.Match[str]], str | None]], ...] = (
    ("|".join(re.escape(operator) for operator in sorted(SWAPS, key=len, reverse=True)), lambda m: SWAPS[m[0]]),
    (r"\bif \((?=\w+\))", lambda m: f"{m[0]}!"),
    (r"(?<=[ (,{])[!~](?=[\w(])|(?<=[(?:] )-(?=\w)|(?<=\()-(?=\w)", lambda m: ""),
    (r"\? ([^?:;]+) : ([^?:;,]+)(?=[;,]|$)", lambda m: f"? {m[2]} : {m[1]}"),
    (r"(?<![\w'.$])(\d+)(?![\w'.])", lambda m: str(int(m[0]) ^ 1)),
    (r"(\d+'s?d)(\d+)|(\d+'b)([01]+)|'([01])(?!\d)", _flipped),
)
#: Lines without hardware, and declarations: a wider word is the same hardware, a narrower one does not elaborate.
NO_HARDWARE = re.compile(
    r"unused|\$fatal|gen_illegal|^\s*\(\*"
    r"|^\s*(//|import|module|endmodule|parameter|package|input|output|localparam int|logic|typedef)\b"
)


def faults_of(path: Path) -> list[Fault]:
    """Return every fault of a file: one for each operator, condition, choice and number (its lowest bit)."""
    found: list[Fault] = []
    illegal = False
    lines = path.read_text().splitlines()
    for number, (text, following) in enumerate(zip(lines, [*lines[1:], ""], strict=True), 1):
        # An elaboration check goes from its condition, which may stand a line before the block's name, to the `end`.
        begins = "gen_illegal" in text or ("gen_illegal" in following and text.lstrip().startswith("if ("))
        illegal = begins or (illegal and "end" not in text)
        code = text.split("//")[0]
        if not illegal and code.strip() and not NO_HARDWARE.search(code):
            found += [Fault(path.name, number, text, changed) for changed in _changes(code)]
    return found


def _changes(code: str) -> list[str]:
    """Return a line of code with each single change."""
    return [
        code[: match.start()] + text + code[match.end() :]
        for pattern, change in CHANGES
        for match in re.finditer(pattern, code)
        if (text := change(match)) is not None
    ]


def fate(fault: Fault, seed: int, scratch: Scratch) -> str:
    """Return how a fault ends: 'refused' (does not elaborate), 'caught', or 'survived'."""
    file, module = f"rtl/optics/{fault.file}", fault.file.removesuffix(".sv")
    with scratch.faulty(file, fault):
        sources = optics_sources(scratch.folder)
        if module in OUTSIDE:
            if not _elaborates(sources):
                return "refused"
        else:
            ends = set()
            for build in (build for build in BUILDS if _uses(build, module)):
                library = scratch.folder / f"{os.urandom(6).hex()}.so"
                try:
                    compile_library(build, sources, library, flags=["-O0"])
                except RtlError:
                    ends.add("refused")
                    continue
                if not _equal(build, library, seed):
                    return "caught"
                ends.add("equal")
            if "refused" in ends:  # a build that no longer elaborates where others do fails the tests that compare it
                return "caught" if "equal" in ends else "refused"
    folder = module if (scratch.folder / "tests" / "rtl" / module).is_dir() else "ray_lenslet"
    return scratch.fate(file, fault, [f"tests/rtl/{folder}"])


def _elaborates(sources: list[Path]) -> bool:
    """Tell whether Verilator elaborates the register block and its modules."""
    command = ["verilator", "--lint-only", "-Wno-fatal", "--top-module", "optics_block", *map(str, sources)]
    return not subprocess.run(command, env=verilator_environment(), capture_output=True, check=False).returncode


def _uses(build: Build, module: str) -> bool:
    """Tell whether a build instantiates a module."""
    only = {
        "lenslet_square": build.grid == "square",
        "lenslet_hex": build.grid == "hex",
        "aim": build.aims,
        "cell_step": build.aims,
        "move_lenslet": build.max_cell_steps > 0,
        "enter_flat": build.model == "exact" and not build.viewer,
        "leave_dome": build.model == "exact" and not build.viewer,
        "enter_dome": build.viewer,
        "leave_flat": build.viewer,
        "meet_dome": build.model == "exact",
        "sqrt": build.model == "exact",
        "saturate": build.model == "exact",
    }
    return only.get(module, True)


def _equal(build: Build, library: Path, seed: int) -> bool:
    """Compare a faulty build with the twin, in a child process: a fault may hang or crash the simulation."""
    child = os.fork()
    if child == 0:
        os._exit(0 if _compare(build, library, seed) else 1)
    _, status = os.waitpid(child, 0)
    return status == 0


def _compare(build: Build, library: Path, seed: int) -> bool:
    engine = Harness(build, library)
    random = np.random.default_rng(seed)
    for number in range(12):
        display, config = configured_display(random, build, build.model)
        words = random_rays(random, display, build, 3000)
        idle, stall = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.4), (0.5, 0.5), (0.02, 0.9)][number % 5]
        try:
            rtl = engine.trace(*words, config, seed=number, idle=idle, stall=stall)
        except LippmannError:
            return False
        twin = ray_pipeline(*words, config, build)
        if any((got != wanted).any() for got, wanted in zip(rtl, twin, strict=True)):
            return False
    return True


@click.command()
@options(120)
def main(count: int, seed: int, report: str) -> None:
    """Put faults into the RTL and report how many the comparison with the twin catches.

    Example: python -m lippmann.dev.mutation --count 20 --report out
    """
    check_output(Path(report) / "mutation.md", (".md",))
    random = np.random.default_rng(seed)
    verilator_environment()  # a missing tool must not count as a caught fault
    files = sorted((repository() / "rtl" / "optics").glob("*.sv"))
    per_file = [faults_of(path) for path in files]
    with tempfile.TemporaryDirectory() as folder:
        scratch = Scratch(Path(folder))
        rows = try_faults(in_turn(per_file, random), count, lambda fault: fate(fault, seed, scratch), SAME)
    text = (
        "Each is one changed operator, one negated condition, one choice with its branches swapped, or one flipped bit;"
        " those that do not elaborate are not counted. A fault is caught when a word differs from the twin's, rays "
        "stop coming, one build does not elaborate where others do, or a test of its module fails."
    )
    command = f"make mutation (--count {count} --seed {seed})"
    click.echo(write_faults(Path(report), "mutation", "Faults in the RTL", text, rows, command))


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))
