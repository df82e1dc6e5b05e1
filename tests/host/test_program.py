"""`lippmann board program` with a loader that is none; and boards and ports that do not behave."""

import json
import os
import select
import shutil
import signal
import stat
import subprocess
import sys
from types import SimpleNamespace

import pytest
from lippmann.board import bitstreams as program_module
from lippmann.board import board_search
from lippmann.board import port as port_module
from lippmann.board.bitstreams import comment, read_bitfile, sealed
from lippmann.board.fpga_boards import board_of_port, fpga_board, fpga_boards, usual_baud
from lippmann.cli import board_start as command
from lippmann.cli import doctor, run
from lippmann.cli import doctor as doctor_module
from lippmann.errors import DeviceError, InputError
from lippmann.simulation import virtual_board
from lippmann.simulation.toolchain import repository
from lippmann.simulation.virtual_board import RunningBoard
from scene_cases import small_toml

VGA = str(repository() / "scenes/displays/vga-square.toml")
IDENTITY = "fff26505bc0c5ffc"
ULX3S = SimpleNamespace(
    device="/dev/ttyUSB3", vid=0x0403, pid=0x6015, product="ULX3S FPGA 85K v3.0.8", serial_number="K00219"
)
OTHER = SimpleNamespace(device="/dev/ttyUSB1", vid=0x0403, pid=0x6015, product="FT231X USB UART")


DESIGN = "0123456789abcdef"
OWN = comment("ulx3s", "vga-square", IDENTITY, DESIGN, 2)


def bits(text=OWN, idcode=0x41113043):
    """A bitstream as ecppack writes it, without its frames: texts, preamble, reset of the checksum, identity, end."""
    texts = b"".join(one.encode() + b"\0" for one in (text, "Part: LFE5U-85F-6CABGA381") if one)
    head = b"\xff\x00" + texts + b"\xff" + b"\xff\xff\xbd\xb3" + b"\xff" * 4 + b"\x3b\0\0\0"
    rest = b"\xe2\0\0\0" + idcode.to_bytes(4, "big") + b"\x22\0\0\0" + bytes(64) + b"\x5e\0\0\0" + b"\xff" * 4
    return sealed(head + rest)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with board.bit, a loader that notes its arguments, and one ULX3S on USB."""
    (tmp_path / "board.bit").write_bytes(bits())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=os.pathsep)
    loads(tmp_path, 'printf "Load SRAM: [==]\\nDone\\n"')
    on_usb(tmp_path, monkeypatch, "K00219")
    return tmp_path


def loads(place, script):
    """Put a loader there: a shell script, which notes its arguments in called.txt first."""
    (place / "bin").mkdir(exist_ok=True)
    path = place / "bin" / "openFPGALoader"
    path.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" > "{place}/called.txt"\n{script}\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def on_usb(place, monkeypatch, *serials, density=85):
    """List devices as Linux does: a hub, an adapter of another product, and ULX3S boards of these serial numbers."""
    devices = place / f"usb-{'-'.join(map(repr, serials))}-{density}"
    monkeypatch.setattr(program_module, "USB_DEVICES", devices)
    listed = [("1d6b", "0002", "xHCI Host Controller", "0"), ("0403", "6015", "FT231X USB UART", "DN0"),
              *(("0403", "6015", f"ULX3S FPGA {density}K v3.0.8", serial) for serial in serials)]  # fmt: skip
    for number, values in enumerate(listed):
        device = devices / f"1-{number}"
        device.mkdir(parents=True)
        for name, value in zip(("idVendor", "idProduct", "product", "serial"), values, strict=True):
            (device / name).write_text(value + "\n")
    (devices / "1-0:1.0").mkdir()  # an interface has none of them


def refused(capsys, code, *arguments):
    """The one line with which the command ends, after those that it loads, and what is left half-written."""
    assert run(["board", "program", *map(str, arguments)]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    *before, line = captured.err.splitlines()
    assert all(": openFPGALoader loads this file" in one for one in before)
    if not os.path.exists("called.txt"):
        assert not before
    return line


def doctor_checks(capsys):
    assert run(["doctor", "--json"]) in (0, 3)
    return {check["check"]: check for check in json.loads(capsys.readouterr().out)["checks"]}


def called(place):
    return (place / "called.txt").read_text().splitlines()


def test_the_loader_is_called(place, capsys):
    (place / "plain.bit").write_bytes(bits(""))
    assert run(["board", "program", "plain.bit", "--board", "ulx3s"]) == 0
    assert capsys.readouterr().out == "ulx3s: runs plain.bit\n"
    assert run(["board", "program", "board.bit", "--display", VGA]) == 0
    assert capsys.readouterr().out == f"ulx3s: runs vga-square (design {DESIGN})\n"
    assert called(place) == ["--board", "ulx3s", "--ftdi-serial", "K00219", "--write-sram", "board.bit"]
    assert run(["board", "program", "board.bit", "--flash", "--serial", "K00219", "--json"]) == 0
    assert called(place) == ["--board", "ulx3s", "--ftdi-serial", "K00219", "--write-flash", "board.bit"]
    assert json.loads(capsys.readouterr().out) == {
        "file": "board.bit", "board": "ulx3s", "device": "LFE5U-85F", "display": "vga-square",
        "identity": IDENTITY, "design": DESIGN,
        "flash": True,
    }  # fmt: skip


def test_no_board_and_two_boards(place, monkeypatch, capsys):
    on_usb(place, monkeypatch)
    line = refused(capsys, 1, "board.bit")
    none = "lippmann: ulx3s: no adapter 'ULX3S FPGA 85K' is on USB; "
    assert line.startswith(f"{none}if one of 'FT231X USB UART' (DN0) is the board")
    monkeypatch.setattr(program_module, "on_usb", lambda _: [])
    assert refused(capsys, 1, "board.bit") == f"{none}connect the board's USB socket US1, and switch the board on"
    monkeypatch.undo()
    monkeypatch.chdir(place)
    monkeypatch.setenv("PATH", str(place / "bin"), prepend=os.pathsep)
    on_usb(place, monkeypatch, "K00219", "K00042")
    assert "2 boards are on USB (K00219, K00042); name a board with --serial" in refused(capsys, 1, "board.bit")
    assert not (place / "called.txt").exists()
    assert run(["board", "program", "board.bit", "--serial", "K00042"]) == 0
    assert "K00042" in called(place)
    capsys.readouterr()
    assert "--serial: is empty" in refused(capsys, 2, "board.bit", "--serial", "")
    line = refused(capsys, 1, "board.bit", "--serial", "K1")
    assert "choose from 'FT231X USB UART' (DN0), 'ULX3S FPGA 85K v3.0.8' (K00219), " in line


def test_a_loader_that_cannot_be_run_or_does_not_end(place, monkeypatch, capsys):
    loads(place, "exec sleep 30")
    monkeypatch.setattr(program_module, "LOAD_SECONDS", 0.3)
    assert "did not end within 0 s" in refused(capsys, 1, "board.bit")
    loader = place / "bin" / "openFPGALoader"
    loader.write_bytes(b"\x7fELF, of another machine")
    says = f"lippmann: {loader}: cannot be run (Exec format error); {program_module.LOADER.remedy}"
    assert refused(capsys, 3, "board.bit") == says
    loader.unlink()
    line = refused(capsys, 3, "board.bit")
    assert line == "lippmann: openFPGALoader is missing; run sudo apt-get install -y openfpgaloader"


def test_boards_that_cannot_be_told_apart_and_other_densities(place, monkeypatch, capsys):
    on_usb(place, monkeypatch, "K00219", "K00219")
    assert "2 boards are on USB (K00219, K00219); unplug all but one" in refused(capsys, 1, "board.bit")
    on_usb(place, monkeypatch, "K1", density=12)
    assert "'FT231X USB UART' (DN0), 'ULX3S FPGA 12K v3.0.8' (K1) is the board" in refused(capsys, 1, "board.bit")
    # The maker's text, or another density's, is no hindrance to one who names the adapter.
    assert run(["board", "program", "board.bit", "--serial", "K1"]) == 0
    assert called(place)[2:4] == ["--ftdi-serial", "K1"]
    capsys.readouterr()
    (place / "called.txt").unlink()
    on_usb(place, monkeypatch, "")
    assert "has no serial number, and other adapters of its kind are on USB" in refused(capsys, 1, "board.bit")
    assert not (place / "called.txt").exists()


def test_a_flash_that_is_interrupted_is_said_to_be_half_written(place, monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(program_module, "run_program", interrupted)
    assert run(["board", "program", "board.bit", "--flash"]) == 130
    assert "ulx3s: write the flash again before power-off: it contains only a part" in capsys.readouterr().err


def test_where_usb_is_not_listed_the_loader_looks(place, monkeypatch, capsys):
    monkeypatch.setattr(program_module, "USB_DEVICES", place / "none")
    assert run(["board", "program", "board.bit"]) == 0
    capsys.readouterr()
    loads(place, 'echo "unable to open ftdi device: -3 (device not found)" >&2; exit 1')
    line = refused(capsys, 1, "board.bit")
    assert "openFPGALoader finds no board (unable to open ftdi device: -3 (device not found)); connect" in line


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ('echo "Error: JTAG is stuck"; echo "std::exception" >&2; exit 1', "failed (Error: JTAG is stuck); reconnect"),
        ('echo "mismatch between idcodes"; echo "Error: std::exception"; exit 1', "is for another FPGA (mismatch"),
        ('echo "CRC check: FAIL"; echo "Error: std::exception"; exit 1', "refuses the bitstream (CRC check"),
        ('echo "unable to claim usb device"; exit 1', "another program uses the board's adapter (unable to claim"),
        ("exit 7", "openFPGALoader failed (exit code 7); reconnect"),
        ('echo "JTAG init failed with: usb_open() failed: Permission denied"; exit 1', "sudo usermod -aG plugdev"),
        ('echo "unable to open ftdi device: -4 (usb_open() failed)"; exit 1', "no permission to use the board"),
        ('echo "Error: found 2 matching devices"; exit 1', "adapters of this kind are connected (Error: found 2"),
        ('echo "multiple devices found"; echo "Error: exit"; exit 1', "name a board with --serial"),
        ('echo "Error: no matching devices"; exit 1', "openFPGALoader failed (Error: no matching devices); reconnect"),
    ],
)  # fmt: skip
def test_errors_of_the_loader(place, script, said, capsys):
    loads(place, script)
    assert said in refused(capsys, 1, "board.bit")


@pytest.mark.parametrize(
    ("data", "options", "said"),
    [
        (b"PNG" * 100, (), "is not an ECP5 bitstream"),
        (bits()[:-9], (), "is a truncated bitstream"),
        (bits().replace(bytes(64), bytes(32)), (), "is damaged"),
        (bits() * 2, (), "is damaged"),
        (bits().replace(b"Lippmann", b"Lipqmann"), ("--board", "ulx3s"), "is damaged: its header text cannot be read"),
        (bits().replace(b"sha256=", b"sha255="), ("--board", "ulx3s"), "is damaged: its header text cannot be read"),
        (bits(idcode=0x41112043), (), "is for an LFE5U-45F, but ulx3s has an LFE5U-85F"),
        (bits(idcode=0x12345678), (), "is for an 0x12345678, but ulx3s has"),
        (bits(""), (), "names no board; name the board with --board"),
        (bits(), ("--board", "ulx3s_lcd"), "is for ulx3s, not ulx3s_lcd"),
        (bits(comment("arty", "x", IDENTITY, DESIGN, 1)), (), "arty: no such board"),
        (bits(), ("--board", "ulx3"), "did you mean ulx3s?"),
        (bits(comment("ulx3s", "x", "0" * 16, DESIGN, 1)), ("--display", VGA), f"its display is {'0' * 16}"),
        (bits(""), ("--board", "ulx3s", "--display", VGA), "its display is unknown"),
    ],
)
def test_a_wrong_file_is_not_loaded(place, data, options, said, capsys):
    (place / "board.bit").write_bytes(data)
    line = refused(capsys, 2, "board.bit", *options)
    assert said in line
    assert "; " in line or "?" in line
    assert not (place / "called.txt").exists()
    assert "no such file; run make bitstream" in refused(capsys, 2, "none.bit")
    assert "is not a plain file" in refused(capsys, 2, place)


def test_no_byte_of_a_file_can_be_another_or_the_last(tmp_path):
    """One bit of each is turned: in header, text and digest too, where the words are that tell whose file it is."""
    path, whole = tmp_path / "any.bit", bits()
    path.write_bytes(whole)
    assert read_bitfile(path).design == DESIGN
    for at in range(len(whole)):
        for wrong in (whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :], whole[:at]):
            path.write_bytes(wrong)
            with pytest.raises(InputError, match=r"is damaged|is not an ECP5 bitstream|truncated bitstream"):
                read_bitfile(path)


@pytest.fixture
def broken(tmp_path, monkeypatch):
    """A checkout's boards, and one that is half-written, first in the alphabet."""
    monkeypatch.setattr("lippmann.board.fpga_boards.hardware", lambda: tmp_path / "top")
    shutil.copytree(repository() / "rtl/board", tmp_path / "top/rtl/board")
    (tmp_path / "top/rtl/board/a_board").mkdir()
    (tmp_path / "top/rtl/board/a_board/board.toml").write_text('name = "a_board"\n[fpga]\nspeed = 9\n')


def test_a_half_written_board_file_hinders_no_other_board(broken, place, monkeypatch, capsys):
    monkeypatch.setattr(port_module.list_ports, "comports", lambda: [OTHER, ULX3S])
    monkeypatch.setattr(doctor_module, "port_trouble", lambda url: None)
    assert board_of_port("/dev/ttyUSB3") == fpga_board("ulx3s")
    assert board_of_port("/dev/ttyUSB1") is None
    assert usual_baud("/dev/ttyUSB3") == 3_000_000
    assert usual_baud("/dev/ttyUSB1") == 115_200
    with pytest.raises(InputError, match=r"a_board/board\.toml: fpga\.speed"):
        fpga_boards()
    assert run(["board", "program", "board.bit", "--display", VGA]) == 0
    capsys.readouterr()
    (place / "called.txt").unlink()
    (place / "board.bit").write_bytes(bits(""))
    assert "a_board/board.toml: fpga.speed" in refused(capsys, 2, "board.bit", "--board", "a_board")
    checks = doctor_checks(capsys)
    assert "fpga.speed" in checks["board files"]["detail"]
    assert not checks["board files"]["ok"]
    assert checks["/dev/ttyUSB3"]["detail"].startswith("Radiona ULX3S 85F, GPDI, 3000000 baud, ")


@pytest.mark.parametrize("url", ["socket://127.0.0.1:4000", "unix:///tmp/x", "loop://", "rfc2217://there:7000"])
def test_no_port_is_looked_for_behind_a_url(url, monkeypatch):
    def asked():
        raise AssertionError("this machine's ports are listed")

    monkeypatch.setattr(port_module.list_ports, "comports", asked)
    assert usual_baud(url) == 115_200


@pytest.mark.parametrize(("options", "rate"), [((), 3_000_000), (("--baud", "9600"), 9600)])
def test_a_search_opens_it_at_that_rate(options, rate, monkeypatch):
    monkeypatch.setattr(port_module.list_ports, "comports", lambda: [OTHER, ULX3S])
    opened = {}

    def refuse(url, baud, *_):
        opened[url] = baud
        raise DeviceError(f"{url}: nothing answers; check it")

    monkeypatch.setattr(board_search.Board, "open", refuse)
    monkeypatch.setattr(board_search, "own_boards", list)
    assert run(["board", "info", *options]) == 1
    assert opened == {"/dev/ttyUSB1": rate if options else 115_200, "/dev/ttyUSB3": rate}
    opened.clear()
    assert run(["board", "info", "--port", "/dev/ttyUSB3", *options]) == 1
    assert opened == {"/dev/ttyUSB3": rate}


def test_doctor_names_the_board_and_the_loader(place, monkeypatch, capsys):
    monkeypatch.setattr(port_module.list_ports, "comports", lambda: [OTHER, ULX3S])
    monkeypatch.setattr(doctor_module, "port_trouble", lambda url: None)
    checks = doctor_checks(capsys)
    title = "Radiona ULX3S 85F, GPDI, 3000000 baud"
    assert checks["/dev/ttyUSB3"]["detail"].startswith(f"{title}, serial number K00219: ")
    assert "ULX3S" not in checks["/dev/ttyUSB1"]["detail"]
    assert checks["openFPGALoader"]["ok"]
    monkeypatch.setattr(ULX3S, "serial_number", None)
    (place / "bin" / "openFPGALoader").unlink()
    checks = doctor_checks(capsys)
    assert checks["/dev/ttyUSB3"]["detail"].startswith(f"{title}: ")
    assert (checks["openFPGALoader"]["ok"], checks["openFPGALoader"]["needed"]) == (False, False)
    assert "apt-get install -y openfpgaloader" in checks["openFPGALoader"]["detail"]


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("socket://127.0.0.1:4177", "socket://127.0.0.1:4177 a board answers"),
        ("unix:///tmp/b", "unix:///tmp/b       a board answers"),
        ("/dev/ttyUSB3", "/dev/ttyUSB3        a board at 3000000 baud"),
    ],
)
def test_doctor_tells_a_rate_where_there_is_one(url, told, monkeypatch, capsys):
    monkeypatch.setattr(doctor_module, "port_trouble", lambda url: None)
    monkeypatch.setattr(doctor_module, "baud_of_board", lambda url: 3_000_000)
    run(["doctor", "--port", url])
    assert capsys.readouterr().out.splitlines()[-1] == f"ok      {told}"


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
    assert ("did not end" in capsys.readouterr().err) == bool(code)


@pytest.mark.parametrize(("folder", "code", "told"), [("new/screen", 1, "stop here"), ("file/screen", 2, "not exist")])
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
    monkeypatch.setattr(board_search, "own_boards", list)

    def refuse(url, *_):
        opened.append(url)
        raise DeviceError(f"{url}: nothing answers; check it")

    monkeypatch.setattr(board_search.Board, "open", refuse)
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
