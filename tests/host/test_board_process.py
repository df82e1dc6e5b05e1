"""Starting, ending and finding boards: what the host does when a process or a port does not behave."""

import json
import select
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from lippmann.board import board as board_module
from lippmann.board import port as port_module
from lippmann.cli import board_start as command
from lippmann.cli import doctor, run
from lippmann.errors import DeviceError
from lippmann.simulation import virtual_board
from lippmann.simulation.virtual_board import RunningBoard
from scene_cases import small_toml

DEAF = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready', flush=True); time.sleep(60)"
SMALL = small_toml(64, 64, "dpi = 600")


def test_a_board_that_does_not_end_is_killed_and_reported(monkeypatch):
    monkeypatch.setattr(virtual_board, "STOP_SECONDS", 0.2)
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", DEAF], stdout=pipe, stderr=pipe, text=True) as deaf:
        assert deaf.stdout.readline() == "ready\n"
        with pytest.raises(DeviceError, match=r"did not end within 0.2 s and was killed"):
            RunningBoard("socket://127.0.0.1:1", deaf).stop()
        assert deaf.poll() is not None


class Told(subprocess.Popen):
    """A process that is asked for its end just when Ctrl-C comes: an exception there would leave its lock taken."""

    asked = False

    def poll(self):
        if not self.asked:
            self.asked = True
            assert self._waitpid_lock.acquire(blocking=False)
            signal.raise_signal(signal.SIGINT)
            self._waitpid_lock.release()
        return super().poll()


def test_ctrl_c_at_any_moment_ends_the_board(monkeypatch, tmp_path, capfd):
    code = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
    code += 'print(\'{"clocks": 5, "seconds": 1, "frames": 2, "bytes_in": 3, "bytes_out": 4}\', flush=True)'
    process = Told([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert select.select([process.stdout], [], [], 20.0)[0]  # from then on it ends by itself
    monkeypatch.setattr(virtual_board, "start", lambda *_, **__: RunningBoard("socket://127.0.0.1:1", process))
    monkeypatch.setattr(virtual_board, "STOP_SECONDS", 5.0)
    display = tmp_path / "small.toml"
    display.write_text(SMALL)
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert run(["board", "start", "--display", str(display)]) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    assert "2 frames, 3 bytes in, 4 out" in capfd.readouterr().err


@pytest.mark.parametrize(("seconds", "code"), [(25.0, 0), (60.0, 1)])
def test_board_stop_waits_as_long_as_the_board_may_take(seconds, code, tmp_path, monkeypatch, capsys):
    """The board's process has 20 s for the simulator, and then writes its last frames."""
    ready = tmp_path / "board.json"
    ready.write_text('{"pid": 999999999, "url": "socket://127.0.0.1:1"}')
    now = [0.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=lambda wait: now.__setitem__(0, now[0] + wait))
    monkeypatch.setattr(command, "time", clock)
    monkeypatch.setattr(command.os, "kill", lambda pid, number: None)
    monkeypatch.setattr(command, "_is_running", lambda pid: pid == 999999999 and now[0] < seconds)
    assert run(["board", "stop", "--ready", str(ready)]) == code
    assert ("does not end" in capsys.readouterr().err) == bool(code)


@pytest.mark.parametrize(("folder", "code", "told"), [("new/screen", 1, "stop here"), ("file/screen", 2, "no folder")])
def test_the_captures_folder_is_made(tmp_path, monkeypatch, capsys, folder, code, told):
    def refuse(*_, **__):
        raise DeviceError("stop here")

    monkeypatch.setattr(virtual_board, "start", refuse)
    monkeypatch.setattr(command.signal, "signal", lambda *_: None)
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "file").write_text("")
    words = ["board", "start", "--display", str(tmp_path / "small.toml"), "--capture", str(tmp_path / folder)]
    assert run(words) == code
    assert told in capsys.readouterr().err.splitlines()[-1]
    assert (tmp_path / folder).is_dir() == (code == 1)


def test_a_board_in_the_background_gets_the_options(tmp_path, monkeypatch):
    """Not the words of this process: a program may call the command."""
    (tmp_path / "small.toml").write_text(SMALL)
    ready = tmp_path / "board.json"
    called = []

    def popen(words, **_):
        called.append(words)
        ready.write_text('{"pid": 1, "url": "socket://127.0.0.1:1"}')
        return SimpleNamespace(poll=lambda: None)

    monkeypatch.setattr(sys, "argv", ["notebook", "--something", "--else"])
    monkeypatch.setattr(subprocess, "Popen", popen)
    words = [f"--display={tmp_path / 'small.toml'}", f"--ready={ready}", "--layers", "2", "--slot=64x48", "--bilinear"]
    words += ["--samples", "2", "--trace-clocks", "5", "9", "--memory", "sdram", "--tcp-port=7", "--fraction-bits=18"]
    for asked in (["--background", *words, "--json"], [*words, "--background"]):
        assert run(["board", "start", *asked]) == 0
        given = called.pop()
        assert given[:6] == [sys.executable, "-P", "-m", "lippmann", "board", "start"]
        # As in the foreground, and with --json: an error is the last line of the log.
        assert parsed(given[6:]) == parsed([*words, "--json"])
        assert given[-1] == "--json"
        ready.unlink()


def parsed(words):
    """Return the options of `board start` by name; the display, which is read later, by its file."""
    params = command.start_command.make_context("start", list(words)).params
    return params | {"display": params["display"].args}


def test_processes_that_need_the_same_build_make_it_once(tmp_path):
    """Two start together; one compiles, here for half a second, and the other waits for the result."""
    program = f"""
import time
from pathlib import Path
from lippmann.simulation.compilation import cached_file

def make(path):
    with open({str(tmp_path / "made")!r}, "a") as log:
        log.write("x")
    time.sleep(0.5)
    path.write_text("board")

print(cached_file(Path({str(tmp_path / "board")!r}), ["inputs"], make).read_text())
"""
    both = [subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) for _ in range(2)]
    assert [process.communicate(timeout=60)[0] for process in both] == ["board\n"] * 2
    assert (tmp_path / "made").read_text() == "x"


FTDI = SimpleNamespace(device="/dev/ttyUSB0", vid=0x0403, pid=0x6010, product="Dual RS232-HS")
ARDUINO = SimpleNamespace(device="/dev/ttyACM0", vid=0x2341, pid=0x0043, product=None)
MODEM = SimpleNamespace(device="/dev/ttyS0", vid=None, pid=None, product=None)


@pytest.fixture
def asked(monkeypatch):
    """The ports that a search opens, with no virtual board of this user among them; none answers."""
    opened = []
    monkeypatch.setattr(board_module, "own_boards", list)

    def refuse(url, *_):
        opened.append(url)
        raise DeviceError(f"{url}: nothing answers; check it")

    monkeypatch.setattr(board_module.Board, "open", refuse)
    return opened


def found(monkeypatch, *ports):
    monkeypatch.setattr(port_module.list_ports, "comports", lambda: list(ports))


@pytest.mark.parametrize(("ports", "urls"), [((MODEM, ARDUINO, FTDI), ["/dev/ttyUSB0"]), ((MODEM, ARDUINO), [])])
def test_only_known_adapters_are_asked_without_a_terminal(asked, monkeypatch, capsys, ports, urls):
    found(monkeypatch, *ports)
    assert run(["board", "info"]) == 1
    assert asked == urls
    line = capsys.readouterr().err
    assert "--port" in line
    assert "/dev/ttyACM0" in line
    # One that is named is used.
    assert run(["board", "info", "--port", "/dev/ttyS0"]) == 1
    assert asked == [*urls, "/dev/ttyS0"]


@pytest.mark.parametrize(("answer", "urls"), [("y", ["/dev/ttyACM0", "/dev/ttyS0"]), ("n", [])])
def test_a_person_is_asked_before_other_ports_are(answer, urls, asked, monkeypatch):
    found(monkeypatch, MODEM, ARDUINO)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    questions = []
    monkeypatch.setattr("click.confirm", lambda text, **_: questions.append(text) or answer == "y")
    assert run(["board", "info"]) == 1
    assert asked == urls
    (question,) = questions
    assert "/dev/ttyACM0" in question


def test_doctor_opens_known_adapters_only(monkeypatch, capsys):
    """Opening a port moves its control lines, which resets some devices."""
    found(monkeypatch, ARDUINO, FTDI)
    opened = []
    monkeypatch.setattr(doctor, "port_trouble", opened.append)
    run(["doctor", "--json"])
    assert opened == ["/dev/ttyUSB0"]
    checks = {check["check"]: check["detail"] for check in json.loads(capsys.readouterr().out)["checks"]}
    assert "not opened" in checks["/dev/ttyACM0"]
