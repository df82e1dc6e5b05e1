"""`lippmann stream`: show images on a board's panel."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any

from lippmann.base.images import check_input
from lippmann.board.board import END_SCENE, Board
from lippmann.board.drawn_scene import SceneBoard
from lippmann.board.packets import RESET_VERSION, SCENE_VERSION
from lippmann.board.panel_frames import load_frame
from lippmann.board.streaming import Sent, send_frame
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options.common import Finite
from lippmann.cli.options.port import BAUD, PORT, check_board, chosen_port
from lippmann.cli.output import emit, log
from lippmann.cli.progress_bar import progress_bar
from lippmann.display.description import TransferName, load_display
from lippmann.errors import NoBoardError, device_error

#: Pause between attempts to reopen a lost board, s.
RETRY_S = 0.5


@make_command("stream")
def command(
    images: tuple[str, ...] = argument("IMAGE...", kind=str, nargs=-1),
    port: str | None = PORT,
    baud: int | None = BAUD,
    display_path: str | None = option(
        "The board's display file; its curve and bits must be the image's.", None, flag="--display", metavar="FILE"
    ),
    transfer: TransferName | None = option(
        "The panel's curve; must be the image's. Default: the image's, or srgb if it names none.", None
    ),
    force: bool = option("Stream an image that was rendered for another display, or names none.", False),
    resume_s: float = option(
        "When the connection is lost, wait for the board and continue with the tiles that it lacks.",
        0.0,
        Finite(0.0),
        flag="--resume",
        metavar="SECONDS",
        show_default=False,
    ),
    verify: bool = option("Compare the CRC-32 of the scanned-out frame with the image's.", False),
) -> None:
    """Stream images to the panel of a board.

    Several images make an animation. The panel shows a frame when all of it has arrived and its CRC-32 is right; until
    then it keeps the previous frame. Tiles that the board already holds are not sent: after an interruption, run the
    same command again.

    Example: lippmann stream out/fish.exr --port socket://127.0.0.1:4000 --verify
    """
    display = None if display_path is None else load_display(display_path)
    for image in images:
        check_input(image)
    url, rate = chosen_port(port, baud)
    board = _opened(url, rate, resume_s)
    try:
        hello = board.info
        if display is not None and not force:
            check_board(board, display, str(display_path), ", or stream with --force")
        board.check_no_pattern()
        behind = _is_behind_scene(board, verify)
        panel = None if display is None else display.panel
        # All files are read before the first frame is sent: when one is refused, nothing changes on the panel.
        notes: list[str] = []
        frames = [load_frame(image, hello, transfer, panel, force, notes.append) for image in images]
        if notes:
            log(notes[0] + (f" (and {len(notes) - 1} other images)" if notes[1:] else ""))
        results = []
        for image, frame in zip(images, frames, strict=True):
            sent = Sent()
            arrived, was_reset = -1, False
            with progress_bar(f"streaming {image}") as progress:
                while True:
                    try:
                        send_frame(board, frame, progress, sent=sent)
                        if verify:
                            board.verify(sent.crc)
                        break
                    except NoBoardError as error:
                        if not resume_s:
                            raise
                        # Without a new tile since the last loss, another attempt would fail the same way.
                        stuck = len(sent.arrived) == arrived
                        if stuck and (was_reset or hello.version < RESET_VERSION):
                            after = ", also after a reset" if was_reset else ""
                            raise NoBoardError(f"{error} (lost twice without a new tile in between{after})") from None
                        arrived = len(sent.arrived)
                        log(f"{error}; looking for the board for {resume_s:g} s")
                        board.close()
                        board = _opened(url, rate, resume_s)
                        board.must_be(hello)
                        if stuck:
                            log(f"{url}: no tile arrives; resetting the board")
                            board.reset()
                            was_reset = True
            rates = {"bytes_per_second": sent.rate, "overhead": sent.overhead}
            verified = {"verified": True} if verify else {}
            results.append({"image": image, **asdict(sent), "crc": f"{sent.crc:08x}", **rates, **verified})
    finally:
        board.close()

    result = {"port": url, "identity": f"{hello.identity:016x}", "behind_scene": behind, "frames": results}
    emit(result, (_line(one, behind) for one in results))


def _is_behind_scene(board: Board, verify: bool) -> bool:
    """Return whether a streamed frame is stored behind the scene that a board draws; refuse to verify it there."""
    if board.info.version < SCENE_VERSION or not SceneBoard(board).status().shown:
        return False
    shows = "the panel shows the scene that the board draws"
    if verify:
        what = f"{shows}, so that a frame cannot be verified there"
        raise device_error(board.line.url, what, f"{END_SCENE}; or stream without --verify")
    log(f"note: {shows}; the frame is stored, and shown when the scene ends")
    return True


def _opened(url: str, baud: int, seconds: float) -> Board:
    """Open a board; repeat until it answers, for at most `seconds`. Raises as `Board.open`."""
    deadline = time.monotonic() + seconds
    while True:
        try:
            return Board.open(url, baud)
        except NoBoardError as error:
            if time.monotonic() >= deadline:
                if not seconds:
                    raise
                raise NoBoardError(f"{error} (waited {seconds:g} s; the same command continues the frame)") from None
        time.sleep(RETRY_S)


def _line(result: dict[str, Any], behind: bool) -> str:
    """Return a frame's result as one line."""
    if result["unchanged"]:
        text = "stored already" if behind else "already on the panel"
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
