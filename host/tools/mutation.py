"""Puts faults into the RTL one at a time and counts how many faults the tests catch (`make mutation`).

A fault changes one operator, condition, choice or bit of a number in a line of a hand-written module, in a copy of the
checkout; lines without hardware are not changed. The tests of the module, tests/rtl/<module>, run first (for a package,
the tests of its folder's modules), then the tests of larger designs. A fault is caught when a test fails that passes
without the fault.
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
#: The tests that run last, by folder: tests of larger designs, which are compared with the twin or get random requests.
BATCH = ["tests/rtl/test_batch.py"]
BOARD = ["tests/system/test_random_requests.py", "tests/system/test_board_requests.py"]
LAST = {
    "bus": ["tests/rtl/bus"],
    "common": [*BATCH, *BOARD],
    "math": BATCH,
    "optics": [*BATCH, "tests/rtl/optics_block", "tests/rtl/test_conditioning_registers.py"],
    "scene": ["tests/rtl/scene", "tests/rtl/scene_block", *BOARD],
}
#: Modules that are tested as parts of another module, and packages.
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
    """Return a sized number with its lowest bit flipped. The number is decimal, binary, or has all bits equal."""
    for head, digits in ((match[1], match[2]), (match[3], match[4])):
        if head:
            return f"{head}{digits[:-1]}{int(digits[-1]) ^ 1}" if head.endswith("b") else f"{head}{int(digits) ^ 1}"
    return f"'{int(match[5]) ^ 1}"


#: Pattern of a change in a line, and the replacement text (None: no change).
CHANGES: tuple[tuple[str, Callable[[re.Match[str]], str | None]], ...] = (
    ("|".join(re.escape(operator) for operator in sorted(SWAPS, key=len, reverse=True)), lambda m: SWAPS[m[0]]),
    (r"\bif \((?=\w+\))", lambda m: f"{m[0]}!"),
    (r"(?<=[ (,{])[!~](?=[\w(])|(?<=[(?:] )-(?=\w)|(?<=\()-(?=\w)", lambda m: ""),
    (r"\? ([^?:;]+) : ([^?:;,]+)(?=[;,]|$)", lambda m: f"? {m[2]} : {m[1]}"),
    (r"(?<![\w'.$])(\d+)(?![\w'.])", lambda m: str(int(m[0]) ^ 1)),
    (r"(\d+'s?d)(\d+)|(\d+'b)([01]+)|'([01])(?!\d)", _flipped),
)
#: Lines without hardware, and declarations: a wider word gives the same hardware, a narrower word does not elaborate.
NO_HARDWARE = re.compile(
    r"unused|\$fatal|gen_illegal|^\s*\(\*"
    r"|^\s*(//|import|module|endmodule|parameter|package|input|output|localparam int|logic|typedef)\b"
)


def faults_of(path: Path) -> list[Fault]:
    """Return every fault of a file: one fault for each operator, condition, choice and number (its lowest bit)."""
    faults: list[Fault] = []
    illegal = False
    lines = path.read_text().splitlines()
    for number, (text, following) in enumerate(zip(lines, [*lines[1:], ""], strict=True), 1):
        # An elaboration check reaches from its condition, possibly a line before the block's name, to the `end`.
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
    """Return a fault's fate: 'caught' with the failed test, 'survived', or 'refused' if it does not elaborate."""
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


@program
def main(
    count: int = option("Number of faults.", 120, click.IntRange(1)),
    trial: Trial = Trial,  # type: ignore[assignment]
) -> None:
    """Put faults into the RTL and report how many the quick tests catch.

    Example: python -m tools.mutation --count 20 --report out
    """
    verilator_environment()  # a missing tool must not count as a caught fault
    own = [path for path in rtl_sources(repository()) if path.parent.name != "registers"]
    groups = {path.stem.removeprefix(PREFIX): faults_of(path) for path in own}
    report_faults("mutation", groups, fate, SAME, count, trial)
