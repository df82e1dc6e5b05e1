"""`lippmann stream`: bring images to a board's panel, whole and unchanged, or not at all."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any, get_args

import click

from lippmann.board.board import Board, Hello
from lippmann.board.displayed import shown_crc
from lippmann.board.frames import load_frame
from lippmann.board.stream import Sent, send_frame
from lippmann.cli.options.common import Finite, json_option
from lippmann.cli.options.port import baud_option, chosen_port, port_option
from lippmann.cli.output import emit, log, progress_bar
from lippmann.display import Transfer
from lippmann.errors import DeviceError, NoBoardError, device_error
from lippmann.registers import BOARD_REGISTERS

#: Seconds between attempts to find a lost board again.
RETRY_S = 0.5


@click.command("stream")
@click.argument("images", nargs=-1, required=True, metavar="IMAGE...")
@port_option
@baud_option
@click.option(
    "--transfer", type=click.Choice(get_args(Transfer)), default="srgb", show_default=True, help="The panel's curve."
)
@click.option("--force", is_flag=True, help="Stream an image that was rendered for another display, or names none.")
@click.option(
    "--resume", "resume_s", type=Finite(0.0), default=0.0, metavar="SECONDS",
    help="When the line is lost, wait so long for the board and go on from what it holds.",
)  # fmt: skip
@click.option("--verify", is_flag=True, help="Ask the board for the CRC-32 of the frame that left for the panel.")
@json_option
def command(
    images: tuple[str, ...],
    port: str | None,
    baud: int,
    transfer: Transfer,
    force: bool,
    resume_s: float,
    verify: bool,
    as_json: bool,
) -> None:
    """Stream an image, or an animation of several, to the panel of a board.

    The panel shows a frame when all of it has arrived and its CRC-32 is right, and until then the one before. What the
    board holds already is not sent: after an interruption the same command goes on where it stopped.

    Example: lippmann stream out/fish.exr --port socket://127.0.0.1:4000 --verify
    """
    url = chosen_port(port, baud)
    board = _opened(url, baud, resume_s)
    try:
        hello = board.info
        # All are read before the first is sent: a bad one shows nothing.
        frames = [load_frame(image, hello, transfer, force=force) for image in images]
        results = []
        for image, frame in zip(images, frames, strict=True):
            sent = Sent()
            result: dict[str, Any] = {}
            arrived = -1
            with progress_bar(f"streaming {image}", as_json) as progress:
                while True:
                    try:
                        send_frame(board, frame, progress, sent=sent)
                        if verify:
                            result["verified"] = _verified(board, sent)
                        break
                    except NoBoardError as error:
                        if not resume_s:
                            raise
                        if len(sent.arrived) == arrived:
                            # It would be lost at the same place for ever.
                            raise NoBoardError(f"{error} (lost before, and no tile more has arrived since)") from None
                        arrived = len(sent.arrived)
                        log(f"{error}; looking for the board for {resume_s:g} s")
                        board.close()
                        board = _again(url, baud, hello, resume_s)
            results.append({"image": image, **_told(sent), **result})
    finally:
        board.close()

    def text() -> None:
        for result in results:
            click.echo(_line(result))

    emit({"port": url, "identity": f"{hello.identity:016x}", "frames": results}, as_json, text)


def _opened(url: str, baud: int, seconds: float) -> Board:
    """Open a board, waiting so long for it.

    Raises
    ------
    NoBoardError
        When it does not answer in time.
    DeviceError
        When it is one that cannot be talked to.
    """
    until = time.monotonic() + seconds
    while True:
        try:
            return Board.open(url, baud)
        except NoBoardError as error:
            if time.monotonic() >= until:
                if not seconds:
                    raise
                raise NoBoardError(
                    f"{error} (waited {seconds:g} s; the same command goes on from what it holds)"
                ) from None
        time.sleep(RETRY_S)


def _again(url: str, baud: int, hello: Hello, seconds: float) -> Board:
    """Open the board again once it answers; it must drive the same display.

    Raises
    ------
    DeviceError
        When it does not answer in time, or another one does.
    """
    board = _opened(url, baud, seconds)
    try:
        board.must_be(hello)
    except DeviceError:
        board.close()
        raise
    return board


def _verified(board: Board, sent: Sent) -> bool:
    """Compare the CRC-32 of what left for the panel with that of the frame.

    Raises
    ------
    DeviceError
        When they differ, or the panel stands still.
    """
    shown = shown_crc(board)
    if shown == sent.crc:
        return True
    what = f"the panel shows CRC-32 {shown:08x}, sent was {sent.crc:08x}"
    if board.read(BOARD_REGISTERS["display"].address)[0] != BOARD_REGISTERS["display"].fields["brightness"].reset:
        raise device_error(
            board.line.url, what, "set brightness=255 pattern=0 to verify (lippmann board write display)"
        )
    raise device_error(board.line.url, what, "stream the frame again")


def _told(sent: Sent) -> dict[str, Any]:
    return {**asdict(sent), "crc": f"{sent.crc:08x}", "bytes_per_second": sent.rate, "overhead": sent.overhead}


def _line(result: dict[str, Any]) -> str:
    if result["unchanged"]:
        text = "shown already"
    else:
        kinds = ", ".join(
            f"{result[kind]} {kind}" for kind in ("raw", "solid", "qoi", "copied", "skipped") if result[kind]
        )
        text = (
            f"{result['image_bytes'] / 1000:.0f} KB in {result['seconds']:.3g} s "
            f"({result['bytes_per_second'] / 1000:.4g} KB/s; {result['wire_bytes'] / 1000:.4g} KB on the line; "
            f"{result['tiles']} tiles: {kinds}; {result['resends']} sent again)"
        )
    return f"{result['image']}: {text}" + (", verified on the panel" if result.get("verified") else "")
