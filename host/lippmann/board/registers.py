"""Registers of the board.

Generated from rtl/registers.rdl by `make registers`; do not edit.
"""

from __future__ import annotations

from lippmann.fixed.registers import Field, Register

#: Registers by name, those of a group with the group's name in front.
REGISTERS: dict[str, Register] = {
    "identity": Register(
        0x000,
        1,
        "read",
        {
            "letters": Field(0, 32, 0x4C495042, False, "", "", "The letters LIPB: this is a board."),
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
    "display_low": Register(
        0x008,
        1,
        "read",
        {
            "value": Field(0, 32, None, False, "", "", "Bits 31 to 0."),
        },
    ),
    "display_high": Register(
        0x00C,
        1,
        "read",
        {
            "value": Field(0, 32, None, False, "", "", "Bits 63 to 32."),
        },
    ),
    "panel": Register(
        0x010,
        1,
        "read",
        {
            "width": Field(0, 16, None, False, "", "pixel", "Columns of the panel."),
            "height": Field(16, 16, None, False, "", "pixel", "Rows of the panel."),
        },
    ),
    "clock": Register(
        0x014,
        1,
        "read",
        {
            "value": Field(0, 32, None, False, "", "Hz", "Clocks in a second."),
        },
    ),
    "display": Register(
        0x018,
        1,
        "read, write",
        {
            "brightness": Field(
                0, 8, 0xFF, False, "", "", "A pixel p is shown as floor(p (b + 1) / 256); 255: as it is."
            ),
            "pattern": Field(
                8,
                3,
                0x0,
                False,
                "",
                "",
                "Test pattern, not the frame. 0 off, 1 single_lens, 2 lens_centres, 3 view_numbers, 4 checker, 5 ramp.",
                ((0, "off"), (1, "single_lens"), (2, "lens_centres"), (3, "view_numbers"), (4, "checker"), (5, "ramp")),
            ),
        },
    ),
    "lens": Register(
        0x01C,
        1,
        "read, write",
        {
            "i": Field(0, 12, 0x0, True, "", "", "Lenslet of the pattern single_lens, i."),
            "j": Field(16, 12, 0x0, True, "", "", "Lenslet of the pattern single_lens, j."),
        },
    ),
    "epoch": Register(
        0x020,
        1,
        "read",
        {
            "value": Field(0, 16, None, False, "", "", "Frames presented, modulo 65536; a tile names it."),
        },
    ),
    "shown_crc": Register(
        0x024,
        1,
        "read",
        {
            "value": Field(
                0,
                32,
                None,
                False,
                "",
                "",
                "CRC-32 of the last whole frame that left for the panel, R G B bytes in rows.",
            ),
        },
    ),
    "frames": Register(
        0x028,
        1,
        "read",
        {
            "value": Field(0, 32, None, False, "", "", "Frames that have left for the panel, modulo 2^32."),
        },
    ),
    "clocks": Register(
        0x02C,
        1,
        "read",
        {
            "value": Field(0, 32, None, False, "", "", "Clocks since reset, modulo 2^32."),
        },
    ),
    "counters_packets": Register(
        0x040,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Good packets."),
        },
    ),
    "counters_framing": Register(
        0x044,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Bytes whose stop bit was not there."),
        },
    ),
    "counters_overflow": Register(
        0x048,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Bytes lost because the ones before were not yet taken."),
        },
    ),
    "counters_dropped_cobs": Register(
        0x04C,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Packets dropped: a group of bytes was cut short."),
        },
    ),
    "counters_dropped_crc": Register(
        0x050,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Packets dropped: wrong CRC-32."),
        },
    ),
    "counters_dropped_long": Register(
        0x054,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Packets dropped: too long."),
        },
    ),
    "counters_dropped_short": Register(
        0x058,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Packets dropped: too short."),
        },
    ),
    "counters_stale": Register(
        0x05C,
        1,
        "read",
        {
            "count": Field(
                0, 32, 0x0, False, "", "", "Requests refused: of another epoch, or older than one executed."
            ),
        },
    ),
    "counters_tile_bad": Register(
        0x060,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Requests refused: a tile's data do not give its pixels."),
        },
    ),
    "counters_frame_bad": Register(
        0x064,
        1,
        "read",
        {
            "count": Field(0, 32, 0x0, False, "", "", "Frames not shown: wrong CRC-32."),
        },
    ),
}
