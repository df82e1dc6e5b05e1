"""`lippmann board program`: load a bitstream into an FPGA board."""

from __future__ import annotations

from pathlib import Path

from lippmann.board.bitstreams import program, read_bitfile
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.output import emit
from lippmann.display.description import load_display
from lippmann.errors import input_error


@make_command("program")
def program_command(
    file: str = argument("FILE.bit"),
    board: str | None = option("The board, for a bitstream that names none.", None, metavar="NAME"),
    serial: str | None = option("Serial number of the board's USB adapter, where there are two boards.", None),
    flash: bool = option("Write the board's flash memory: the FPGA loads it at each power-up.", False),
    display_path: str | None = option(
        "Refuse a bitstream that is for another display.", None, flag="--display", metavar="FILE"
    ),
) -> None:
    """Load a bitstream into an FPGA board by openFPGALoader.

    It stays until the board is switched off.

    Example: lippmann board program build/bitstream/ulx3s-vga-square.bit
    """
    path = Path(file)
    header = read_bitfile(path)
    if display_path is not None:
        display = load_display(display_path)
        if header.identity != display.identity:
            what = f"the bitstream is for display {header.identity or 'unknown'}, {display_path} is {display.identity}"
            raise input_error(file, what, f"run make bitstream DISPLAY={display_path}")
    programmed = program(path, board, serial, flash)
    result = {
        "file": file, "board": programmed.name, "device": header.device, "display": header.display,
        "identity": header.identity, "design": header.design, "flash": flash,
    }  # fmt: skip
    what = f"{header.display} (design {header.design})" if header.display else file
    emit(result, f"{programmed.name}: {'its flash memory holds' if flash else 'runs'} {what}")
