"""What the header of an ECP5 bitstream (.bit) tells: the device, and the texts that `make bitstream` writes.

A file begins with FF 00, texts that each end with 00, then FF. The configuration follows the preamble FF FF BD B3:
commands of a byte, three bytes of options and their data. VERIFY_ID (E2) has the device's JTAG identity. The last
command is PROGRAM_DONE (5E), FF may follow.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from lippmann.base.limits import MAX_BITSTREAM_BYTES, read_limited
from lippmann.errors import input_error, reason

PREAMBLE = b"\xff\xff\xbd\xb3"
VERIFY_ID = b"\xe2\x00\x00\x00"
PROGRAM_DONE = b"\x5e\x00\x00\x00"
#: Commands that may come before VERIFY_ID, without data: nothing, and the reset of the checksum.
NO_OPERATION, RESET_CRC = 0xFF, 0x3B
#: JTAG identities of the family.
DEVICES = {
    0x21111043: "LFE5U-12F", 0x41111043: "LFE5U-25F", 0x41112043: "LFE5U-45F", 0x41113043: "LFE5U-85F",
    0x01111043: "LFE5UM-25F", 0x01112043: "LFE5UM-45F", 0x01113043: "LFE5UM-85F",
    0x81111043: "LFE5UM5G-25F", 0x81112043: "LFE5UM5G-45F", 0x81113043: "LFE5UM5G-85F",
}  # fmt: skip
REMEDY = "give a file that make bitstream wrote"


@dataclass(frozen=True)
class BitFile:
    """A bitstream's header; all but the first are empty when another program wrote it.

    `design` is the hash of all that it was made of.
    """

    idcode: int
    board: str
    display: str
    identity: str
    design: str

    @property
    def device(self) -> str:
        """The device's name, or its identity."""
        return DEVICES.get(self.idcode, f"0x{self.idcode:08x}")


#: The digest in the text before it is known.
NO_DIGEST = b"0" * 64
#: The text that `make bitstream` writes. A file that has one of `WORDS`, and not the whole text, is damaged.
TEXT = re.compile(
    rb"Lippmann board=(\S+) display=([^\0]+?) identity=([0-9a-f]{16}) design=(\w+) seed=\d+ sha256=([0-9a-f]{64})\0"
)
WORDS = (b"Lippmann", b"identity=", b"sha256=")


def comment(board: str, display: str, identity: str, design: str, seed: int) -> str:
    """Return the text in a bitstream's header, still without the digest of the file."""
    told = f"Lippmann board={board} display={display} identity={identity} design={design} seed={seed}"
    return f"{told} sha256={NO_DIGEST.decode()}"


def sealed(data: bytes) -> bytes:
    """Return a bitstream with the digest of the whole file, in which it is zeros, in its text."""
    return data.replace(b"sha256=" + NO_DIGEST, b"sha256=" + _digest(data), 1)


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).hexdigest().encode()


def read_bitfile(path: Path) -> BitFile:
    """Return the header of a bitstream; raise InputError for another kind of file, an unreadable one or a part."""
    try:
        if path.exists() and not path.is_file():
            raise input_error(str(path), "cannot be read (it is no file)", REMEDY)
        data = read_limited(path, MAX_BITSTREAM_BYTES, REMEDY)
    except FileNotFoundError:
        raise input_error(str(path), "no such file", "run make bitstream") from None
    except OSError as error:
        raise input_error(str(path), f"cannot be read ({reason(error)})", REMEDY) from None
    start = data.find(PREAMBLE)
    at = start + len(PREAMBLE)
    while start >= 0 and data[at : at + 1] in (bytes([NO_OPERATION]), bytes([RESET_CRC])):
        at += 1 if data[at] == NO_OPERATION else 4
    if start < 0 or data[at : at + 4] != VERIFY_ID or len(data) < at + 8:
        raise input_error(str(path), "is not an ECP5 bitstream", REMEDY)
    if not data.rstrip(b"\xff").endswith(PROGRAM_DONE):
        raise input_error(str(path), "is a bitstream without its end", "copy it again, or run make bitstream")
    texts = data[:start]
    told = TEXT.search(texts)
    idcode = int.from_bytes(data[at + 4 : at + 8], "big")
    if told is None and not any(word in texts for word in WORDS):
        return BitFile(idcode, "", "", "", "")
    if told is None or told[5] != _digest(data[: told.start(5)] + NO_DIGEST + data[told.end(5) :]):
        why = "its text cannot be read" if told is None else "its digest is another one"
        raise input_error(str(path), f"is damaged: {why}", "copy it again, or run make bitstream")
    return BitFile(idcode, *(text.decode(errors="replace") for text in told.groups()[:4]))
