"""`lippmann board start` and `stop`: a virtual board, in the foreground or in the background."""

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
#: Variable of a board in the background: the process that waits for it, without which it ends before it is ready.
LAUNCHER = "LIPPMANN_LAUNCHER"
#: Longest time to write the last captured frames, after the simulator has ended, s.
CAPTURE_SECONDS = 10.0
#: Errors by their exit code.
ERRORS = {kind.exit_code: kind for kind in LippmannError.__subclasses__()}


def _drawing(
    *,
    layers: int | None = option("Build a board that draws scenes of so many layers.", None, click.IntRange(1, 8)),
    slots: int | None = option("Its slots for textures.  [default: layers + 1]", None, click.IntRange(1, 15)),
    slot: tuple[int, int] | None = option("Texels of a slot.  [default: 256x192]", None, TEXELS),
    bilinear: bool = option("Interpolate its texels.", False),
    samples: int | None = option("Rays for each pixel: 1, 2 or 4.  [default: 1]", None, click.Choice([1, 2, 4])),
) -> SceneBuild | None:
    """Return the build of a board that draws; None without --layers, which the other options need."""
    if layers is not None:
        width, height = slot or (SceneBuild.width, SceneBuild.height)
        return SceneBuild(layers, slots, width, height, bilinear, samples or 1)
    values = {"--slots": slots, "--slot": slot, "--bilinear": bilinear or None, "--samples": samples}
    names = [name for name, value in values.items() if value is not None]
    if names:
        raise input_error(", ".join(names), "only a board that draws has this", "add --layers N")
    return None


#: The build of a board that draws, from its own options.
DRAWING: Any = _drawing


@make_command("start")
def start_command(
    display: Display = DISPLAY,
    line: virtual_board.Port | None = option(
        "Kind of port.  [default: a Unix socket of yours alone; tcp with --tcp-port]", None
    ),
    tcp_port: int | None = option("TCP port on loopback; 0: a free one.", None, click.IntRange(0, 65535)),
    baud: int | None = option("Simulate a UART of this rate; default: a line without a rate.", None, click.IntRange(1)),
    fraction_bits: int | None = option(
        "Word length of its optics.  [default: 16; 18 when it draws nearest texels]", None, FRACTION_BITS
    ),
    capture: Folder | None = option("Write every new frame that is scanned out, as PNG; made when missing.", None),
    ready: Path | None = option("Write the board's URL to this JSON file, while the board runs.", None),
    trace: Path | None = option("Write waveforms of the clocks --trace-clocks.", None, metavar="FILE.fst"),
    scene: SceneBuild | None = DRAWING,
    memory: virtual_board.Memory = option(
        "Where its frames are: block RAM, or a chip of SDRAM with the controller of a real board.", "block"
    ),
    background: bool = option("Return when the board is ready, and let it run; needs --ready.", False),
    trace_clocks: tuple[int, int] = option(
        None, (0, 1_000_000), (click.IntRange(0), click.IntRange(1)), show_default=True
    ),
) -> None:
    """Run a virtual board until Ctrl-C.

    It is the board's RTL under Verilator, on a Unix socket, on TCP (loopback only) or on a pty.

    Example: lippmann board start --display scenes/displays/paper-square.toml --capture out
    """
    if line in ("pty", "unix") and tcp_port is not None:
        kind = "a pty" if line == "pty" else "a Unix socket"
        raise input_error("--tcp-port", f"{kind} has no port number", "leave it out, or use --line tcp")
    if trace_clocks[0] >= trace_clocks[1]:
        what = f"{trace_clocks[0]} to {trace_clocks[1]} is an empty range"
        raise input_error("--trace-clocks", what, "give the first clock first")
    virtual_board.check_panel(display)
    _check_places(capture, ready, trace)
    if background and not ready:
        raise InputError("--background needs --ready FILE, from which `lippmann board stop` reads the process")
    if tcp_port:
        virtual_board.check_free(tcp_port)
    log("starting the board; the first start compiles it (half a minute) ...")
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
    """Run a board until it ends or Ctrl-C: write the ready file, print where it is, and keep its frames as PNG."""
    result = {
        "url": board.url,
        "pid": os.getpid(),
        "display": display.name,
        "identity": display.identity,
        "width": display.panel.width_px,
        "height": display.panel.height_px,
        "line": line,
    }
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
                    raise DeviceError(f"{ready}: the command that waited for this board was killed; start it again")
                write_file(ready, json.dumps(result) + "\n")
            emit(result, f"{display.name}: {board.url} (Ctrl-C ends it)")
            sys.stdout.flush()
            with interrupts.held() as ended:
                while board.process.poll() is None and not ended:
                    if capture:
                        virtual_board.keep_as_png(capture, display, after)
                    time.sleep(CHECK_S)
        except KeyboardInterrupt:
            interrupts.received.clear()  # the usual end of this command
    log(
        f"{counts['clocks'] / counts['seconds'] / 1e6:.2f} M clocks/s, {counts['frames']} frames, "
        f"{counts['bytes_in']} bytes in, {counts['bytes_out']} out"
    )


def _check_places(capture: Path | None, ready: Path | None, trace: Path | None) -> None:
    """Make the folder of --capture; refuse missing or read-only folders, and the ready file of a running board."""
    change = "choose another folder or change permissions"
    if capture:
        try:
            capture.mkdir(parents=True, exist_ok=True)
        except PermissionError:
            raise input_error("--capture", f"{capture} cannot be made", change) from None
        except OSError:  # told below
            pass
    folders = {"--capture": capture, "--ready": ready and ready.parent, "--trace": trace and trace.parent}
    for name, place in folders.items():
        if place and place.exists() and not place.is_dir():
            raise input_error(name, f"{place} is a file", "name a folder")
        if place and not place.exists():
            raise input_error(name, f"no folder {place}", "make it first")
        if place and not os.access(place, os.W_OK):
            raise input_error(name, f"{place} cannot be written to", change)
    if ready and ready.is_dir():
        raise input_error("--ready", f"{ready} is a folder", "name a file")
    if ready and _alive((other := _content(ready)).get("pid")):
        what = f"{ready} belongs to a board that runs ({other['url']})"
        raise input_error("--ready", what, "end it, or name a new file")


def _in_background(ready: Path) -> None:
    """Run the same command without --background in a session of its own; return when its ready file exists."""
    ready.unlink(missing_ok=True)
    output = Path(f"{ready}.log")
    if (failure := _failure(output)) is not None:
        log(f"the board before had ended: {failure} (exit code {failure.exit_code})")
    # With --json the last line of the log is the error.
    own_words = [word for word in click.get_current_context().obj if word not in ("--background", "--json")]
    words = [sys.executable, "-P", "-m", "lippmann", *own_words, "--json"]
    own = {**os.environ, LAUNCHER: str(os.getpid())}
    try:
        both = new_file(output)
    except OSError as error:
        raise not_written(output, error) from None
    with both:
        process = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=both, stderr=both, start_new_session=True, env=own
        )
    try:
        with interrupts.held() as ended:
            while process.poll() is None and not ready.exists() and not ended:
                time.sleep(CHECK_S)
        if not ready.exists():
            # Without a message its log had no room for one, or there was none.
            silent = (
                f"the board ended without a message ({process.returncode}); start it without --background to see more"
            )
            failure = _failure(output) or (no_space(str(output)) if on_full_disk(output) else DeviceError(silent))
            output.unlink()
            raise failure
        result = json.loads(ready.read_text())
        emit(result, f"{result['url']} (lippmann board stop --ready {shlex.quote(str(ready))} ends it)")
        sys.stdout.flush()
    except BrokenPipeError:  # who started it has heard enough
        raise
    except (KeyboardInterrupt, OSError):  # interrupted, or nobody can be told where the board is
        os.killpg(process.pid, signal.SIGTERM)  # its compilers too: they are in the same session
        process.wait()
        output.unlink()
        raise


def _failure(output: Path) -> LippmannError | None:
    """Return the error in the last line of a board's log, or None."""
    try:
        last = json.loads(own_text(output).splitlines()[-1])
        return ERRORS.get(last["exit_code"], DeviceError)(last["error"])
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _remove_ready(ready: Path) -> None:
    """Remove this process's ready file."""
    if _content(ready).get("pid") == os.getpid():
        ready.unlink(missing_ok=True)


def _content(ready: Path) -> dict[str, Any]:
    """Return `url` and `pid` of a ready file; nothing when it is not one."""
    try:
        if not ready.is_file():  # a pipe would keep this command waiting
            return {}
        content = json.loads(ready.read_text())
        return {"url": str(content["url"]), "pid": int(content["pid"])}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _alive(pid: int | None) -> bool:
    """Tell whether a process runs this command."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return b"board" in words and b"start" in words


@make_command("stop")
def stop_command(ready: Path = option("The --ready file of the board's start.")) -> None:
    """End a virtual board that runs in the background.

    Example: lippmann board stop --ready out/board.json
    """
    output, content = Path(f"{ready}.log"), _content(ready)
    failure = _failure(output)
    if not content and failure is None:
        raise input_error(str(ready), "names no board", "give the --ready file of `lippmann board start`")
    if not _alive(content.get("pid")):
        if content:
            ready.unlink(missing_ok=True)
        if failure is None:
            raise DeviceError(f"{ready}: its board had ended already, without a message; the file is removed")
        raise type(failure)(f"its board had ended already: {failure} (exit code {failure.exit_code})")
    url, pid = content["url"], content["pid"]
    os.kill(pid, signal.SIGINT)
    # The board first waits for its simulator, then writes its last frames.
    seconds = virtual_board.STOP_SECONDS + CAPTURE_SECONDS
    until = time.monotonic() + seconds
    while _alive(pid):  # the ready file goes a moment before the process
        if time.monotonic() > until:
            raise DeviceError(f"{url}: the board does not end within {seconds:g} s; kill process {pid}")
        time.sleep(CHECK_S)
    if (failure := _failure(output)) is not None:
        raise failure
    output.unlink(missing_ok=True)
    emit(content, f"{url}: ended")
