"""`lippmann board start` and `stop`: a virtual board, in the foreground or in the background."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click

from lippmann.cli import interrupts
from lippmann.cli.options.common import display_option, json_option
from lippmann.cli.output import emit, log
from lippmann.display import load_display
from lippmann.errors import DeviceError, InputError, LippmannError, MissingLibraryError, input_error
from lippmann.fixed.words import COMPACT, FRACTIONS
from lippmann.images import replacing

#: Seconds between two looks at a board that runs, and that it has to end.
LOOK_S, STOP_SECONDS = 0.1, 10.0
#: Errors by their exit code.
ERRORS: dict[int, type[LippmannError]] = {
    kind.exit_code: kind for kind in (DeviceError, InputError, MissingLibraryError)
}


@click.command("start")
@display_option
@click.option("--line", type=click.Choice(["tcp", "pty"]), default="tcp", show_default=True, help="How it is reached.")
@click.option("--tcp-port", type=click.IntRange(0, 65535), default=0, help="TCP port on loopback; 0: any that is free.")
@click.option("--baud", type=click.IntRange(1), help="A UART's wires of this rate, clock by clock; else bytes at once.")
@click.option(
    "--fraction-bits", type=click.IntRange(FRACTIONS[0], FRACTIONS[-1]), default=COMPACT, show_default=True,
    help="Word length of its optics.",
)  # fmt: skip
@click.option("--capture", metavar="FOLDER", help="Keep every new frame that is scanned out, as PNG.")
@click.option("--ready", metavar="FILE", help="JSON file that tells where to connect, while the board runs.")
@click.option("--trace", metavar="FILE.fst", help="Waveforms, of the clocks --trace-clocks.")
@click.option("--background", is_flag=True, help="Leave it running, and return once it can be reached; needs --ready.")
@click.option("--trace-clocks", type=(click.IntRange(0), click.IntRange(1)), default=(0, 1_000_000), show_default=True)
@json_option
def start_command(
    display_path: str,
    line: Any,
    tcp_port: int,
    baud: int | None,
    fraction_bits: int,
    capture: str | None,
    ready: str | None,
    trace: str | None,
    trace_clocks: tuple[int, int],
    background: bool,
    as_json: bool,
) -> None:
    """Run a virtual board until Ctrl-C: the RTL under Verilator, on TCP (loopback only) or on a pty.

    Example: lippmann board start --display scenes/displays/paper-square.toml --capture out
    """
    from lippmann.sim import virtual_board

    if line == "pty" and tcp_port:
        raise input_error("--tcp-port", "a pty has no port", "leave it out, or take --line tcp")
    if trace_clocks[0] >= trace_clocks[1]:
        raise input_error(
            "--trace-clocks", f"{trace_clocks[0]} to {trace_clocks[1]} are none", "give the first one first"
        )
    display = load_display(display_path)
    folder = None if capture is None else Path(capture)
    _check_places(folder, ready, trace)
    log("starting the board; it is compiled where it is not yet (half a minute) ...")
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGINT))  # ends it as Ctrl-C does
    if background:
        if ready is None:
            raise InputError("--background needs --ready FILE, by which `lippmann board stop` finds the board")
        _in_background(Path(ready), as_json)
        return
    board = virtual_board.start(
        display, port=line, tcp_port=tcp_port, baud=baud, fraction_bits=fraction_bits, capture=folder,
        trace=None if trace is None else Path(trace), trace_clocks=trace_clocks,
    )  # fmt: skip
    told = {
        "url": board.url, "pid": os.getpid(), "display": display.name, "identity": display.identity,
        "width": display.panel.width_px, "height": display.panel.height_px, "line": "bits" if baud else "bytes",
    }  # fmt: skip
    done: dict[str, Any] = {}
    with contextlib.ExitStack() as end:
        if ready is not None:
            end.callback(_forget, Path(ready))
        if folder is not None:
            end.callback(virtual_board.keep_as_png, folder, display)
        end.callback(lambda: done.update(board.stop()))
        try:
            if ready is not None:
                with replacing(Path(ready)) as partial:
                    partial.write_text(json.dumps(told) + "\n")
            emit(told, as_json, lambda: click.echo(f"{display.name}: {board.url} (Ctrl-C ends it)"))
            sys.stdout.flush()
            while board.process.poll() is None:
                if folder is not None:
                    virtual_board.keep_as_png(folder, display)
                time.sleep(LOOK_S)
        except KeyboardInterrupt:
            interrupts.clear()  # the usual end of this command
    log(
        f"{done['clocks'] / done['seconds'] / 1e6:.2f} M clocks/s, {done['frames']} frames, "
        f"{done['bytes_in']} bytes in, {done['bytes_out']} out"
    )


def _check_places(capture: Path | None, ready: str | None, trace: str | None) -> None:
    """Refuse folders that are not there or cannot be written to, and a ready file whose board runs."""
    places = {"--capture": capture, "--ready": ready and Path(ready).parent, "--trace": trace and Path(trace).parent}
    for option, place in places.items():
        if place and not Path(place).is_dir():
            raise input_error(option, f"no folder {place}", "make it first")
        if place and not os.access(place, os.W_OK):
            raise input_error(option, f"{place} cannot be written to", "choose another folder or change permissions")
    if ready is not None and (other := _running(Path(ready))) is not None:
        raise input_error("--ready", f"{ready} tells of a board that runs ({other[1]})", "end it, or name another file")


def _in_background(ready: Path, as_json: bool) -> None:
    """Run the same command without --background in a session of its own; return when its ready file is there."""
    ready.unlink(missing_ok=True)
    said = _log_of(ready)
    if (failure := _failure(said)) is not None:
        log(f"the board before had ended: {failure} (exit code {failure.exit_code})")
    # In JSON an error comes with its exit code, and is the last line.
    words = [word for word in sys.argv[1:] if word not in ("--background", "--json")] + ["--json"]
    with said.open("wb") as told:
        process = subprocess.Popen(
            [sys.executable, "-m", "lippmann", *words], stdin=subprocess.DEVNULL, stdout=told, stderr=told,
            start_new_session=True,
        )  # fmt: skip
    try:
        while not ready.exists():
            if process.poll() is not None:
                failure = _failure(said) or DeviceError(f"the board ended without a word ({process.returncode})")
                said.unlink()
                raise failure
            time.sleep(LOOK_S)
    except KeyboardInterrupt:
        os.killpg(process.pid, signal.SIGTERM)  # a session of its own: compilers and all
        process.wait()
        said.unlink()
        raise
    result = json.loads(ready.read_text())
    emit(result, as_json, lambda: click.echo(f"{result['url']} (lippmann board stop --ready {ready} ends it)"))


def _log_of(ready: Path) -> Path:
    """Return where a board in the background writes what it has to say."""
    return Path(f"{ready}.log")


def _failure(said: Path) -> LippmannError | None:
    """Return the error that the last line of a board's log tells; None where there is none."""
    try:
        told = json.loads(said.read_text(errors="replace").splitlines()[-1])
        return ERRORS.get(told["exit_code"], DeviceError)(told["error"])
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _forget(ready: Path) -> None:
    """Remove this process's ready file."""
    if (told := _told(ready)) is not None and told[0] == os.getpid():
        ready.unlink(missing_ok=True)


def _told(ready: Path) -> tuple[int, str] | None:
    """Return process and URL that a ready file tells; None when it tells of no board."""
    try:
        told = json.loads(ready.read_text())
        return int(told["pid"]), str(told["url"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _running(ready: Path) -> tuple[int, str] | None:
    """Return the same of a board that runs: its process is one of this command."""
    told = _told(ready)
    if told is None:
        return None
    try:
        words = Path(f"/proc/{told[0]}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return None
    return told if b"board" in words and b"start" in words else None


@click.command("stop")
@click.option("--ready", required=True, metavar="FILE", help="The file that the board was started with.")
@json_option
def stop_command(ready: str, as_json: bool) -> None:
    """End a virtual board that runs in the background.

    Example: lippmann board stop --ready out/board.json
    """
    path = Path(ready)
    said = _log_of(path)
    told = _told(path)
    failure = _failure(said)
    if told is None and failure is None:
        raise input_error(ready, "tells of no board", "give the --ready file of `lippmann board start`")
    running = _running(path)
    if running is None:
        if told is not None:
            path.unlink(missing_ok=True)
        if failure is None:
            raise DeviceError(f"{ready}: its board had ended already and did not say why; the file is removed")
        raise type(failure)(f"its board had ended already: {failure} (exit code {failure.exit_code})")
    pid, url = running
    os.kill(pid, signal.SIGINT)
    until = time.monotonic() + STOP_SECONDS
    while _running(path) is not None:
        if time.monotonic() > until:
            raise DeviceError(f"{url}: the board does not end within {STOP_SECONDS:g} s; kill process {pid}")
        time.sleep(LOOK_S)
    if (failure := _failure(said)) is not None:
        raise failure
    said.unlink(missing_ok=True)
    emit({"url": url, "pid": pid}, as_json, lambda: click.echo(f"{url}: ended"))
