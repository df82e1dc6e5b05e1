"""Registers of the optics block.

Generated from rtl/registers.rdl by `make registers`; do not edit.
"""

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


#: Registers by name, those of a group with the group's name in front.
REGISTERS: dict[str, Register] = {
    "identity": Register(
        0x000,
        1,
        "read",
        {
            "letters": Field(0, 32, 0x4C495050, False, "", "", "The letters LIPP: this is an optics block."),
        },
    ),
    "version": Register(
        0x004,
        1,
        "read",
        {
            "minor": Field(0, 16, 0x0, False, "", "", "Raised when a register is added."),
            "major": Field(16, 16, 0x1, False, "", "", "Raised when a register changes its meaning."),
        },
    ),
    "build": Register(
        0x008,
        1,
        "read",
        {
            "fraction_bits": Field(0, 5, None, False, "", "", "F, 14 to 23."),
            "grid": Field(5, 1, None, False, "", "", "Lattice. 0 square, 1 hex.", ((0, "square"), (1, "hex"))),
            "model": Field(
                6,
                2,
                None,
                False,
                "",
                "",
                "Model of the lenslet. 0 pinhole, 1 paraxial, 2 exact.",
                ((0, "pinhole"), (1, "paraxial"), (2, "exact")),
            ),
            "viewer": Field(8, 1, None, False, "", "", "Plano side to the viewer."),
            "aims": Field(9, 1, None, False, "", "", "Rays aim at aperture points; else chief rays only."),
            "walk": Field(10, 3, None, False, "", "", "Further domes tried."),
            "cross_cells": Field(
                13, 1, None, False, "", "", "Cross terms of products are in multiplier cells; the words are the same."
            ),
        },
    ),
    "control": Register(
        0x00C,
        1,
        "write",
        {
            "apply": Field(
                0,
                1,
                0x0,
                False,
                "",
                "",
                "Write 1: take over the optics and the source, between two frames; write neither until busy is 0.",
            ),
            "start": Field(
                1,
                1,
                0x0,
                False,
                "",
                "",
                "Write 1: walk a frame; when one is running, walk the next behind it (one is remembered).",
            ),
        },
    ),
    "status": Register(
        0x010,
        1,
        "read",
        {
            "busy": Field(0, 1, None, False, "", "", "An apply is not yet taken over."),
            "running": Field(
                1,
                1,
                None,
                False,
                "",
                "",
                "A frame of the raster waits for its start, or not all of its rays are in the pipeline.",
            ),
            "refused": Field(
                2,
                1,
                None,
                False,
                "",
                "",
                "The last start was refused: an empty window, or one that is not on the panel.",
            ),
        },
    ),
    "source": Register(
        0x014,
        1,
        "read, write",
        {
            "stream": Field(0, 1, 0x0, False, "", "", "0: the raster, 1: the stream at the block's port."),
        },
    ),
    "optics_x_from_u_low": Register(
        0x040,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, False, "", "", "Bits 31 to 0 of the word whose rest is in the register behind."),
        },
    ),
    "optics_x_from_u_high": Register(
        0x044,
        1,
        "read, write",
        {
            "value": Field(0, 3, 0x0, True, "36", "pitch / pixel", "Lattice x from pixel u."),
        },
    ),
    "optics_x_from_v_low": Register(
        0x048,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, False, "", "", "Bits 31 to 0 of the word whose rest is in the register behind."),
        },
    ),
    "optics_x_from_v_high": Register(
        0x04C,
        1,
        "read, write",
        {
            "value": Field(0, 3, 0x0, True, "36", "pitch / pixel", "Lattice x from pixel v."),
        },
    ),
    "optics_y_from_u_low": Register(
        0x050,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, False, "", "", "Bits 31 to 0 of the word whose rest is in the register behind."),
        },
    ),
    "optics_y_from_u_high": Register(
        0x054,
        1,
        "read, write",
        {
            "value": Field(0, 3, 0x0, True, "36", "row / pixel", "Lattice y from pixel u."),
        },
    ),
    "optics_y_from_v_low": Register(
        0x058,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, False, "", "", "Bits 31 to 0 of the word whose rest is in the register behind."),
        },
    ),
    "optics_y_from_v_high": Register(
        0x05C,
        1,
        "read, write",
        {
            "value": Field(0, 3, 0x0, True, "36", "row / pixel", "Lattice y from pixel v."),
        },
    ),
    "optics_x_offset_low": Register(
        0x060,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, False, "", "", "Bits 31 to 0 of the word whose rest is in the register behind."),
        },
    ),
    "optics_x_offset_high": Register(
        0x064,
        1,
        "read, write",
        {
            "value": Field(
                0, 20, 0x0, True, "40", "pitch", "Lattice x of the panel's centre, half of a place of F bits added."
            ),
        },
    ),
    "optics_y_offset_low": Register(
        0x068,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, False, "", "", "Bits 31 to 0 of the word whose rest is in the register behind."),
        },
    ),
    "optics_y_offset_high": Register(
        0x06C,
        1,
        "read, write",
        {
            "value": Field(
                0, 20, 0x0, True, "40", "row", "Lattice y of the panel's centre, half of a place of F bits added."
            ),
        },
    ),
    "optics_slope_x": Register(
        0x070,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "1 / pitch", "Slope from a - x (exact), from x (other models)."),
        },
    ),
    "optics_slope_y": Register(
        0x074,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "1 / row", "Slope from b - y (exact), from y (other models)."),
        },
    ),
    "optics_slope_aim_x": Register(
        0x078,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "1 / pitch", "Slope from a (paraxial)."),
        },
    ),
    "optics_slope_aim_y": Register(
        0x07C,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "1 / row", "Slope from b (paraxial)."),
        },
    ),
    "optics_point_x": Register(
        0x080,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "radius / pitch", "Point on the first face from x."),
        },
    ),
    "optics_point_y": Register(
        0x084,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "radius / row", "Point on the first face from y."),
        },
    ),
    "optics_point_aim_x": Register(
        0x088,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "radius / pitch", "Point on the first face from a."),
        },
    ),
    "optics_point_aim_y": Register(
        0x08C,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "radius / row", "Point on the first face from b."),
        },
    ),
    "optics_index": Register(
        0x090,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "1", "Index of the glass n, below 4."),
        },
    ),
    "optics_index_square": Register(
        0x094,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "1", "n^2, below 8."),
        },
    ),
    "optics_index_inverse": Register(
        0x098,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F + 1", "1", "1 / n."),
        },
    ),
    "optics_index_inverse_square": Register(
        0x09C,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "1", "1 / n^2."),
        },
    ),
    "optics_depth": Register(
        0x0A0,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "radius", "zc = 1 - T / R: the dome's centre from the first face."),
        },
    ),
    "optics_depth_rest": Register(
        0x0A4,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F + 3", "radius^2", "1 - zc^2."),
        },
    ),
    "optics_exit_z": Register(
        0x0A8,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F + 1", "radius", "Height of the last face."),
        },
    ),
    "optics_cell_half": Register(
        0x0AC,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F + 1", "radius", "p / (2 R)."),
        },
    ),
    "optics_cell_pitch_x": Register(
        0x0B0,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "radius", "p / R."),
        },
    ),
    "optics_cell_pitch_y": Register(
        0x0B4,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x0, True, "F", "radius", "Distance of rows / R."),
        },
    ),
    "raster_columns": Register(
        0x0C0,
        1,
        "read, write",
        {
            "first": Field(0, 14, 0x0, False, "", "pixel", "First column of the window, 0 the leftmost."),
            "last": Field(16, 14, 0x0, False, "", "pixel", "Last column of the window."),
        },
    ),
    "raster_rows": Register(
        0x0C4,
        1,
        "read, write",
        {
            "first": Field(0, 14, 0x0, False, "", "pixel", "First row of the window, 0 the topmost."),
            "last": Field(16, 14, 0x0, False, "", "pixel", "Last row of the window."),
        },
    ),
    "raster_panel": Register(
        0x0C8,
        1,
        "read, write",
        {
            "width": Field(0, 14, 0x0, False, "", "pixel", "Columns of the panel; its half is where u is 0."),
            "height": Field(16, 14, 0x0, False, "", "pixel", "Rows of the panel; its half is where v is 0."),
        },
    ),
    "raster_jitter": Register(
        0x0CC,
        1,
        "read, write",
        {
            "samples": Field(0, 16, 0x1, False, "", "ray / pixel", "Rays for each pixel; 0 stands for 65536."),
            "mode": Field(
                16,
                2,
                0x0,
                False,
                "",
                "",
                "What moves rays from the centres of pixel and lenslet. 0 off, 1 table, 2 lfsr.",
                ((0, "off"), (1, "table"), (2, "lfsr")),
            ),
            "table_first": Field(
                24, 6, 0x0, False, "", "entry", "Table entry of sample 0; behind entry 63 comes entry 0."
            ),
        },
    ),
    "raster_seed": Register(
        0x0D0,
        1,
        "read, write",
        {
            "value": Field(0, 32, 0x1, False, "", "", "The frame's first random word; 0 counts as 1."),
        },
    ),
    "jitter_table": Register(0x100, 64, "write", {}),
}
