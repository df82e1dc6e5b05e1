"""Generates the lists of the RTL's files for other tools from rtl/sources.toml: FuseSoC, Bender and .f files.

`python -m tools.generate_manifests` (`make manifests`) writes them.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

import click
from lippmann.cli import run
from lippmann.simulation.toolchain import repository, rtl_folders, rtl_sources

_BY = "Generated from rtl/sources.toml by `make manifests`; do not edit."
#: In a device's folder: the ports of its cells, for tools without a library of them, such as yosys with slang.
BLACK_BOXES = "black_boxes.v"
_SPDX = "SPDX-License-Identifier: Apache-2.0"


def manifests(top: Path) -> dict[Path, str]:
    """Return the text of each manifest, by its path in the checkout.

    Raises LippmannError when rtl/sources.toml does not name every file of rtl/.
    """
    devices = rtl_folders(top, devices=True)
    replaced = {path.name for cells in devices.values() for path in cells}
    everything = rtl_sources(top)
    shared = [path for path in everything if path.name not in replaced]
    generic = [path for path in everything if path.name in replaced]
    texts = {
        Path("rtl/lippmann.core"): _fusesoc(top, shared, generic, devices),
        Path("Bender.yml"): _bender(top, shared, generic, devices),
        Path("rtl/lippmann.f"): _file_list(top, [*shared, *generic], "For simulators, and for synthesis."),
    }
    for device, cells in devices.items():
        note = f"For synthesis with the cells of {device}, whose ports are in {device}/{BLACK_BOXES}; not to simulate."
        texts[Path(f"rtl/lippmann_{device}.f")] = _file_list(top, [*shared, *cells], note)
    return texts


def _fusesoc(top: Path, shared: Sequence[Path], generic: Sequence[Path], devices: dict[str, list[Path]]) -> str:
    """Return the FuseSoC core; a device's flag selects its cells, the flag `black_boxes` their ports."""
    version = tomllib.loads((top / "pyproject.toml").read_text())["project"]["version"].partition(".dev")[0]
    none = "".join(f"!{device} ? (" for device in devices) + "generic" + ")" * len(devices)
    chosen = ["rtl", "lint", none]
    for device in devices:
        chosen += [f"{device} ? ({device})", f"{device} ? (black_boxes ? ({device}_black_boxes))"]
    filesets = {"rtl": shared, "generic": generic, **devices}
    lines = [
        "CAPI=2:",
        f"# {_SPDX}",
        f"# {_BY}",
        f"name: lippmann:lippmann:rtl:{version}",
        "description: Ray pipeline, register block and board for integral-photography displays",
        "license: Apache-2.0",
        "",
        "filesets:",
    ]
    for name, files in filesets.items():
        lines += [f"  {name}:", "    file_type: systemVerilogSource", "    files:"]
        lines += [f"      - {path.relative_to(top / 'rtl')}" for path in files]
    for device in devices:
        lines += [f"  {device}_black_boxes:", "    file_type: verilogSource", f"    files: [{device}/{BLACK_BOXES}]"]
    lines += ["  lint:", "    file_type: vlt", "    files: [registers/lint.vlt]"]
    lines += ["", "targets:", "  default: &default", "    filesets:"]
    lines += [f'      - "{one}"' for one in chosen]
    # A device's black boxes are for synthesis: their inputs are unused.
    lines += ["  lint:", "    description: The whole board under Verilator, all warnings on"]
    lines += ["    filesets: [rtl, lint, generic]"]
    lines += ["    flow: lint", "    flow_options:", "      tool: verilator", "      verilator_options: [-Wall]"]
    lines += ["    toplevel: lipp_board"]
    return "\n".join(lines) + "\n"


def _bender(top: Path, shared: Sequence[Path], generic: Sequence[Path], devices: dict[str, list[Path]]) -> str:
    """Return Bender's manifest; a device's target selects its cells, `black_boxes` their ports."""
    none = f"not(any({', '.join(devices)}))"
    lines = [f"# {_SPDX}", f"# {_BY}", "package:", "  name: lippmann", "", "sources:"]
    ports = {f"all({device}, black_boxes)": [cells[0].with_name(BLACK_BOXES)] for device, cells in devices.items()}
    for target, files in {"": shared, none: generic, **devices, **ports}.items():
        lines += [f"  - target: {target}", "    files:"] if target else ["  - files:"]
        lines += [f"      - {path.relative_to(top)}" for path in files]
    return "\n".join(lines) + "\n"


def _file_list(top: Path, files: Sequence[Path], note: str) -> str:
    """Return a list for tools that take -F; its paths count from its own folder. `note` says which tools."""
    lines = [f"// {_SPDX}", f"// {_BY}", f"// {note}", "// Paths count from this file's folder: give it with -F."]
    lines += ["// Verilator needs registers/lint.vlt before this list."]
    return "\n".join([*lines, *(str(path.relative_to(top / "rtl")) for path in files)]) + "\n"


@click.command()
def main() -> None:
    """Write every manifest into the checkout.

    Example: python -m tools.generate_manifests
    """
    top = repository()
    for path, text in manifests(top).items():
        (top / path).write_text(text)
        click.echo(path)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))
