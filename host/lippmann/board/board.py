"""The public class of a board: it shows images on the panel and verifies the scanned-out frame."""

from __future__ import annotations

import time

from lippmann.board.connection import Connection
from lippmann.board.frames import image_frame
from lippmann.board.stream import Progress, Sent, send_frame
from lippmann.errors import device_error
from lippmann.integral_image import IntegralImage
from lippmann.registers import BOARD_REGISTERS

#: Frame ends until one whole frame has begun and ended.
FRAME_ENDS = 2
#: Longest time for these frames, s: a simulated panel is slow.
FRAME_SECONDS = 120.0
#: Pause between two queries of the frame counter, s.
QUERY_S = 0.02


class Board(Connection):
    """A board with a panel, real or virtual.

    Examples
    --------
    >>> with Board.open("socket://127.0.0.1:4000") as board:  # doctest: +SKIP
    ...     board.show(image)
    """

    def show(self, image: IntegralImage, progress: Progress | None = None, force: bool = False) -> Sent:
        """Show an image on the panel, encoded with the transfer curve and the bits of the image's display.

        The panel keeps its frame until the new one has arrived whole and its CRC-32 is right.

        Parameters
        ----------
        image
            The image; its display must be the board's.
        progress
            Called with (tiles done, tiles of the frame).
        force
            Show an image for another display of the same size in pixels.

        Returns
        -------
        Tiles, bytes and seconds that the transfer took.

        Raises
        ------
        InputError
            For an image of another display, size, transfer curve or number of bits.
        DeviceError
            When the board does not answer, or refuses the frame.
        """
        return send_frame(self, image_frame(image, self.info, force), progress)

    def panel_crc(self) -> int:
        """Return the CRC-32 of a frame that was scanned out, from first to last pixel, after this call.

        Raises
        ------
        DeviceError
            When the board does not answer, or scans out no frame.
        """
        frames = BOARD_REGISTERS["frames"].address
        first = self.read(frames)[0]
        until = time.monotonic() + FRAME_SECONDS
        while (self.read(frames)[0] - first) & 0xFFFFFFFF < FRAME_ENDS:
            if time.monotonic() > until:
                raise device_error(self.line.url, "the board scans out no frame", "check its clock and its cable")
            time.sleep(QUERY_S)
        return self.read(BOARD_REGISTERS["shown_crc"].address)[0]

    def verify(self, crc: int) -> None:
        """Compare the CRC-32 of the scanned-out frame with that of the frame that was sent.

        Raises
        ------
        DeviceError
            When they differ, or the board scans out no frame.
        """
        scanned = self.panel_crc()
        if scanned == crc:
            return
        display = BOARD_REGISTERS["display"]
        changed = self.read(display.address)[0] != display.fields["brightness"].reset
        remedy = "set brightness=255 pattern=0 to verify (lippmann board write display)"
        raise device_error(
            self.line.url,
            f"the panel shows a frame of CRC-32 {scanned:08x}, the frame sent has {crc:08x}",
            remedy if changed else "stream the frame again",
        )
