"""Writes RTL, host data and documentation of the registers from rtl/registers.rdl (`make registers`)."""

# Do not import lippmann.fixed.registers here: its data file, which this module writes, may be missing or invalid.

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import click
import jinja2
from lippmann.cli.frame import argument
from lippmann.errors import InputError, MissingLibraryError
from lippmann.simulation.toolchain import PREFIX, repository

from tools.program import program

SOURCE = Path("rtl/registers.rdl")
RTL = Path("rtl/registers")
DATA = Path("host/lippmann/fixed/generated")
PAGES = Path("docs/generated")
_BY = f"Generated from {SOURCE} by `make registers`; do not edit."
_SPDX = "// SPDX-License-Identifier: Apache-2.0\n"


class _Map(NamedTuple):
    """An address map of registers.rdl, and the files that are made from it."""

    name: str
    # Name of the map that becomes SystemVerilog: this map, or a part of it.
    rtl_map: str
    data: str  # file in DATA
    # Name of the file in PAGES, and of its template.
    page: str
    base: int  # the map's first address on the board


_MAPS = (
    _Map("optics_block", "optics_registers", "optics.json", "registers.md", 0x200),
    _Map("board_registers", "board_registers", "board.json", "board-registers.md", 0x000),
    _Map("scene_block", "scene_registers", "scene.json", "scene-registers.md", 0x400),
)

#: A register or a field as lippmann.fixed.registers reads it; keys with default values are left out.
_Entry = dict[str, Any]


def generate(top: Path, into: Path) -> list[Path]:
    """Write the files of registers.rdl (in `top`) into `into`; return paths; raise InputError if it is invalid."""
    try:
        from peakrdl_regblock.udps import ALL_UDPS  # type: ignore[import-untyped]
        from systemrdl.compiler import RDLCompiler
        from systemrdl.messages import RDLCompileError
    except ImportError:
        raise MissingLibraryError("PeakRDL is missing; run make setup") from None
    texts: dict[Path, str] = {}
    writable: set[int] = set()
    try:
        compiler = RDLCompiler()
        for definition in ALL_UDPS:
            compiler.register_udp(definition, soft=True)
        compiler.compile_file(str(top / SOURCE))
        for part in _MAPS:
            texts |= _rtl(compiler.elaborate(part.rtl_map))
            top_map = compiler.elaborate(part.name).top
            registers = dict(_registers(top_map))
            texts[DATA / part.data] = json.dumps({"comment": _BY, "registers": registers}, indent=1) + "\n"
            sections = [(title, list(some)) for title, some in groupby(registers.items(), lambda one: one[1]["title"])]
            description = _line(top_map.get_property("desc") or "")
            names = {"name": top_map.get_property("name").lower(), "description": description}
            texts[PAGES / part.page] = render_template(part.page, by=_BY, sections=sections, **names)
            writable |= {
                part.base + register["address"] + 4 * entry
                for register in registers.values()
                if "write" in register["access"]
                for entry in range(register.get("entries", 1))
            }
    except RDLCompileError:
        raise InputError(f"{SOURCE} is invalid; correct the errors listed above") from None
    firsts = sorted(at for at in writable if at - 4 not in writable)
    lasts = sorted(at for at in writable if at + 4 not in writable)
    ranges = [f"[11'h{first:03X}:11'h{last:03X}]" for first, last in zip(firsts, lasts, strict=True)]
    package = render_template("board_map_pkg.sv.jinja", by=_BY, prefix=PREFIX, ranges=ranges)
    texts[RTL / f"{PREFIX}board_map_pkg.sv"] = package
    for path, text in texts.items():
        (into / path).parent.mkdir(parents=True, exist_ok=True)
        (into / path).write_text(text)
    return list(texts)


def _rtl(root: Any) -> dict[Path, str]:
    """Return a map's register block, which is an APB4 completer, and its package."""
    from peakrdl_regblock import RegblockExporter  # type: ignore[import-untyped]
    from peakrdl_regblock.cpuif.apb4 import APB4_Cpuif_flattened  # type: ignore[import-untyped]

    with tempfile.TemporaryDirectory() as work:
        RegblockExporter().export(
            root,
            work,
            cpuif_cls=APB4_Cpuif_flattened,
            module_name=PREFIX + root.top.inst_name,
            default_reset_activelow=True,
            default_reset_async=True,
            reuse_hwif_typedefs=False,
            retime_read_fanin=True,
            err_if_bad_addr=True,
            err_if_bad_rw=True,
        )
        texts = {path.name: path.read_text().rstrip() for path in sorted(Path(work).iterdir())}
    block = f"{PREFIX}{root.top.inst_name}.sv"
    texts[block] = _registered_decode(texts[block])
    return {RTL / name: f"{_SPDX}// {_BY}\n{text}\n" for name, text in texts.items()}


def _registered_decode(block: str) -> str:
    """Return PeakRDL's register block with registers added behind its address decoder.

    The decoder drives the enables of all fields across the device; without the registers, this path limits the clock.
    An access takes one clock more; address and data are stable until the access is answered. A strobe is registered for
    writes only, because reads do not use it. Write data are masked by their bit enables before their register.
    """
    before, decode, after = re.split("    // (?:Address Decode|Field logic)\n", block)
    decode, counts = re.subn(r"(decoded_reg_strb\S* |decoded_err )= ", r"\1<= ", decode)
    decode = re.sub(r"(decoded_reg_strb\S* <= [^;]*\))(?: & cpuif_req_is_wr)?;", r"\1 & cpuif_req_is_wr;", decode)
    if re.search(r"decoded_reg_strb\S* <= (?![^;]*cpuif_req_is_wr;)", decode):
        raise InputError(
            "PeakRDL-regblock's address decoder has changed: its strobes do not separate writes from reads"
        )
    after = re.sub(r"(decoded_reg_strb\S*) && decoded_req_is_wr\)", r"\1)", after)
    after = re.sub(r"\((decoded_wr_data\S*) & decoded_wr_biten\S*\);", r"\1;", after)
    for old, new in (
        ("always_comb begin", "always_ff @(posedge clk) begin"),
        (" & decoded_req;", " & cpuif_req_masked;"),
        (
            "    assign decoded_req = cpuif_req_masked;\n    assign decoded_req_is_wr = cpuif_req_is_wr;\n",
            "    always_ff @(posedge clk or negedge arst_n) begin\n"
            "        if(~arst_n) {decoded_req, decoded_req_is_wr} <= '0;\n"
            "        else {decoded_req, decoded_req_is_wr} <= {cpuif_req_masked, cpuif_req_masked & cpuif_req_is_wr};\n"
            "    end\n",
        ),
        (
            "    assign decoded_wr_data = cpuif_wr_data;\n    assign decoded_wr_biten = cpuif_wr_biten;\n",
            "    always_ff @(posedge clk) begin\n"
            "        decoded_wr_data <= cpuif_wr_data & cpuif_wr_biten;\n"
            "        decoded_wr_biten <= cpuif_wr_biten;\n"
            "    end\n",
        ),
    ):
        if not counts or decode.count(old) != 1:
            raise InputError(f"PeakRDL-regblock's address decoder has changed: it does not contain {old.strip()!r}")
        decode = decode.replace(old, new)
    return f"{before}    // Address Decode\n{decode}    // Field logic\n{after}"


def _registers(node: Any, group: str = "", title: str = "") -> Iterator[tuple[str, _Entry]]:
    """Yield the name and entry of each register and memory in an address map or a group."""
    from systemrdl.node import AddrmapNode, MemNode, RegfileNode

    for child in node.children(unroll=True):
        heading = child.get_property("name") if "name" in child.list_properties() else ""
        if isinstance(child, AddrmapNode):
            yield from _registers(child)
            continue
        if isinstance(child, RegfileNode):
            yield from _registers(child, child.inst_name, heading)
            continue
        name = f"{group}_{child.inst_name}" if group else child.inst_name
        entry = {"address": child.absolute_address, "group": group, "title": title or heading}
        if isinstance(child, MemNode):
            entry["access"] = _access(child.is_sw_readable, child.is_sw_writable)
            entry["entries"] = child.get_property("mementries")
            entry["description"] = _line(child.get_property("desc") or "")
        else:
            entry["access"] = _access(child.has_sw_readable, child.has_sw_writable)
            entry["fields"] = {field.inst_name: _field(field, entry["access"]) for field in child.fields()}
        yield name, _without_defaults(entry)


def _access(readable: bool, writable: bool) -> str:
    return ", ".join(["read"] * readable + ["write"] * writable)


def _field(node: Any, access: str) -> _Entry:
    description = node.get_property("desc")
    if not description:
        raise InputError(f"{SOURCE}: field {node.get_path()} has no description; add desc")
    if _access(node.is_sw_readable, node.is_sw_writable) != access:
        raise InputError(f"{SOURCE}: field {node.get_path()} must have its register's access, {access}")
    names = [(member.value, member.name) for member in node.get_property("encode") or ()]
    if names:
        description += f" {', '.join(f'{value} {name}' for value, name in names)}."
    entry = {"low": node.low, "width": node.width, "reset": node.get_property("reset")}
    entry |= {"signed": bool(node.get_property("is_signed")), "fraction": node.get_property("fraction")}
    entry |= {"unit": node.get_property("unit"), "description": _line(description), "names": names}
    return _without_defaults(entry, keep=("low", "reset"))


def _without_defaults(entry: _Entry, keep: tuple[str, ...] = ("address",)) -> _Entry:
    return {key: value for key, value in entry.items() if value or (key in keep and value is not None)}


def _line(text: str) -> str:
    return " ".join(text.split())


def render_template(template: str, **names: Any) -> str:
    """Render a template of host/tools/templates."""
    loader = jinja2.FileSystemLoader(Path(__file__).with_name("templates"))
    templates = jinja2.Environment(loader=loader, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    return templates.get_template(template).render(names)


@program
def main(folder: Path | None = argument(default=None)) -> None:
    """Write every file that is made from rtl/registers.rdl into the checkout, or with the same paths into FOLDER.

    Example: python -m tools.generate_registers
    """
    checkout = repository()
    for path in generate(checkout, folder or checkout):
        click.echo(path)
