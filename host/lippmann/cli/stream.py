"""Command `lippmann stream`."""

from __future__ import annotations

import contextlib
import time
from dataclasses import asdict

from lippmann.base.images import check_input
from lippmann.board.board import Board
from lippmann.board.packets import RESET_VERSION
from lippmann.board.panel_frames import check_frame
from lippmann.board.retries import END_SCENE, RETRY_S
from lippmann.board.streaming import Sent, send_frame
from lippmann.board.tiles import Pixels
from lippmann.cli.frame import KINDS, Name, argument, make_command, option
from lippmann.cli.options import FORCE, finite
from lippmann.cli.options_port import BAUD, PORT, check_board, chosen_port
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import Display, TransferName
from lippmann.errors import NoBoardError, device_error


@make_command("stream")
def command(
    images: tuple[Name, ...] = argument("IMAGE...", kind=KINDS[Name], nargs=-1),
    port: str | None = PORT,
    baud: int | None = BAUD,
    display: Display | None = option("Display file of the board; the image's transfer curve and bits must match."),
    transfer: TransferName | None = option(
        "Transfer curve of the panel and the image.  [default: the image's, or srgb]"
    ),
    force: bool = FORCE,
    resume_s: float = option("Time to wait for a board after a lost connection, s.", 0.0, finite(0.0)),
    verify: bool = option("Compare the CRC-32 of the scanned-out frame with that of the image."),
) -> None:
    """Stream images to the panel of a board.

    Several images make an animation. The panel keeps a frame until the next frame is
    complete and its CRC-32 is correct. After an interruption, run the command again:
    tiles that the board already has are not sent.

    Example: lippmann stream out/fish.exr --verify
    """
    for image in images:
        check_input(image)
    url, rate = chosen_port(port, baud)
    with contextlib.closing(_Stream(url, rate, resume_s, verify)) as stream:
        hello = stream.board.info
        if display is not None and not force:
            check_board(stream.board, display, "stream")
        behind = stream.board.draws_scene()
        if behind and verify:
            raise device_error(url, "draws a scene; frames cannot be verified", f"{END_SCENE}; or leave out --verify")
        stream.board.check_panel()
        panel = None if display is None else display.panel
        # Check all files before the panel changes.
        files = [check_frame(image, hello, transfer, panel, force) for image in images]
        assumptions = [file.assumption for file in files if file.assumption]
        if assumptions:
            log(assumptions[0] + (f" (and {len(assumptions) - 1} other images)" if assumptions[1:] else ""))
        results, lines = [], list[str]()
        for image, file in zip(images, files, strict=True):
            try:
                total = stream.send(file.pixels(), f"streaming {image}")
            except Exception:
                for line in lines:  # these images were sent
                    log(line)
                raise
            rates = {"bytes_per_second": total.rate, "overhead": total.overhead}
            verified = {"verified": True} if verify else {}
            lines.append(f"{image}: {_summary(total, behind)}{', verified on the panel' if verify else ''}")
            results.append({"image": image, **asdict(total), "crc": f"{total.crc:08x}", **rates, **verified})
    result = {"port": url, "identity": f"{hello.identity:016x}", "behind_scene": behind, "frames": results}
    emit(result, lines)


class _Stream:
    def __init__(self, url: str, baud: int, resume_s: float, verify: bool) -> None:
        self._url, self._baud, self._resume_s, self._verify = url, baud, resume_s, verify
        self.board = self._open_board()

    def close(self) -> None:
        self.board.close()

    def send(self, frame: Pixels, label: str) -> Sent:
        """Show a frame and verify it if requested; after a lost connection, resume the transfer."""
        total = Sent()
        hello = self.board.info
        arrived, was_reset = -1, False
        with progress_bar(label) as progress:
            while True:
                try:
                    send_frame(self.board, frame, progress, counts=total)
                    if self._verify:
                        self.board.verify(total.crc)
                    return total
                except NoBoardError as error:
                    if not self._resume_s:
                        raise
                    # If no new tile arrived, another attempt would fail too.
                    stuck = len(total.arrived) == arrived
                    if stuck and (was_reset or hello.version < RESET_VERSION):
                        after = ", also after a reset" if was_reset else ""
                        raise NoBoardError(f"{error} (connection lost twice, no new tile in between{after})") from None
                    arrived = len(total.arrived)
                    log(f"{error}; searching for the board for {self._resume_s:g} s")
                    self.board.close()
                    self.board = self._open_board()
                    self.board.must_be(hello)
                    if stuck:
                        log(f"{self._url}: no tile arrives; resetting the board")
                        self.board.reset()
                        was_reset = True

    def _open_board(self) -> Board:
        deadline = time.monotonic() + self._resume_s
        while True:
            try:
                return Board.open(self._url, self._baud)
            except NoBoardError as error:
                if not self._resume_s:
                    raise
                if time.monotonic() >= deadline:
                    what = f"{error} (waited {self._resume_s:g} s; the same command continues the frame)"
                    raise NoBoardError(what) from None
            time.sleep(RETRY_S)


def _summary(total: Sent, behind: bool) -> str:
    if total.unchanged:
        return "stored already" if behind else "already on the panel"
    counts = {kind: getattr(total, kind) for kind in ("raw", "solid", "qoi", "copied", "skipped")}
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    speed = f"{total.rate / 1000:.4g} KB/s; {total.wire_bytes / 1000:.4g} KB on the line"
    tiles = f"{total.tiles} tiles: {kinds}; {total.resends} sent again"
    return f"{total.image_bytes / 1000:.0f} KB in {total.seconds:.3g} s ({speed}; {tiles})"
