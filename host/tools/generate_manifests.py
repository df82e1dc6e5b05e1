"""Writes lists of the RTL's files for other tools, from rtl/sources.toml (`make manifests`)."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import click
from lippmann.simulation.toolchain import repository, rtl_folders, rtl_sources

from tools.generate_registers import render_template
from tools.program import program

_BY = "Generated from rtl/sources.toml by `make manifests`; do not edit."
#: File in a device's folder with the ports of its cells, for tools without a cell library (yosys with slang).
BLACK_BOXES = "black_boxes.v"


def manifests(top: Path) -> dict[Path, str]:
    """Return the manifests' texts, keyed by path; raise LippmannError if rtl/sources.toml does not name every file."""
    devices = rtl_folders(top, devices=True)
    replaced = {path.name for cells in devices.values() for path in cells}
    shared, generic = (
        [path for path in rtl_sources(top) if (path.name in replaced) == is_cell] for is_cell in (False, True)
    )
    version = tomllib.loads((top / "pyproject.toml").read_text())["project"]["version"].partition(".dev")[0]
    names = {"by": _BY, "black_boxes": BLACK_BOXES, "version": version, "top": top, "devices": devices}
    cells = {"generic": generic, **devices}

    def file_list(files: Sequence[Path], heading: str) -> str:
        return render_template("lippmann.f.jinja", **names, files=files, note=heading)

    texts = {
        Path("rtl/lippmann.core"): render_template("lippmann.core.jinja", **names, filesets={"rtl": shared, **cells}),
        Path("Bender.yml"): render_template("Bender.yml.jinja", **names, shared=shared, generic=generic),
        Path("rtl/lippmann.f"): file_list([*shared, *generic], "For simulators, and for synthesis."),
    }
    for device, files in devices.items():
        use = f"For synthesis with the cells of {device}, whose ports are in {device}/{BLACK_BOXES}; not to simulate."
        texts[Path(f"rtl/lippmann_{device}.f")] = file_list([*shared, *files], use)
    return texts


@program
def main() -> None:
    """Write every manifest into the checkout.

    Example: python -m tools.generate_manifests
    """
    top = repository()
    for path, text in manifests(top).items():
        (top / path).write_text(text)
        click.echo(path)
