"""ECP5 bitstreams (.bit): read the header, and load a file into a board with openFPGALoader.

A .bit file begins with FF 00, then header texts that each end with 00, then FF. The
preamble FF FF BD B3 precedes the configuration. A configuration command has one command
byte, three option bytes, and data. The command VERIFY_ID (E2) contains the JTAG
identity. The last command is PROGRAM_DONE (5E); FF bytes may follow it.
"""

from __future__ import annotations

import hashlib
import logging
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

from lippmann.base.file_limits import MAX_BITSTREAM_BYTES, read_limited
from lippmann.base.programs import run_program
from lippmann.board.fpga_boards import FpgaBoard, Usb, fpga_board
from lippmann.errors import DeviceError, MissingLibraryError, device_error, input_error, no_board_error, reason
from lippmann.simulation.toolchain import Tool

logger = logging.getLogger(__name__)

PREAMBLE = b"\xff\xff\xbd\xb3"
VERIFY_ID = b"\xe2\x00\x00\x00"
PROGRAM_DONE = b"\x5e\x00\x00\x00"
#: Commands that may precede VERIFY_ID: no operation, and reset of the CRC.
NO_OPERATION, RESET_CRC = 0xFF, 0x3B
#: Device names of the ECP5 family, keyed by JTAG identity.
DEVICES = {
    0x21111043: "LFE5U-12F",
    0x41111043: "LFE5U-25F",
    0x41112043: "LFE5U-45F",
    0x41113043: "LFE5U-85F",
    0x01111043: "LFE5UM-25F",
    0x01112043: "LFE5UM-45F",
    0x01113043: "LFE5UM-85F",
    0x81111043: "LFE5UM5G-25F",
    0x81112043: "LFE5UM5G-45F",
    0x81113043: "LFE5UM5G-85F",
}
REMEDY = "give a file that make bitstream wrote"


@dataclass(frozen=True)
class BitFile:
    """Header of a bitstream; only `idcode` is set if `make bitstream` did not write the file."""

    idcode: int
    board: str
    display: str
    identity: str
    design: str  # hash of the RTL sources

    @property
    def device(self) -> str:
        """Name of the FPGA, or its JTAG identity if the name is unknown."""
        return DEVICES.get(self.idcode, f"0x{self.idcode:08x}")


#: Placeholder for the SHA-256 in the header text.
NO_DIGEST = b"0" * 64
#: Header text that `make bitstream` writes. A file that contains one of `WORDS`, but
#: not the complete text, is damaged.
TEXT = re.compile(
    rb"Lippmann board=(\S+) display=([^\0]+?) identity=([0-9a-f]{16}) design=(\w+) seed=\d+ sha256=([0-9a-f]{64})\0"
)
WORDS = (b"Lippmann", b"identity=", b"sha256=")


def comment(board: str, display: str, identity: str, design: str, seed: int) -> str:
    """Return the header text for a new bitstream, with zeros in place of its SHA-256."""
    text = f"Lippmann board={board} display={display} identity={identity} design={design} seed={seed}"
    return f"{text} sha256={NO_DIGEST.decode()}"


def sealed(data: bytes) -> bytes:
    """Replace the zeros in a bitstream's header text by the bitstream's SHA-256."""
    return data.replace(b"sha256=" + NO_DIGEST, b"sha256=" + _digest(data), 1)


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).hexdigest().encode()


def read_bitfile(path: Path) -> BitFile:
    """Return a bitstream's header.

    Raises InputError for a file that is unreadable, truncated or not a bitstream.
    """
    try:
        if path.exists() and not path.is_file():
            raise input_error(path, "is not a plain file", REMEDY)
        data = read_limited(path, MAX_BITSTREAM_BYTES, REMEDY)
    except FileNotFoundError:
        raise input_error(path, "no such file", "run make bitstream") from None
    except OSError as error:
        raise input_error(path, f"cannot be read ({reason(error)})", REMEDY) from None
    start = data.find(PREAMBLE)
    at = start + len(PREAMBLE)
    while start >= 0 and data[at : at + 1] in (bytes([NO_OPERATION]), bytes([RESET_CRC])):
        at += 1 if data[at] == NO_OPERATION else 4
    if start < 0 or data[at : at + 4] != VERIFY_ID or len(data) < at + 8:
        raise input_error(path, "is not an ECP5 bitstream", REMEDY)
    if not data.rstrip(b"\xff").endswith(PROGRAM_DONE):
        raise input_error(path, "is a truncated bitstream", "copy the file again, or run make bitstream")
    header = data[:start]
    text = TEXT.search(header)
    idcode = int.from_bytes(data[at + 4 : at + 8], "big")
    if text is None and not any(word in header for word in WORDS):
        return BitFile(idcode, "", "", "", "")
    if text is None or text[5] != _digest(data[: text.start(5)] + NO_DIGEST + data[text.end(5) :]):
        why = "its header text cannot be read" if text is None else "its digest does not match"
        raise input_error(path, f"is damaged: {why}", "copy the file again, or run make bitstream")
    return BitFile(idcode, *(word.decode(errors="replace") for word in text.groups()[:4]))


LOADER = Tool("openFPGALoader", "writes bitstreams into FPGA boards", "run sudo apt-get install -y openfpgaloader")
#: Time-out for loading a bitstream, s. Loading takes 15 s, or some minutes for flash.
LOAD_SECONDS = 600.0
CONNECT = "connect the board's USB socket US1, and switch the board on"
REPLUG = "reconnect the board, then run the command again"
#: Folder in which Linux lists the USB devices.
USB_DEVICES = Path("/sys/bus/usb/devices")
#: Patterns in openFPGALoader's output (lower case), with cause and remedy. The first
#: matching pattern decides.
CAUSES = (
    (
        r"permission denied|access denied|usb_open\(\) failed",
        "no permission to use the board",
        "join the board's group: sudo usermod -aG plugdev $USER, then log in again",
    ),
    (r"unable to claim", "another program uses the board's adapter", "close that program, then try again"),
    (
        r"\b([2-9]|\d\d+) matching|\bmultiple (matching )?(adapter|board|cable|device)",
        "several USB adapters of this kind are connected",
        "name a board with --serial: lippmann doctor lists the serial numbers",
    ),
    (r"mismatch|id err", "the bitstream is for another FPGA", "make one for the board's FPGA"),
    (r"crc", "the FPGA refuses the bitstream", "make the bitstream again (make bitstream)"),
)
#: Phrases that openFPGALoader prints when it finds no board.
NOT_FOUND = ("not found", "no device", "unable to open ftdi", "no cable", "can't find")


@dataclass(frozen=True)
class Adapter:
    """A USB adapter: product text and serial number, which may be empty."""

    text: str
    serial: str

    def __str__(self) -> str:
        return f"'{self.text}' ({self.serial or 'without a serial number'})"


def on_usb(usb: Usb) -> list[Adapter] | None:
    """Return the connected adapters with the vendor and product numbers of `usb`.

    None means that this system does not list USB devices.
    """
    if not USB_DEVICES.is_dir():
        return None
    adapters = []
    for device in sorted(USB_DEVICES.iterdir()):
        files = [device / name for name in ("idVendor", "idProduct", "product", "serial")]
        texts = [path.read_text(errors="replace").strip() if path.is_file() else "" for path in files]
        if texts[:2] == [f"{usb.vendor:04x}", f"{usb.product:04x}"]:
            adapters.append(Adapter(*texts[2:]))
    return adapters


def choose_adapter(board: FpgaBoard, adapters: list[Adapter] | None, serial: str | None) -> str | None:
    """Return the serial number of a board's adapter, or None if the number is empty or unknown.

    Raises DeviceError unless exactly one adapter matches.
    """
    if adapters is None:
        return serial
    there = ", ".join(map(str, adapters)) or "none"
    if serial is not None:
        if serial not in [one.serial for one in adapters]:
            what = "no adapter on USB has this serial number"
            raise no_board_error(f"--serial {serial}", what, f"choose from {there}" if adapters else CONNECT)
        return serial
    boards = [one for one in adapters if board.usb.text in one.text]
    if not boards:
        what, remedy = f"no adapter '{board.usb.text}' is on USB", CONNECT
        if adapters:
            remedy = f"if one of {there} is the board, name it with --serial (ftx_prog sets its text)"
        raise no_board_error(board.name, what, remedy)
    if len(boards) > 1:
        distinct = len({one.serial for one in boards}) == len(boards) and all(one.serial for one in boards)
        numbers = ", ".join(one.serial or "without a serial number" for one in boards)
        what = f"{len(boards)} boards are on USB ({numbers})"
        raise device_error(board.name, what, "name a board with --serial" if distinct else "unplug all but one")
    if not boards[0].serial and len(adapters) > 1:
        what = f"its adapter has no serial number, and other adapters of its kind are on USB ({there})"
        raise device_error(board.name, what, "unplug the other adapters")
    return boards[0].serial or None


def board_of(path: Path, file: BitFile, name: str | None) -> FpgaBoard:
    """Return the board that a bitstream names, or the board `name`.

    Raises InputError if the bitstream is for another board or FPGA.
    """
    if name is None and not file.board:
        raise input_error(path, "the bitstream names no board", "name the board with --board")
    board = fpga_board(name or file.board)
    if file.board and file.board != board.name:
        raise input_error(path, f"the bitstream is for {file.board}, not {board.name}", f"give a file for {board.name}")
    if file.idcode != board.fpga.idcode:
        what = f"the bitstream is for an {file.device}, but {board.name} has an {board.fpga.name}"
        raise input_error(path, what, "make a bitstream for this board (make bitstream)")
    return board


def program(path: Path, name: str | None = None, serial: str | None = None, flash: bool = False) -> FpgaBoard:
    """Load a bitstream into a board's FPGA or flash memory; return the board.

    `name` is the board's name if the bitstream has none. `serial` is the serial number
    of the USB adapter; None means the only board. Raises InputError for an unsuitable
    file, MissingLibraryError if openFPGALoader cannot run, and DeviceError unless
    exactly one board is connected and the load succeeds.
    """
    board = board_of(path, read_bitfile(path), name)
    if serial == "":
        raise input_error("--serial", "is empty", "give a number that lippmann doctor or lsusb -v lists")
    loader = LOADER.path()
    serial = choose_adapter(board, on_usb(board.usb), serial)
    logger.info(f"{path}: openFPGALoader loads this file, which takes {'some minutes' if flash else '15 s'}")
    again = "write the flash again before power-off: it contains only a part" if flash else REPLUG
    command = [str(loader), "--board", board.usb.loader, *(["--ftdi-serial", serial] if serial else [])]
    command += ["--write-flash" if flash else "--write-sram", str(path)]
    try:
        result = run_program(command, timeout_s=LOAD_SECONDS)
    except subprocess.TimeoutExpired:
        late = f"openFPGALoader did not end within {LOAD_SECONDS:.0f} s"
        raise device_error(board.name, late, again) from None
    except KeyboardInterrupt:
        if flash:
            logger.info(f"{board.name}: {again}")
        raise
    except OSError as error:
        raise MissingLibraryError.at(str(loader), f"cannot be run ({error.strerror})", LOADER.remedy) from None
    if result.returncode:
        raise _failure(board, f"{result.stdout}\n{result.stderr}", result.returncode, again)
    return board


def _failure(board: FpgaBoard, output: str, code: int, again: str) -> DeviceError:
    lines = [" ".join(line.split()) for line in output.replace("\r", "\n").splitlines() if line.strip()]
    for words, what, remedy in CAUSES:
        for line in lines:
            if re.search(words, line.lower()):
                return device_error(board.name, f"{what} ({line})", remedy)
    wrong = [line for line in lines if any(word in line.lower() for word in ("error", "fail", "unable", *NOT_FOUND))]
    causes = [line for line in wrong if "std::exception" not in line]  # this line names no cause
    why = (causes or wrong or lines or [f"exit code {code}"])[-1]
    if any(word in output.lower() for word in NOT_FOUND):
        return no_board_error(board.name, f"openFPGALoader finds no board ({why})", CONNECT)
    return device_error(board.name, f"openFPGALoader failed ({why})", again)
