"""Puts faults into the RTL, one at a time, and counts the faults that tests catch (`make mutation`).

In a copy of the checkout, a fault changes one operator, condition, choice or bit of a number in a line of a
hand-written module. Lines that describe no hardware are not changed. The module's own tests, tests/rtl/<module>, run
first (for a package, the tests of the modules in its folder), then the tests of larger designs. A fault is caught if a
test fails with it and passes without it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import click
from lippmann.cli.frame import option
from lippmann.simulation.toolchain import PREFIX, repository, rtl_sources, verilator_environment

from tools.lint import elaborated
from tools.mutation_runner import Fault, Scratch, Trial, read_equivalent_faults, report_faults
from tools.program import program

SOURCES = Path("rtl")
#: Tests that run last, keyed by the module's folder: larger designs are compared with the twin or get random requests.
BATCH = ["tests/rtl/test_batch.py"]
BOARD = ["tests/system/test_random_requests.py", "tests/system/test_board_requests.py"]
LAST = {
    "bus": ["tests/rtl/bus"],
    "common": [*BATCH, *BOARD],
    "math": BATCH,
    "optics": [*BATCH, "tests/rtl/optics_block", "tests/rtl/test_conditioning_registers.py"],
    "scene": ["tests/rtl/scene", "tests/rtl/scene_block", *BOARD],
}
#: Modules and packages without own tests, each with the module whose tests cover it.
WITHIN = {
    **dict.fromkeys(("request_reader", "request_order", "register_access", "ray_access"), "dispatcher"),
    **dict.fromkeys(("table_reader", "reply_builder"), "dispatcher"),
    **dict.fromkeys(("word_join", "word_split"), "sdram_store"),
    **dict.fromkeys(("wide_product", "mult18", "low_product"), "multiplier"),
    "block_ring": "delay",
    "byte_square": "texel_blend",
    "cobs_encoder": "packet_out",
    "config_bank": "ray_stream",
    "frame_store": "block_store",
    "gated_sum": "digit_product",
    "link_pkg": "packet_out",
    "math_pkg": "multiplier",
    "optics_pkg": "ray_stream",
    "panel_pkg": "test_pattern",
}

#: Faults that no test can detect, because the results do not change.
SAME = read_equivalent_faults("rtl")

#: Operators, each with the wrong operator that replaces it.
SWAPS = {
    " + ": " - ",
    " - ": " + ",
    " * ": " + ",
    " < ": " <= ",
    " >= ": " > ",
    " <= ": None,  # usually an assignment
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
    """Return a Verilog literal ('d, 'b, '0 or '1) with its lowest bit flipped."""
    for head, digits in ((match[1], match[2]), (match[3], match[4])):
        if head:
            return f"{head}{digits[:-1]}{int(digits[-1]) ^ 1}" if head.endswith("b") else f"{head}{int(digits) ^ 1}"
    return f"'{int(match[5]) ^ 1}"


#: Patterns of code that faults change, with functions that return the replacement (None: no change).
CHANGES: tuple[tuple[str, Callable[[re.Match[str]], str | None]], ...] = (
    ("|".join(re.escape(operator) for operator in sorted(SWAPS, key=len, reverse=True)), lambda m: SWAPS[m[0]]),
    (r"\bif \((?=\w+\))", lambda m: f"{m[0]}!"),
    (r"(?<=[ (,{])[!~](?=[\w(])|(?<=[(?:] )-(?=\w)|(?<=\()-(?=\w)", lambda m: ""),
    (r"\? ([^?:;]+) : ([^?:;,]+)(?=[;,]|$)", lambda m: f"? {m[2]} : {m[1]}"),
    (r"(?<![\w'.$])(\d+)(?![\w'.])", lambda m: str(int(m[0]) ^ 1)),
    (r"(\d+'s?d)(\d+)|(\d+'b)([01]+)|'([01])(?!\d)", _flipped),
)
#: Lines that get no faults: not hardware, or declarations (wider words change nothing, narrower ones do not elaborate).
NO_HARDWARE = re.compile(
    r"unused|\$fatal|gen_illegal|^\s*\(\*"
    r"|^\s*(//|import|module|endmodule|parameter|package|input|output|localparam int|logic|typedef)\b"
)


def faults_of(path: Path) -> list[Fault]:
    """Return all faults for a file: one for each operator, condition, choice and number (its lowest bit)."""
    faults: list[Fault] = []
    illegal = False
    lines = path.read_text().splitlines()
    for number, (text, following) in enumerate(zip(lines, [*lines[1:], ""], strict=True), 1):
        # An elaboration check extends from its condition, which may be a line before the block's name, to `end`.
        begins = "gen_illegal" in text or ("gen_illegal" in following and text.lstrip().startswith("if ("))
        illegal = begins or (illegal and "end" not in text)
        code = text.split("//")[0]
        if not illegal and code.strip() and not NO_HARDWARE.search(code):
            file = str(SOURCES / path.parent.name / path.name)
            faults += [
                Fault(file, number, text, code[: match.start()] + changed + code[match.end() :])
                for pattern, change in CHANGES
                for match in re.finditer(pattern, code)
                if (changed := change(match)) is not None
            ]
    return faults


def fate(fault: Fault, scratch: Scratch) -> str:
    """Return a fault's fate: "caught by" a test, "survived", or "refused" if the module no longer elaborates."""
    path = Path(fault.file)
    module = path.stem.removeprefix(PREFIX)
    top = PREFIX + WITHIN.get(module, module)
    with scratch.faulty(fault):
        files = [scratch.folder / "rtl/registers/lint.vlt", *rtl_sources(scratch.folder)]
        if elaborated(top, files, "-Wno-fatal", parameters={}).returncode:
            return "refused"
    near = f"tests/rtl/{WITHIN.get(module, module)}"
    stages = [[near]] if (scratch.folder / near).is_dir() else []
    # Modules in the package's folder use the package.
    if module.endswith("_pkg"):
        users = (f"tests/rtl/{user.stem.removeprefix(PREFIX)}" for user in sorted(path.parent.glob("*.sv")))
        stages.append([user for user in users if (scratch.folder / user).is_dir()])
    return scratch.fate(fault, [*stages, LAST.get(path.parent.name, BOARD)])


@program
def main(
    count: int = option("Number of faults.", 120, click.IntRange(1)),
    trial: Trial = Trial,  # type: ignore[assignment]
) -> None:
    """Put faults into the RTL, and report how many faults the quick tests catch.

    Example: python -m tools.mutation --count 20 --report out
    """
    # Stop here without Verilator, or every fault would seem caught.
    verilator_environment()
    own = [path for path in rtl_sources(repository()) if path.parent.name != "registers"]
    groups = {path.stem.removeprefix(PREFIX): faults_of(path) for path in own}
    report_faults("mutation", groups, fate, SAME, count, trial)
