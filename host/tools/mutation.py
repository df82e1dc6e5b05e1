"""`make mutation`: puts faults into the RTL one at a time and counts how many of them the tests catch.

A fault changes one operator, negates one condition, swaps the branches of one choice, or flips one bit of one number
in one line of a module of rtl/ that is written by hand. It is made in a copy of the checkout. The tests of its module,
tests/rtl/<module>, run first (a package: those of the modules beside it), then those of what the module is a part of. A
fault is caught when a test fails that passes without the fault.

Lines without hardware stay as they are: comments, elaboration checks, and lines that only silence the linter.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from lippmann.cli import run
from lippmann.simulation.toolchain import PREFIX, repository, rtl_sources, verilator_environment

from tools.lint import elaborated
from tools.source_faults import Fault, Scratch, options, report_faults

SOURCES = Path("rtl")
#: The tests that run last. Every module of the optics is in a build that is compared with the twin, but for the
#: register block; those of the board are in the whole board, which is asked for anything.
BATCH = ["tests/rtl/test_batch.py"]
BOARD = ["tests/system/test_random_requests.py", "tests/system/test_board_requests.py"]
LAST = {
    "bus": ["tests/rtl/bus"],
    "common": [*BATCH, *BOARD],
    "math": BATCH,
    "optics": [*BATCH, "tests/rtl/optics_block", "tests/rtl/test_conditioning_registers.py"],
    "scene": ["tests/rtl/scene", "tests/rtl/scene_block", *BOARD],
}
#: Modules that are tested as parts of another, and packages.
WITHIN = {
    **dict.fromkeys(
        ("request_reader", "request_order", "register_access", "ray_access", "table_reader", "reply_builder"),
        "dispatcher",
    ),
    "link_pkg": "packet_out",
    "math_pkg": "multiplier",
    "optics_pkg": "ray_stream",
    "panel_pkg": "test_pattern",
}

#: Changes that no test can detect, because the results are the same: file, changed line, and the reason.
SAME = {
    ("meet_dome.sv", ".Wb(Wh), .Drop(SquareDrop), .Square(1'b0)) i_hx2 ("): "a square as a product of two equal words",
    ("enter_flat.sv", ".Drop(SquareDrop), .Square(1'b0)) i_ty2 ("): "a square as a product of two equal words",
    ("blend.sv", "sum_q <= (Wp + 0)'(kx)"): "kx has so many bits, and a sum extends its words",
    ("lenslet_hex.sv", "j_q4 <= (IndexBits + 0)'(j0_q3)"): "j0_q3 has so many bits, and a sum extends its words",
    ("delay.sv", "for (genvar k = 0; k <= Cycles; k++) begin : gen_stage"): "nobody reads a stage behind the last",
    ("enter_dome.sv", "clamped_q <= c_q < 1 ? '0"): "0 is 0 either way",
    ("fifo.sv", "- (AddressBits + 0)'(ask);"): "a bit is as large in a narrower word",
    ("pixel_to_lattice.sv", "+ (2 * MulBits + 0)'(lo_v);"): "lo_v has so many bits",
    ("unit_slope.sv", ".Drop(SquareDrop), .Square(1'b0)) i_my2 ("): "a square as a product of two equal words",
    ("blend.sv", "sum_q + (Wp + 0)'(4)"): "4 has no more bits, and a sum extends its words",
    ("quadratic.sv", "+ (W1 + 0)'(turn)"): "turn has no more bits, and a sum extends its words",
    ("leave_flat.sv", "clamped_q <= c_q[Ws-1] ? '1 :"): "a reflected ray does not use the root",
    ("scene_block.sv", "layer <= Layers"): "an access beyond the last layer is refused, and its data mean nothing",
    ("texel_fetch.sv", "for (int m = 0; m <= Slots; m++)"): "a bit beyond the last slot has no place",
    ("ray_access.sv", "if (exit_valid_i || exit_ready_o) exit_q"): "rays are asked for one at a time",
    ("board_with_store.sv", "fraction_bits: 5'd17"): "a default: every board names its build",
    ("board_with_store.sv", "ModelExact), default: '1"): "a default: every board names its build",
    ("math_pkg.sv", "segment_bits(f) + 18 < f + 5"): "the smaller of two equal numbers is either",
    ("optics_pkg.sv", "mul_latency(f - 2, f + 2) + 1"): "the longer word decides a product's latency",
    ("delay.sv", "else if (Block) begin : gen_rings"): "the same delay, in the other kind of memory",
    ("aim.sv", "(j_late) + (IndexBits + 0)'(dj)"): "a sum extends its words",
    ("wishbone_to_apb.sv", "{3{asked}} & {ack_q, err_q}"): "the third bit has no place",
    ("math_pkg.sv", "tree > 2 ? tree : 3"): "the larger of two equal numbers is either",
    ("math_pkg.sv", "f + 2 - segment_bits(f) <= MulBits"): "the smaller of two equal numbers is either",
    ("math_pkg.sv", "return f < 14 ? 5"): "an F below 14 is refused by every module",
    ("wide_product.sv", "k <= Latency; k++) begin : gen_stage"): "nobody reads a stage behind the last",
    ("ring.sv", "initial at_q = '1;"): "it goes round from any place",
    ("wide_product.sv", "localparam logic [63:1] Low"): "the mask has fewer bits",
    ("lenslet_hex.sv", "assign near = q0_q[F+0:F] == '0"): "q0 = s + t/2 is below 1 where q1 = s/2 + t is below 1/2",
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
            found += [
                Fault(str(SOURCES / path.parent.name / path.name), number, text, changed) for changed in _changes(code)
            ]
    return found


def _changes(code: str) -> list[str]:
    """Return a line of code with each single change."""
    return [
        code[: match.start()] + text + code[match.end() :]
        for pattern, change in CHANGES
        for match in re.finditer(pattern, code)
        if (text := change(match)) is not None
    ]


def fate(fault: Fault, scratch: Scratch) -> str:
    """Return how a fault ends: 'caught', with the test that failed, 'survived', or 'refused': it does not elaborate."""
    path = Path(fault.file)
    module = path.stem.removeprefix(PREFIX)
    top = PREFIX + WITHIN.get(module, module)
    with scratch.faulty(fault):
        files = [scratch.folder / "rtl/registers/lint.vlt", *rtl_sources(scratch.folder)]
        if elaborated(top, files, "-Wno-fatal", parameters={}).returncode:
            return "refused"
    near = f"tests/rtl/{WITHIN.get(module, module)}"
    stages = [[near]] if (scratch.folder / near).is_dir() else []
    if module.endswith("_pkg"):  # the modules of the package's folder use it
        users = (f"tests/rtl/{user.stem.removeprefix(PREFIX)}" for user in sorted(path.parent.glob("*.sv")))
        stages.append([user for user in users if (scratch.folder / user).is_dir()])
    return scratch.fate(fault, [*stages, LAST.get(path.parent.name, BOARD)])


@click.command(params=options(120))
def main(**chosen: Any) -> None:
    """Put faults into the RTL and report how many the quick tests catch.

    Example: python -m tools.mutation --count 20 --report out
    """
    verilator_environment()  # a missing tool must not count as a caught fault
    own = [path for path in rtl_sources(repository()) if path.parent.name != "registers"]
    groups = {path.stem.removeprefix(PREFIX): faults_of(path) for path in own}
    report_faults("mutation", groups, fate, SAME, **chosen)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))
