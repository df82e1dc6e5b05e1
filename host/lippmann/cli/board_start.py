"""Commands `lippmann board start` and `stop`."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click

from lippmann.base import interrupts
from lippmann.base.files import new_file, no_space, not_written, on_full_disk, own_text, write_file
from lippmann.cli.frame import Folder, make_command, option
from lippmann.cli.options import DISPLAY, FRACTION_BITS, TEXELS
from lippmann.cli.output import emit, log
from lippmann.display.description import Display
from lippmann.errors import DeviceError, InputError, LippmannError, input_error
from lippmann.fixed.scene_build import SceneBuild
from lippmann.simulation import virtual_board

#: Pause between two checks of a running board, s.
CHECK_S = 0.1
#: Environment variable with the id of the process that started a background board. A
#: board that is not ready ends if this process has ended.
LAUNCHER = "LIPPMANN_LAUNCHER"
#: Maximum time for writing the last captured frames, s.
CAPTURE_SECONDS = 10.0
ERRORS = {kind.exit_code: kind for kind in LippmannError.__subclasses__()}


def _drawing(
    *,
    layers: int | None = option("Number of layers of a board that draws scenes.", kind=click.IntRange(1, 8)),
    slots: int | None = option("Number of slots for textures.  [default: layers + 1]", kind=click.IntRange(1, 15)),
    slot: tuple[int, int] | None = option("Size of a slot in texels.  [default: 256x192]", kind=TEXELS),
    bilinear: bool = option("Interpolate between texels."),
    samples: int | None = option("Rays per pixel.  [default: 1]", kind=click.Choice([1, 2, 4])),
) -> SceneBuild | None:
    if layers is not None:
        width, height = slot or (SceneBuild.width, SceneBuild.height)
        return SceneBuild(layers, slots, width, height, bilinear, samples or 1)
    values = {"--slots": slots, "--slot": slot, "--bilinear": bilinear or None, "--samples": samples}
    names = [name for name, value in values.items() if value is not None]
    if names:
        raise input_error(", ".join(names), "needs a board that draws scenes", "add --layers N")
    return None


DRAWING: Any = _drawing


@make_command("start")
def start_command(
    display: Display = DISPLAY,
    line: virtual_board.Port | None = option("Type of port.  [default: unix; tcp with --tcp-port]"),
    tcp_port: int | None = option("TCP port on loopback; 0 selects a free port.", kind=click.IntRange(0, 65535)),
    baud: int | None = option("Simulate a UART with this baud rate.  [default: no UART]", kind=click.IntRange(1)),
    fraction_bits: int | None = option(
        "Fraction bits of RTL words.  [default: 16; 18 for scenes without --bilinear]", kind=FRACTION_BITS
    ),
    capture: Folder | None = option("Folder for a PNG of each new frame; created if missing."),
    ready: Path | None = option("JSON file for the board's URL; the file exists while the board runs."),
    trace: Path | None = option("Waveform file of the clock cycles in --trace-clocks.", metavar="FILE.fst"),
    scene: SceneBuild | None = DRAWING,
    memory: virtual_board.Memory = option("Frame memory: block RAM, or SDRAM with a real board's controller.", "block"),
    background: bool = option("Run the board in the background; needs --ready."),
    trace_clocks: tuple[int, int] = option(None, (0, 10**6), (click.IntRange(0), click.IntRange(1)), show_default=True),
) -> None:
    """Run a virtual board until Ctrl-C.

    Verilator simulates the board's RTL. The port is a Unix socket that only your user
    can open, a TCP port on loopback, or a pty.

    Example: lippmann board start --display scenes/displays/paper-square.toml --capture
    out
    """
    if line in ("pty", "unix") and tcp_port is not None:
        kind = "a pty" if line == "pty" else "a Unix socket"
        raise input_error("--tcp-port", f"{kind} has no port number", "leave out --tcp-port, or use --line tcp")
    if trace_clocks[0] >= trace_clocks[1]:
        what = f"{trace_clocks[0]} to {trace_clocks[1]} is an empty range"
        raise input_error("--trace-clocks", what, "give a larger second number")
    virtual_board.check_panel(display)
    _check_places(capture, ready, trace)
    if background and not ready:
        raise InputError("--background needs --ready FILE, which `lippmann board stop` reads")
    if tcp_port:
        virtual_board.check_free(tcp_port)
    log("starting the board (first start: half a minute) ...")
    if background and ready:
        _in_background(ready)
        return
    board = virtual_board.start(
        display,
        port=line,
        tcp_port=tcp_port,
        baud=baud,
        fraction_bits=fraction_bits,
        capture=capture,
        trace=trace,
        trace_clocks=trace_clocks,
        scene=scene,
        memory=memory,
    )
    _serve(board, display, "bits" if baud else "bytes", capture, ready)


def _serve(
    board: virtual_board.RunningBoard, display: Display, line: str, capture: Path | None, ready: Path | None
) -> None:
    size = {"width": display.panel.width_px, "height": display.panel.height_px}
    about = {"display": display.name, "identity": display.identity, **size}
    result = {"url": board.url, "pid": os.getpid(), **about, "line": line}
    counts: dict[str, Any] = {}
    with contextlib.ExitStack() as end:
        if ready:
            end.callback(_remove_ready, ready)
        if capture:
            virtual_board.remove_parts(capture)
            after = virtual_board.last_frame(capture)
            end.callback(virtual_board.keep_as_png, capture, display, after)
        end.callback(lambda: counts.update(board.stop()))
        try:
            if ready:
                if os.environ.get(LAUNCHER) not in (None, str(os.getppid())):
                    raise DeviceError(f"{ready}: the command that started this board was killed; start the board again")
                write_file(ready, json.dumps(result) + "\n")
            emit(result, f"{display.name}: {board.url} (Ctrl-C ends it)")
            sys.stdout.flush()
            with interrupts.hold_signals() as ended:
                while board.process.poll() is None and not ended:
                    if capture:
                        virtual_board.keep_as_png(capture, display, after)
                    time.sleep(CHECK_S)
        except KeyboardInterrupt:
            interrupts.received.clear()  # Ctrl-C is the normal way to stop a board
    speed = f"{counts['clocks'] / counts['seconds'] / 1e6:.2f} M clocks/s, {counts['frames']} frames"
    log(f"{speed}, {counts['bytes_in']} bytes in, {counts['bytes_out']} out")


def _check_places(capture: Path | None, ready: Path | None, trace: Path | None) -> None:
    change = "choose another folder or change permissions"
    if capture:
        try:
            capture.mkdir(parents=True, exist_ok=True)
        except PermissionError:
            raise input_error("--capture", f"{capture} cannot be made", change) from None
        except OSError:  # the checks below report the error
            pass
    folders = {"--capture": capture, "--ready": ready and ready.parent, "--trace": trace and trace.parent}
    for name, place in folders.items():
        if not place:
            continue
        if not place.exists():
            raise input_error(name, f"the folder {place} does not exist", "make the folder first")
        if not place.is_dir():
            raise input_error(name, f"{place} is a file", "name a folder")
        if not os.access(place, os.W_OK):
            raise input_error(name, f"{place} cannot be written to", change)
    if ready and ready.is_dir():
        raise input_error("--ready", f"{ready} is a folder", "name a file")
    if ready and _is_running((other := _content(ready)).get("pid")):
        what = f"{ready} belongs to a running board ({other['url']})"
        raise input_error("--ready", what, "stop that board, or name a new file")


def _in_background(ready: Path) -> None:
    ready.unlink(missing_ok=True)
    output = Path(f"{ready}.log")
    if (failure := _failure(output)) is not None:
        log(f"the previous board had ended: {failure} (exit code {failure.exit_code})")
    # With --json, the last line of the board's log is the error.
    arguments = [word for word in click.get_current_context().obj if word not in ("--background", "--json")]
    words = [sys.executable, "-P", "-m", "lippmann", *arguments, "--json"]
    environment = {**os.environ, LAUNCHER: str(os.getpid())}
    try:
        file = new_file(output)
    except OSError as error:
        raise not_written(output, error) from None
    with file:
        process = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True, env=environment
        )
    try:
        with interrupts.hold_signals() as ended:
            while process.poll() is None and not ready.exists() and not ended:
                time.sleep(CHECK_S)
        if not ready.exists():
            # After a crash, or on a full disk, the log has no message.
            what = f"the board ended without a message (exit code {process.returncode})"
            silent = DeviceError(f"{what}; start the board without --background to see its output")
            failure = _failure(output) or (no_space(str(output)) if on_full_disk(output) else silent)
            output.unlink()
            raise failure
        result = json.loads(ready.read_text())
        emit(result, f"{result['url']} (lippmann board stop --ready {shlex.quote(str(ready))} ends it)")
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of stdout has ended
        raise
    except (KeyboardInterrupt, OSError):  # OSError: the URL cannot be printed
        os.killpg(process.pid, signal.SIGTERM)  # ends the compilers too
        process.wait()
        output.unlink()
        raise


def _failure(output: Path) -> LippmannError | None:
    try:
        last = json.loads(own_text(output).splitlines()[-1])
        return ERRORS.get(last["exit_code"], DeviceError)(last["error"])
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _remove_ready(ready: Path) -> None:
    if _content(ready).get("pid") == os.getpid():
        ready.unlink(missing_ok=True)


def _content(ready: Path) -> dict[str, Any]:
    try:
        if not ready.is_file():  # reading a pipe would block
            return {}
        content = json.loads(ready.read_text())
        return {"url": str(content["url"]), "pid": int(content["pid"])}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _is_running(pid: int | None) -> bool:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return b"board" in words and b"start" in words


@make_command("stop")
def stop_command(ready: Path = option("The --ready file that `lippmann board start` wrote.")) -> None:
    """Stop a virtual board that runs in the background.

    Example: lippmann board stop --ready out/board.json
    """
    output, content = Path(f"{ready}.log"), _content(ready)
    failure = _failure(output)
    if not content and failure is None:
        raise input_error(ready, "names no board", "give the --ready file of `lippmann board start`")
    if not _is_running(content.get("pid")):
        if content:
            ready.unlink(missing_ok=True)
        if failure is None:
            raise DeviceError(f"{ready}: the board had already ended without a message; the file is removed")
        raise type(failure)(f"the board had already ended: {failure} (exit code {failure.exit_code})")
    url, pid = content["url"], content["pid"]
    os.kill(pid, signal.SIGINT)
    # The board stops its simulator first, and then writes the captured frames.
    seconds = virtual_board.STOP_SECONDS + CAPTURE_SECONDS
    until = time.monotonic() + seconds
    while _is_running(pid):  # the board removes the ready file before its process ends
        if time.monotonic() > until:
            raise DeviceError(f"{url}: the board did not end within {seconds:g} s; kill process {pid}")
        time.sleep(CHECK_S)
    if (failure := _failure(output)) is not None:
        raise failure
    output.unlink(missing_ok=True)
    emit(content, f"{url}: ended")
