"""Programs an FPGA board by openFPGALoader."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lippmann.base.programs import run_program
from lippmann.board.bitfile import BitFile, read_bitfile
from lippmann.board.fpga_boards import FpgaBoard, Usb, fpga_board
from lippmann.errors import DeviceError, MissingLibraryError, device_error, input_error, no_board_error
from lippmann.simulation.toolchain import Tool

LOADER = Tool("openFPGALoader", "writes bitstreams into FPGA boards", "run sudo apt-get install -y openfpgaloader")
#: Longest time of a load, which takes a quarter of a minute; into the flash memory some minutes, s.
LOAD_SECONDS = 600.0
CONNECT = "connect its USB socket US1, and switch it on"
REPLUG = "plug the board in again, then run it again"
#: Where Linux lists the devices on USB.
USB_DEVICES = Path("/sys/bus/usb/devices")
#: Words of openFPGALoader, in small letters, and what they come to: the cause is the first of these that it says,
#: whatever it says last.
CAUSES = (
    (r"permission denied|access denied|usb_open\(\) failed", "openFPGALoader may not use the board",
     "add yourself to its group by sudo usermod -aG plugdev $USER, and log in again"),
    (r"unable to claim", "another program uses the board's adapter", "close it, then run it again"),
    (r"\b([2-9]|\d\d+) matching|\bmultiple (matching )?(adapter|board|cable|device)",
     "several adapters of its kind are on USB", "name one with --serial: lippmann doctor tells the numbers"),
    (r"mismatch|id err", "the FPGA is not the bitstream's", "read the chip's print, and make one for it"),
    (r"crc", "the FPGA refuses the bitstream", "make it again (make bitstream)"),
)  # fmt: skip
#: Its words when it finds no board.
NOT_FOUND = ("not found", "no device", "unable to open ftdi", "no cable", "can't find")
#: What is no cause: how its own error ends.
EMPTY = "std::exception"


@dataclass(frozen=True)
class Adapter:
    """A USB adapter: the text of its product, and its serial number, which may be empty."""

    text: str
    serial: str

    def __str__(self) -> str:
        return f"'{self.text}' ({self.serial or 'without a serial number'})"


def on_usb(usb: Usb) -> list[Adapter] | None:
    """Return the adapters on USB with a board's identity, whatever their text; None where Linux does not list them.

    A board without a serial port is found too: openFPGALoader takes the adapter from the port's driver.
    """
    if not USB_DEVICES.is_dir():
        return None
    found = []
    for device in sorted(USB_DEVICES.iterdir()):
        told = {}
        for name in ("idVendor", "idProduct", "product", "serial"):
            path = device / name
            told[name] = path.read_text(errors="replace").strip() if path.is_file() else ""
        if (told["idVendor"], told["idProduct"]) == (f"{usb.vendor:04x}", f"{usb.product:04x}"):
            found.append(Adapter(told["product"], told["serial"]))
    return found


def chosen(board: FpgaBoard, adapters: list[Adapter] | None, serial: str | None) -> str | None:
    """Return the serial number of the adapter to use; None: the only one there is, or where they are not listed.

    `serial` names one also when its text is not the board's: that of a new chip is the maker's. Raises DeviceError
    unless one is left.
    """
    if adapters is None:
        return serial
    there = ", ".join(map(str, adapters)) or "none"
    if serial is not None:
        if serial not in [one.serial for one in adapters]:
            what = "no adapter on USB has this serial number"
            raise no_board_error(f"--serial {serial}", what, f"there is {there}")
        return serial
    boards = [one for one in adapters if board.usb.text in one.text]
    if not boards:
        what, remedy = f"no '{board.usb.text}' is on USB", CONNECT
        if adapters:
            remedy = f"there is {there}: if that is the board, name it with --serial (ftx_prog gives it its text)"
        raise no_board_error(board.name, what, remedy)
    if len(boards) > 1:
        distinct = len({one.serial for one in boards}) == len(boards) and all(one.serial for one in boards)
        what = (
            f"{len(boards)} boards are on USB ({', '.join(one.serial or 'without a serial number' for one in boards)})"
        )
        raise device_error(board.name, what, "name one with --serial" if distinct else "unplug all but one")
    if not boards[0].serial and len(adapters) > 1:
        what = f"it has no serial number, and other adapters of its kind are on USB ({there})"
        raise device_error(board.name, what, "unplug those")
    return boards[0].serial or None


def board_of(path: Path, file: BitFile, name: str | None) -> FpgaBoard:
    """Return the board that a bitstream is for; `name` stands for a header that names none.

    Raises InputError when the bitstream is for another board or another FPGA.
    """
    if name is None and not file.board:
        raise input_error(str(path), "the bitstream names no board", "name it with --board")
    board = fpga_board(name or file.board)
    if file.board and file.board != board.name:
        raise input_error(str(path), f"the bitstream is for {file.board}, not {board.name}", "give that board's file")
    if file.idcode != board.fpga.idcode:
        what = f"the bitstream is for an {file.device}, {board.name} has an {board.fpga.name}"
        raise input_error(str(path), what, "make one for this board (make bitstream)")
    return board


def program(
    path: Path,
    name: str | None = None,
    serial: str | None = None,
    flash: bool = False,
    log: Callable[[str], None] = lambda line: None,
) -> FpgaBoard:
    """Load a bitstream into a board's FPGA, or into its flash memory; return the board.

    Parameters
    ----------
    name
        The board, for a bitstream that names none.
    serial
        The serial number of the board's USB adapter; None: the only board on USB.
    log
        Called with a line before the load, and with one when Ctrl-C leaves the flash memory half-written.

    Raises InputError for a wrong file, MissingLibraryError without an openFPGALoader that runs, and DeviceError when
    there is no board or more than one, or the loader fails.
    """
    file = read_bitfile(path)
    board = board_of(path, file, name)
    if serial == "":
        raise input_error("--serial", "is empty", "give the number that lippmann doctor or lsusb -v tells")
    loader = LOADER.path()
    serial = chosen(board, on_usb(board.usb), serial)
    log(f"{path}: openFPGALoader writes it, which takes {'some minutes' if flash else 'a quarter of a minute'}")
    again = "write it again before you switch it off: its flash memory holds a part" if flash else REPLUG
    command = [str(loader), "--board", board.usb.loader, *(["--ftdi-serial", serial] if serial else [])]
    command += ["--write-flash" if flash else "--write-sram", str(path)]
    try:
        done = run_program(command, timeout_s=LOAD_SECONDS)
    except subprocess.TimeoutExpired:
        late = f"openFPGALoader did not end within {LOAD_SECONDS:.0f} s"
        raise device_error(board.name, late, again) from None
    except KeyboardInterrupt:
        if flash:
            log(f"{board.name}: {again}")
        raise
    except OSError as error:
        raise MissingLibraryError.at(str(loader), f"cannot be run ({error.strerror})", LOADER.remedy) from None
    if done.returncode:
        raise _failure(board, f"{done.stdout}\n{done.stderr}", done.returncode, again)
    return board


def _failure(board: FpgaBoard, said: str, code: int, again: str) -> DeviceError:
    """Return the error of a loader that failed, with its own words."""
    lines = [" ".join(line.split()) for line in said.replace("\r", "\n").splitlines() if line.strip()]
    for words, what, remedy in CAUSES:
        for line in lines:
            if re.search(words, line.lower()):
                return device_error(board.name, f"{what} ({line})", remedy)
    wrong = [line for line in lines if any(word in line.lower() for word in ("error", "fail", "unable", *NOT_FOUND))]
    telling = [line for line in wrong if EMPTY not in line]
    why = (telling or wrong or lines or [f"exit code {code}"])[-1]
    if any(word in said.lower() for word in NOT_FOUND):
        return no_board_error(board.name, f"openFPGALoader finds no board ({why})", CONNECT)
    return device_error(board.name, f"openFPGALoader failed ({why})", again)
