"""FPGA boards: read rtl/board/NAME/board.toml, and recognise a board on USB."""

from __future__ import annotations

import contextlib
import os
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from serial.tools.list_ports_common import ListPortInfo

from lippmann.base.toml import documented, key, load, read
from lippmann.board.port import DEFAULT_BAUD, port_info
from lippmann.errors import InputError, did_you_mean, input_error
from lippmann.simulation.toolchain import hardware

#: Folder of all boards in a checkout, and the name of a board's description file.
FOLDER, FILE = Path("rtl", "board"), "board.toml"


@documented
@dataclass(frozen=True)
class Fpga:
    """The names and the JTAG identity of a board's FPGA."""

    device: Annotated[str, key("nextpnr's option for the device size, such as `85k`")]
    name: Annotated[str, key("the manufacturer's device name, such as `LFE5U-85F`")]
    package: Annotated[str, key("package, such as `CABGA381`")]
    speed: Annotated[int, key("speed grade", low=6, high=8)]
    idcode: Annotated[int, key("JTAG identity, 32 bits", low=0, high=0xFFFFFFFF)]


@documented
@dataclass(frozen=True)
class Memory:
    """The 16-bit SDR SDRAM of a board."""

    grade: Annotated[str, key("timing constant in `rtl/memory/lipp_sdram_pkg.sv`")]
    max_mhz: Annotated[float, key("maximum clock", above=0.0)]
    megabytes: Annotated[int, key("size, MiB", low=1)]


@documented
@dataclass(frozen=True)
class Limits:
    """Maximum clock frequencies that place-and-route meets."""

    system_mhz: Annotated[float, key("maximum system clock", above=0.0)]
    memory_mhz: Annotated[float, key("maximum clock of the SDRAM controller", above=0.0)]
    shift_mhz: Annotated[float | None, key("maximum DVI bit clock, with two bits per cycle")] = None


@documented
@dataclass(frozen=True)
class Usb:
    """The board's USB adapter, and openFPGALoader's name for the board."""

    vendor: Annotated[int, key("USB vendor number", low=0, high=0xFFFF)]
    product: Annotated[int, key("USB product number", low=0, high=0xFFFF)]
    text: Annotated[str, key("a part of the USB product text")]
    loader: Annotated[str, key("openFPGALoader's name for the board")]


@documented
@dataclass(frozen=True)
class FpgaBoard:
    """Description of an FPGA board, read from `board.toml` in its folder."""

    name: Annotated[str, key("name of the board and of its folder")]
    title: Annotated[str, key("the manufacturer's board name, and the video output")]
    top: Annotated[str, key("top module")]
    constraints: Annotated[list[str], key("pin files (.lpf), relative to the folder", shape="a list of paths")]
    oscillator_mhz: Annotated[float, key("oscillator frequency", above=0.0)]
    video: Annotated[Literal["dvi", "parallel"], key("video output: DVI, or a panel's parallel signals")]
    baud: Annotated[int, key("baud rate of the serial line", low=1)]
    fpga: Annotated[Fpga, key("the FPGA")]
    memory: Annotated[Memory, key("the SDRAM")]
    limits: Annotated[Limits, key("maximum clocks")]
    usb: Annotated[Usb, key("the USB adapter")]
    like: Annotated[str | None, key("board from which RTL and missing keys are inherited")] = None

    @property
    def folder(self) -> Path:
        """The folder of the board's `board.toml`."""
        return hardware() / FOLDER / self.name

    @property
    def folders(self) -> list[Path]:
        """The folders with the board's RTL: its own, then inherited folders."""
        return [self.folder, *([] if self.like is None else fpga_board(self.like).folders)]

    def owns(self, port: ListPortInfo) -> bool:
        """Return whether a serial port belongs to a board of this type."""
        same = (port.vid, port.pid) == (self.usb.vendor, self.usb.product)
        return same and self.usb.text in (port.product or "")


def _names() -> list[str]:
    return sorted(path.parent.name for path in (hardware() / FOLDER).glob(f"*/{FILE}"))


def _chain(path: Path) -> list[Path]:
    chain = [path]
    while (name := load(chain[-1], "board").get("like")) is not None:
        where, boards = f"{chain[-1]}: like", _names()
        if name not in boards:
            value = reprlib.repr(name).replace("'", '"')
            raise input_error(where, f"{value} is not a board", f"choose from {', '.join(boards)}")
        other = path.parent.parent / name / FILE
        if other in chain:
            raise input_error(where, f"{name} already inherits from this board", "remove a `like` key")
        chain.append(other)
    return chain


def _keys(path: Path) -> dict[str, Any]:
    """Return a file's keys, and inherited ones, with paths relative to the file's folder."""
    keys: dict[str, Any] = {}
    for one in reversed(_chain(path)):
        for name, value in load(one, "board").items():
            is_table = isinstance(value, dict) and isinstance(keys.get(name), dict)
            keys[name] = keys[name] | value if is_table else value
            if name == "constraints" and isinstance(value, list) and one != path:
                folder = Path("..", one.parent.name)
                keys[name] = [os.path.normpath(folder / pin) if isinstance(pin, str) else pin for pin in value]
    return keys


def fpga_boards() -> dict[str, FpgaBoard]:
    """Return all boards, keyed by name; raise InputError for an invalid file."""
    return {name: fpga_board(name) for name in _names()}


def fpga_board(name: str) -> FpgaBoard:
    """Return the board with this name.

    Raises InputError for an unknown name or an invalid file.
    """
    boards, path = _names(), hardware() / FOLDER / name / FILE
    if name not in boards:
        remedy = did_you_mean(name, boards) or f"choose from {', '.join(boards)}"
        raise input_error(name, "no such board", f"{remedy}; a new board needs rtl/board/NAME/board.toml")
    board = read(FpgaBoard, _keys(path), str(path))
    if board.name != name:
        raise input_error(f"{path}: name", f'"{board.name}" is not the name of the folder', f'write "{name}"')
    return board


def board_of_port(url: str) -> FpgaBoard | None:
    """Return the board at a serial port, or None; boards with an invalid file are skipped."""
    port = None if "://" in url else port_info(url)
    if port is None:
        return None
    for name in _names():
        with contextlib.suppress(InputError):
            if (board := fpga_board(name)).owns(port):
                return board
    return None


def usual_baud(url: str) -> int:
    """Return the baud rate of a port's board, or `DEFAULT_BAUD` if the board is unknown."""
    board = board_of_port(url)
    return DEFAULT_BAUD if board is None else board.baud
