"""What the panel shows: the CRC-32 of a frame that has left for it."""

from __future__ import annotations

import time

from lippmann.board.board import Board
from lippmann.errors import device_error
from lippmann.registers import BOARD_REGISTERS

#: Frames that end until one has begun and ended.
FRAMES = 2
#: Seconds that the panel may take for them; a simulated one is slow.
SECONDS = 120.0
LOOK_S = 0.02


def shown_crc(board: Board) -> int:
    """Return the CRC-32 of a whole frame that began to leave for the panel after this call.

    Raises
    ------
    DeviceError
        When the board does not answer, or the panel stands still.
    """
    frames = BOARD_REGISTERS["frames"].address
    first = board.read(frames)[0]
    until = time.monotonic() + SECONDS
    while (board.read(frames)[0] - first) & 0xFFFFFFFF < FRAMES:
        if time.monotonic() > until:
            raise device_error(board.line.url, "the panel stands still", "check its clock and its cable")
        time.sleep(LOOK_S)
    return board.read(BOARD_REGISTERS["shown_crc"].address)[0]
