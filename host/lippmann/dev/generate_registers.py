"""Makes of rtl/registers.rdl what the RTL, the host and the documentation know of the registers.

`python -m lippmann.dev.generate_registers` (`make registers`) writes them.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from lippmann.cli import run
from lippmann.errors import InputError, MissingLibraryError
from lippmann.sim.tools import repository

SOURCE = Path("rtl/registers.rdl")
RTL = Path("rtl/registers")


@dataclass(frozen=True)
class _Map:
    """An address map, the part of it that becomes SystemVerilog, and where host and documentation have it."""

    name: str
    block: str
    constants: Path
    tables: Path
    preface: str
    base: int  # on the board


OPTICS = _Map(
    "optics_block",
    "optics_registers",
    Path("host/lippmann/fixed/registers.py"),
    Path("docs/reference/registers.md"),
    "32-bit words at byte addresses on an APB4 bus; an address that holds nothing, or an access that a register does "
    "not know, answers with an error. Signed fields are two's complement; F is the build's number of fraction bits. "
    "[optics-block.md](optics-block.md) says when commands take effect.",
    0x200,
)
BOARD = _Map(
    "board_registers",
    "board_registers",
    Path("host/lippmann/board/registers.py"),
    Path("docs/reference/board-registers.md"),
    "32-bit words at byte addresses, read and written by the packets READ and WRITE of [the protocol](protocol.md). "
    "The [optics block's registers](registers.md) are on the same board from address `0x200` on. Signed fields are "
    "two's complement.",
    0x000,
)

_BY = f"Generated from {SOURCE} by `make registers`; do not edit."


@dataclass(frozen=True)
class _Field:
    name: str
    low: int
    width: int
    access: str
    reset: int | None
    signed: bool
    fraction: str
    unit: str
    description: str
    names: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class _Register:
    """One register, or a memory of them; `title` and `group` are the headings of its table."""

    name: str
    group: str
    title: str
    address: int
    entries: int
    access: str
    description: str
    fields: tuple[_Field, ...]


def generate(top: Path, into: Path) -> list[Path]:
    """Write all that is made from the registers' definition in `top` into `into`; return the files, relative.

    Raises
    ------
    MissingLibraryError
        When PeakRDL or ruff is missing.
    InputError
        When the definition is wrong; PeakRDL has printed where.
    """
    try:
        from systemrdl.messages import RDLCompileError
    except ImportError:
        raise MissingLibraryError("PeakRDL is missing; run make setup") from None
    try:
        compiler = _compiler(top / SOURCE)
        files = []
        writable: set[int] = set()
        for part in (OPTICS, BOARD):
            files += _rtl(compiler.elaborate(part.block), into)
            whole = compiler.elaborate(part.name).top
            registers = list(_registers(whole))
            writable |= _writable(part, registers)
            for path, text in (
                (part.constants, _formatted(_constants(part, whole, registers))),
                (part.tables, _tables(part, whole, registers)),
            ):
                target = into / path
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(text)
                files.append(path)
        files.append(RTL / "board_map_pkg.sv")
        (into / files[-1]).write_text(_board_map(writable))
    except RDLCompileError:
        raise InputError(f"{SOURCE} is wrong: see the messages above") from None
    return files


def _compiler(source: Path) -> Any:
    from peakrdl_regblock.udps import ALL_UDPS  # type: ignore[import-untyped]
    from systemrdl.compiler import RDLCompiler

    compiler = RDLCompiler()
    for definition in ALL_UDPS:
        compiler.register_udp(definition, soft=True)
    compiler.compile_file(str(source))
    return compiler


def _rtl(root: Any, into: Path) -> list[Path]:
    """Write the register block and its package; optics_block puts an APB4 port before its plain one."""
    from peakrdl_regblock import RegblockExporter  # type: ignore[import-untyped]
    from peakrdl_regblock.cpuif.passthrough import PassthroughCpuif  # type: ignore[import-untyped]

    (into / RTL).mkdir(parents=True, exist_ok=True)
    files = []
    with tempfile.TemporaryDirectory() as work:
        RegblockExporter().export(
            root,
            work,
            cpuif_cls=PassthroughCpuif,
            default_reset_activelow=True,
            default_reset_async=True,
            reuse_hwif_typedefs=False,
            retime_read_fanin=True,
            err_if_bad_addr=True,
            err_if_bad_rw=True,
        )
        for made in sorted(Path(work).iterdir()):
            files.append(RTL / made.name)
            (into / RTL / made.name).write_text(f"// {_BY}\n{made.read_text().rstrip()}\n")
    return files


def _registers(node: Any, group: str = "", title: str = "", prefix: str = "") -> Iterator[_Register]:
    from systemrdl.node import AddrmapNode, MemNode, RegfileNode, RegNode

    for child in node.children(unroll=True):
        name = prefix + child.inst_name
        heading = child.get_property("name") if "name" in child.list_properties() else ""
        if isinstance(child, AddrmapNode):
            yield from _registers(child)
        elif isinstance(child, RegfileNode):
            yield from _registers(child, child.inst_name, heading, f"{name}_")
        elif isinstance(child, RegNode):
            yield _Register(
                name, group, title or heading, child.absolute_address, 1, _access(child), heading,
                tuple(_field(field) for field in child.fields()),
            )  # fmt: skip
        elif isinstance(child, MemNode):
            yield _Register(
                name, group, heading, child.absolute_address, child.get_property("mementries"), _access(child),
                _line(child.get_property("desc") or ""), (),
            )  # fmt: skip


def _access(node: Any) -> str:
    return {(True, True): "read, write", (True, False): "read", (False, True): "write"}[
        (
            node.has_sw_readable if hasattr(node, "has_sw_readable") else node.is_sw_readable,
            node.has_sw_writable if hasattr(node, "has_sw_writable") else node.is_sw_writable,
        )
    ]


def _field(node: Any) -> _Field:
    description = node.get_property("desc")
    if not description:
        raise InputError(f"{SOURCE}: field {node.get_path()} has no desc")
    names = tuple((member.value, member.name) for member in node.get_property("encode") or ())
    if names:
        description += f" {', '.join(f'{value} {name}' for value, name in names)}."
    return _Field(
        node.inst_name,
        node.low,
        node.width,
        _access(node),
        node.get_property("reset"),
        bool(node.get_property("is_signed")),
        node.get_property("fraction") or "",
        node.get_property("unit") or "",
        _line(description),
        names,
    )


def _line(text: str) -> str:
    return " ".join(text.split())


_TYPES = '''
from __future__ import annotations

from typing import NamedTuple


class Field(NamedTuple):
    """Bits `low` to `low + width - 1` of a register; `fraction` is the number of fraction bits, or its formula in F.

    Where only some values mean anything, `names` holds those and their names.
    """

    low: int
    width: int
    reset: int | None
    signed: bool
    fraction: str
    unit: str
    description: str
    names: tuple[tuple[int, str], ...] = ()


class Register(NamedTuple):
    """A register of 32 bits at a byte address, or a memory of `entries` of them."""

    address: int
    entries: int
    access: str
    fields: dict[str, Field]

'''

_IMPORTS = """
from __future__ import annotations

from lippmann.fixed.registers import Field, Register
"""


def _constants(part: _Map, top: Any, registers: list[_Register]) -> str:
    """Return the Python module, before its formatting."""
    lines = [f'"""Registers of the {top.get_property("name").lower()}.\n\n{_BY}\n"""\n']
    lines.append(_TYPES if part is OPTICS else _IMPORTS)
    lines.append("#: Registers by name, those of a group with the group's name in front.")
    lines.append("REGISTERS: dict[str, Register] = {")
    for register in registers:
        address = f"0x{register.address:03X}"
        lines.append(f"{register.name!r}: Register({address}, {register.entries}, {register.access!r}, {{")
        lines += [
            f"{field.name!r}: Field({field.low}, {field.width}, "
            f"{'None' if field.reset is None else hex(field.reset)}, {field.signed}, "
            f"{field.fraction!r}, {field.unit!r}, {field.description!r}{f', {field.names!r}' if field.names else ''}),"
            for field in register.fields
        ]
        lines.append("}),")
    lines.append("}\n")
    return "\n".join(lines)


def _writable(part: _Map, registers: list[_Register]) -> set[int]:
    """Return the board's addresses of words that can be written."""
    return {
        part.base + register.address + 4 * entry
        for register in registers
        if "write" in register.access
        for entry in range(register.entries)
    }


def _board_map(writable: set[int]) -> str:
    """Return the package that tells which words can be written, as ranges of addresses."""
    firsts = sorted(at for at in writable if at - 4 not in writable)
    lasts = sorted(at for at in writable if at + 4 not in writable)
    ranges = ",\n      ".join(f"[10'h{first:03X}:10'h{last:03X}]" for first, last in zip(firsts, lasts, strict=True))
    return (
        f"// {_BY}\n/// Which words of the board can be written, byte addresses.\npackage board_map_pkg;\n"
        f"  function automatic logic writable(logic [9:0] at);\n    return at inside {{\n      {ranges}\n    }};\n"
        "  endfunction\nendpackage\n"
    )


def _formatted(text: str) -> str:
    """Return Python text as ruff formats it."""
    command = ["ruff", "format", "--config", "line-length = 120", "--stdin-filename", "registers.py", "-"]
    beside = Path(sys.executable).parent / "ruff"
    if beside.exists():
        command[0] = str(beside)
    try:
        return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    except FileNotFoundError:
        raise MissingLibraryError("ruff is missing; run make setup") from None


def _tables(part: _Map, top: Any, registers: list[_Register]) -> str:
    """Return the register map as tables."""
    lines = [
        f"# Registers of the {top.get_property('name').lower()}\n\n<!-- {_BY} -->\n",
        f"{_line(top.get_property('desc'))} {part.preface}\n",
    ]
    heading = None
    for register in registers:
        if register.title != heading:
            heading = register.title
            group = f" (`{register.group}`)" if register.group else ""
            lines.append(f"\n## {heading}{group}\n")
            if not register.fields:
                last = register.address + 4 * register.entries - 1
                place = f"{register.entries} words from `0x{register.address:03X}` to `0x{last:03X}`"
                lines.append(f"`{register.name}`, {place}. {register.description}")
                continue
            lines.append("| address | register | bits | field | access | reset | format | unit | meaning |")
            lines.append("|---|---|---|---|---|---|---|---|---|")
        for field in register.fields:
            bits = f"{field.low + field.width - 1}:{field.low}" if field.width > 1 else f"{field.low}"
            kind = "signed" if field.signed else ""
            fraction = f"{field.fraction} fraction bits" if field.fraction else ""
            cells = (
                f"`0x{register.address:03X}`", f"`{register.name}`", bits, f"`{field.name}`", field.access,
                "" if field.reset is None else f"`0x{field.reset:X}`", ", ".join(filter(None, (kind, fraction))),
                field.unit, field.description,
            )  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


@click.command()
@click.argument("folder", required=False, type=click.Path(path_type=Path))
def main(folder: Path | None) -> None:
    """Write what is made of rtl/registers.rdl into the checkout, or into a FOLDER that stands for one.

    Example: python -m lippmann.dev.generate_registers
    """
    checkout = repository()
    for path in generate(checkout, folder or checkout):
        click.echo(path)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))
