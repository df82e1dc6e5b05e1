"""Requests to the model board, ports that are none, and boards that the host cannot talk to."""

import errno
import functools
import grp
import json
import os
import pty
import resource
import signal
import socket
import stat
import struct
import threading
import time
import zlib
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import serial
from lippmann.board import port as port_module
from lippmann.board.board import Board, check_rays
from lippmann.board.board_search import find_board, find_boards
from lippmann.board.packets import FRONT, Kind, packed
from lippmann.board.port import MAX_WAITING, Line, open_port
from lippmann.board.retries import RoundTrip, refusal
from lippmann.board.session import TILES_REPLY
from lippmann.board.streaming import send_frame
from lippmann.cli import run
from lippmann.errors import DeviceError, InputError
from lippmann.fixed.configuration import configuration
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.fixed.registers import BOARD_REGISTERS, Write
from lippmann.rendering.integral_image import IntegralImage
from model_board import ABORT, APPLY, BUSY, CONTROL, OPTICS_BUILD, SIGN_RUNS, SOURCE, STALE, START, ModelBoard
from optics_cases import display_of
from scene_cases import generator

SEED = 4505
#: The line of the tests is no line: time-outs need not wait for its bytes.
FAST_BAUD = 12_000_000


@contextmanager
def joined(patience_s=5.0, **settings):
    with ModelBoard(**settings) as model, Board.open(model.url, FAST_BAUD, patience_s) as board:
        yield model, board


@contextmanager
def refused(kind, says):
    """The block raises an error of one line that says this and names a remedy."""
    with pytest.raises(kind, match=says) as error:
        yield
    text = str(error.value)
    assert "\n" not in text
    assert ";" in text


def test_rays_that_are_not_the_twins_are_told():
    with joined() as (model, board):
        model.registers |= {0x200: 0x4C495050, 0x204: 3 << 16, 0x208: 2 << 6 | 1 << 5 | 16}  # exact, hex, F 16
        build = board.optics_build()
        display = display_of("hex", "panel", width_px=96, height_px=72)
        check = check_rays(board, display, (3, 7), (2, 4))
    # The model board's signature is made up; the twin's is that of its 15 rays, words of 32 bits.
    config = configuration(display, build, build.model)
    u = np.array([8 * (2 * column + 1 - 96) for _ in range(2, 5) for column in range(3, 8)])
    v = np.array([8 * (72 - 2 * row - 1) for row in range(2, 5) for _ in range(3, 8)])
    rays = ray_pipeline(u, v, 0 * u, 0 * u, config, build)
    wanted = zlib.crc32(np.array(rays).T.astype("<i4").tobytes())
    assert (check.board_crc, check.twin_crc, check.equal) == (0x12345678, wanted, False)


@pytest.mark.parametrize("on_pty", [False, True])
def test_hello(on_pty):
    with joined(width=100, height=70, identity=0xFEDCBA9876543210, pty=on_pty) as (_, board):
        assert board.info == (2, 0xFEDCBA9876543210, 100, 70, 32, 3200, 50_000_000, 0, OPTICS_BUILD)
        assert board.info.grid.count == 12


def test_registers_are_read_and_written():
    with joined() as (model, board):
        board.write(0x204, [1, 0xFFFFFFFF])
        assert board.read(0x200, 4) == [0, 1, 0xFFFFFFFF, 0]
        assert model.writes == [(0x204, (1, 0xFFFFFFFF))]
        model.registers = dict.fromkeys(range(0, 0x400, 4), 0) | {0x100 + 4 * k: k for k in range(100)}
        # More than one READ holds.
        assert board.read(0x100, 100) == list(range(100))
        writes = [Write(0, 5), Write(4, 6), Write(0x10, 7), *(Write(0x14 + 4 * k, k) for k in range(64))]
        model.writes.clear()
        board.write_all(writes)
        assert model.writes == [(0x200, (5, 6)), (0x210, (7, *range(63))), (0x310, (63,))]


def test_bad_addresses_and_words_are_refused_whole():
    with joined() as (model, board):
        writes = [(0x2FC, [1, 2]), (0x202, [1]), (0x10000, [1])]
        writes += [(0x200, words) for words in ([], [0] * 65, [-1], [1 << 32])]
        for ask, *words in ((board.read, 0x100), *((board.write, *one) for one in writes)):
            with refused(InputError, "address|words?"):
                ask(*words)
        assert not any(model.registers.values())


def test_a_raster_that_is_refused_is_not_signed():
    with joined() as (_, board):
        assert board.sign(100) == (4711, 0x12345678)
        board.write(0x200, [0xBAD])
        with pytest.raises(DeviceError, match=r"refuses SIGN.*raster"):
            board.sign(100)


@pytest.fixture
def interruptible():
    """A SIGINT raises KeyboardInterrupt, also where the tests run in the background of a shell, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_signature_is_waited_for_and_ended(interruptible):
    with joined() as (model, board):
        model.frame_requests = 5
        assert board.sign(100) == (4711, 0x12345678)
        assert model.statuses[BUSY] == 6
        # One that does not end, and one that Ctrl-C ends.
        model.frame_requests, board.patience_s = 1 << 30, 0.1
        with refused(DeviceError, r"not ended after 100 rays; 3 were expected"):
            board.sign(3)
        assert (model.runs, model.executed[ABORT]) == (0, 1)
        board.patience_s = 5.0

        def interrupt(model, _):
            if model.runs:
                model.on_packet = None
                os.kill(os.getpid(), signal.SIGINT)

        model.on_packet = interrupt
        with pytest.raises(KeyboardInterrupt):
            board.sign(3)
        assert (model.runs, model.executed[ABORT]) == (0, 2)


def test_a_busy_board_says_what_runs():
    with joined() as (model, board):
        board.write(0x20C, [2])
        model.stream = True
        trace = functools.partial(board.trace, *np.zeros((4, 1), np.int64))
        busy = r"refuses \w+ while a frame that a register write started runs; .*board abort.*is the stream"
        for ask in (lambda: board.sign(1), trace, lambda: board.write(0x200, [1])):
            with refused(DeviceError, busy):
                ask()
        board.abort()
        board.write(0x200, [1])
        model.runs, model.stream = SIGN_RUNS, True
        with pytest.raises(DeviceError, match=r"refuses TRACE while a SIGN request \(100 rays so far\) runs"):
            trace()
        model.epoch = 5
        board.hello()
        assert board.info.epoch == 5
        board.reset()
        assert not any(model.registers.values())
        assert board.info.epoch == 0  # a new session has begun


def test_a_request_older_than_that_of_another_program_says_so():
    """Status 4 of a request that is executed once is about its number, and of a tile about the buffers."""
    with joined() as (model, board):
        for ask in (lambda: board.write(0x200, [1]), lambda: board.sign(1), board.abort, board.reset):
            # Another program's WRITE, numbered just after the request that is to come.
            board.write(0x200, [0])
            model.newest = (board._seq + 2) & 0xFFFF
            model.done = (model.done[0][0], model.newest), 0
            with refused(DeviceError, r"refuses \w+: another program ((?!stream).)*; connect again((?!stream).)*$"):
                ask()
            board.hello()  # connects again
            board.write(0x200, [7])
            assert model.registers[0x200] == 7
    assert "buffers were swapped" in str(refusal("port", Kind.TILE, STALE))


@pytest.mark.parametrize("source", ["none", "raster", "stream"])
def test_abort_says_whether_a_frame_ran(capsys, source):
    with ModelBoard() as model:
        model.frame_requests = 1 << 30
        runs = source != "none"
        told = "the frame was stopped" if runs else "no frame ran"
        for words, said in (
            (["--json"], f'{{"port": "{model.url}", "aborted": {str(runs).lower()}}}'),
            ([], f"{model.url}: {told}"),
        ):
            if runs:
                with Board.open(model.url, FAST_BAUD) as board:
                    board.write(SOURCE, [int(source == "stream")])
                    board.write(CONTROL, [APPLY | START])
                    assert (model.runs, model.stream, board.frame_runs()) == (1, source == "stream", True)
            assert run(["board", "abort", "--port", model.url, *words]) == 0
            assert capsys.readouterr().out == f"{said}\n"
            assert model.runs == 0
        assert model.executed[ABORT] == 2


def test_a_board_of_version_1_does_what_it_can():
    with ModelBoard() as model:
        model.version = 1
        with Board.open(model.url, FAST_BAUD) as board:
            assert board.info.version == 1
            assert board.sign(100) == (4711, 0x12345678)
            board.write(0x200, [1])
            for ask in (board.abort, board.reset):
                with refused(DeviceError, r"has protocol version 1.*no (ABORT|RESET).*update the board"):
                    ask()


def test_replies_of_others_are_ignored():
    with joined() as (model, board):
        board.write(0x200, [11, 22])
        # A reply to a question that this board object never asked lies on the line.
        board.line.send(packed(Kind.READ, 0, b"\4\2\1"), 1.0)
        board._seq = 99
        assert board.read(0x200, 2) == [11, 22]
        assert model.executed[2] == 2


def test_an_image_is_shown_and_verified():
    display = display_of("square", "panel", width_px=96, height_px=72)
    display = replace(display, panel=replace(display.panel, transfer="linear", bits=6))
    light = generator(SEED, "image").random((72, 96, 3), np.float32)
    image = IntegralImage(light, display)
    levels = np.rint(np.rint(light * 63) * 255 / 63).astype(np.uint8)
    display_register, frames, panel_crc = (BOARD_REGISTERS[name].address for name in ("display", "frames", "shown_crc"))
    with joined(identity=int(display.identity, 16)) as (model, board):

        def scan_out(model, _):
            model.registers[frames] += 1
            model.registers[panel_crc] = model.last_crc or 0

        model.on_packet = scan_out
        model.registers[display_register] = 0xFF
        sent = board.show(image)
        assert sent.crc == zlib.crc32(levels.tobytes())
        np.testing.assert_array_equal(model.shown, [levels])
        board.verify(sent.crc)
        with pytest.raises(DeviceError, match="stream the frame again"):
            board.verify(sent.crc ^ 1)
        model.registers[display_register] = 0x7F
        with pytest.raises(DeviceError, match="brightness=255"):
            board.verify(sent.crc ^ 1)
    with joined() as (model, board), pytest.raises(InputError, match="panel belongs to display"):
        board.show(image)
    assert not model.shown


def test_wrong_version():
    with ModelBoard() as model:
        model.version = 4
        with refused(DeviceError, r"version 3 or 2 or 1.*update"):
            Board.open(model.url, FAST_BAUD)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ((3, None, 1, 96, 72, 32, 3200, 1, 0, 0), "version 3"),
        ((2, 5, 1, 96, 72, 32, 3200, 1, 0, 0), "another HELLO"),
        ((2, None, 1, 0, 72, 32, 3200, 1, 0, 0), "limits"),
        ((2, None, 1, 65535, 65535, 32, 3200, 1, 0, 0), "limits"),
        ((2, None, 1, 96, 72, 64, 3200, 1, 0, 0), "limits"),
        ((2, None, 1, 96, 72, 32, 600, 1, 0, 0), "limits"),
        (None, "reply to HELLO has 0 bytes"),
    ],
)
def test_answers_that_make_no_sense(limits, message):
    with ModelBoard() as model:

        def hello(body):
            if limits is None:
                return b""
            nonce = struct.unpack("<BI", body)[1]
            return struct.pack("<BIQHHBHIHI", limits[0], nonce ^ (limits[1] or 0), *limits[2:])

        model._hello = hello
        with refused(DeviceError, message):
            Board.open(model.url, FAST_BAUD)


def test_silence_ends_in_time():
    with ModelBoard() as model:
        model.mute = True
        begun = time.monotonic()
        with refused(DeviceError, r"nothing answers.*power"):
            Board.open(model.url, FAST_BAUD, patience_s=0.5)
        assert 0.5 <= time.monotonic() - begun < 1.0


def test_a_flood_of_anything_ends_in_time():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def flood():
            with server.accept()[0] as line:
                bytes_ = generator(SEED).bytes(5000) + b"\0" + packed(0x81, 5, bytes(40)) * 50
                try:
                    while True:
                        line.sendall(bytes_)
                except OSError:
                    pass

        thread = threading.Thread(target=flood)
        thread.start()
        begun = time.monotonic()
        with closing(Line(f"socket://127.0.0.1:{server.getsockname()[1]}", FAST_BAUD)) as line:
            with pytest.raises(DeviceError, match="not answered"):
                Board(line, patience_s=0.5)
            assert time.monotonic() - begun < 2.0
            assert line.waiting <= MAX_WAITING
        thread.join()


NONE = "/dev/ttyNONE"


@pytest.mark.parametrize(
    ("url", "baud", "kind", "says"),
    [
        (NONE, 9600, DeviceError, "/dev/ttyNONE: no such port; plug"),
        (NONE, 0, InputError, "baud"),
        (NONE, -9600, InputError, "baud"),
        ("/dev/null", 9600, DeviceError, "is not a serial port; give a serial device, or socket://HOST:PORT"),
        ("/tmp", 9600, DeviceError, "/tmp: "),
        ("socket://no-such-host.invalid:5000", 9600, DeviceError, "no such host"),
        ("socket://127.0.0.1:1", 9600, DeviceError, "no program listens.*board start"),
        ("socket://", 9600, InputError, "give a serial device, or socket"),
        ("socket://127.0.0.1", 9600, InputError, "give a serial device, or socket"),
        ("socket://127.0.0.1:x", 9600, InputError, "give a serial device, or socket"),
        ("gopher://there", 9600, InputError, "give a serial device, or socket"),
        ("", 9600, InputError, "give a serial device, or socket"),
        (5, 9600, InputError, "give a serial device, or socket"),
    ],
)
def test_ports_that_are_none(url, baud, kind, says):
    with refused(kind, says):
        open_port(url, baud)


def test_a_baud_rate_that_the_port_does_not_have(monkeypatch):
    def refuse(*_, **__):
        raise ValueError("Invalid baud rate: 7")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with refused(DeviceError, f"{NONE}: the port does not support 7 baud; choose another rate"):
        open_port(NONE, 7)


def test_a_busy_port():
    master, slave = pty.openpty()
    name = os.ttyname(slave)
    with closing(Line(name)), pytest.raises(DeviceError, match=r"busy.*close the other program"):
        Line(name)
    with closing(Line(name)):
        pass
    os.close(master)
    os.close(slave)


@pytest.mark.parametrize(
    ("owner", "mode", "remedy"),
    [
        ("dialout", 0o660, r"join the group that owns the port: sudo usermod -aG dialout \$USER"),
        ("dialout", 0o666, r"join the group"),
        ("dialout", 0o640, r"give one of your groups access by a udev rule such as"),
        ("dialout", 0o600, r"give one of your groups access"),
        ("root", 0o660, r"give one of your groups access"),
        (None, 0o660, r"give one of your groups access"),
    ],
)
def test_no_permission(monkeypatch, owner, mode, remedy):
    # Root may open anything: the refusal is pyserial's, made here.
    def refuse(url, **_):
        raise serial.SerialException(errno.EACCES, f"could not open port {url}: [Errno 13] Permission denied")

    # A group of no name has no member.
    group = {"dialout": grp.getgrnam("dialout").gr_gid, "root": 0, None: 987_654}[owner]
    found = SimpleNamespace(st_gid=group, st_mode=stat.S_IFCHR | mode)
    with monkeypatch.context() as patched:
        patched.setattr(port_module.serial, "serial_for_url", refuse)
        patched.setattr(port_module.os, "stat", lambda _: found)
        with pytest.raises(DeviceError) as error:
            open_port("/dev/ttyMADE-UP")
    error.match("no permission; " + remedy)


@pytest.mark.parametrize(
    ("on_pty", "remedy"), [(False, "check that the board runs; a running board keeps"), (True, "plug")]
)
def test_a_port_that_goes_away(on_pty, remedy):
    with ModelBoard(pty=on_pty) as model:
        board = Board.open(model.url, FAST_BAUD, patience_s=5.0)
    with board, pytest.raises(DeviceError, match=f"connection is lost.*{remedy}"):
        board.read(0)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_ports_that_cannot_be_waited_on():
    """loop:// has no file number: what is sent comes back."""
    with closing(Line("loop://", FAST_BAUD)) as line:
        assert line.send(packed(2, 7, b"body"), 1.0)
        assert line.receive(1.0) == (2, 7, b"body")
        begun = time.monotonic()
        assert line.receive(0.05) is None
        assert 0.05 <= time.monotonic() - begun < 0.2


def test_a_word_of_a_memory_is_written(capsys):
    """A memory has no fields, so any bits of its words may be set."""
    with ModelBoard() as model:
        model.registers[0x300] = 0
        assert run(["board", "write", "optics.jitter_table", "0x12345", "--port", model.url]) == 0
        assert model.registers[0x300] == 0x12345
    assert capsys.readouterr().out == "0x300  0x00012345\n"


def test_search_by_answer():
    master, slave = pty.openpty()
    silent = os.ttyname(slave)
    with ModelBoard(identity=1) as one, ModelBoard(identity=2, pty=True) as two:
        found, others = find_boards([silent, one.url, NONE, two.url], FAST_BAUD, 0.2)
        assert found == [one.url, two.url]
        assert [str(error).split(":")[0] for error in others] == [silent, NONE]
        assert find_board([silent, two.url], FAST_BAUD, 0.2) == two.url
        for urls, says in (([one.url, two.url], "2 boards answer"), ([silent], "none of 1 ports answers"),
                           ([], "no serial port")):  # fmt: skip
            with pytest.raises(DeviceError, match=f"{says}.*--port"):
                find_board(urls, FAST_BAUD, 0.2)
    os.close(master)
    os.close(slave)


def test_closed_and_opened_again(monkeypatch):
    monkeypatch.setattr(RoundTrip, "back_off", lambda _: pytest.fail("waited in vain"))
    with ModelBoard(pty=True) as model:
        image = generator(SEED).integers(0, 256, (72, 96, 3), np.uint8)
        for k in range(3):
            with Board.open(model.url, FAST_BAUD, 2.0) as board:
                assert send_frame(board, image).unchanged == (k > 0)
                # Half a packet before the port is closed spoils nothing of the next session.
                board.line.send(b"\x20half", 1.0)
    assert len(model.shown) == 1


def test_the_reply_to_a_repeated_request_is_not_timed(monkeypatch):
    """Nobody knows which of the two requests it answers: Karn's rule."""
    timed, eased = [], []
    monkeypatch.setattr(RoundTrip, "sample", lambda _, seconds: timed.append(seconds))
    monkeypatch.setattr(RoundTrip, "ease", lambda _: eased.append(True))
    with ModelBoard() as model, Board.open(model.url, FAST_BAUD, 2.0) as board:
        board.read(0x18)
        before = len(timed)
        assert (before > 0, eased) == (True, [])
        send, lost = board.line.send, []

        def lose_the_first(packet, *rest):
            if lost:
                send(packet, *rest)
            lost.append(packet)

        monkeypatch.setattr(board.line, "send", lose_the_first)
        board.read(0x18)
        assert len(lost) == 2
        assert (len(timed), eased) == (before, [True])


def test_tables_of_two_frames_are_not_mixed(monkeypatch):
    """Of 560 tiles, asked for in two requests: another program shows a frame between them."""
    with ModelBoard(width=640, height=896) as model, Board.open(model.url, FAST_BAUD, 2.0) as board:
        assert len(board.tiles(FRONT).crcs) == 560
        ask, epochs = board.ask, iter((4, 5))

        def of_another_frame(*request):
            body = ask(*request)
            return TILES_REPLY.pack(next(epochs), TILES_REPLY.unpack_from(body)[1]) + body[TILES_REPLY.size :]

        monkeypatch.setattr(board, "ask", of_another_frame)
        with pytest.raises(DeviceError, match=r"buffers were swapped.*one program at a time"):
            board.tiles(FRONT)


SHOWN = ["0x018  0x000004FF  display", "brightness = 255", "pattern = 4 (checker)"]


@pytest.mark.parametrize(
    ("words", "told", "fields"),
    [
        (["display"], SHOWN, True),
        (["0x18"], SHOWN, False),
        (["lens"], ["0x01C  0x00020FFD  lens", "i = -3", "j = 2"], True),
        (["0x18", "2"], [*SHOWN, "0x01C  0x00020FFD  lens", "i = -3", "j = 2"], False),
        (["0x100"], ["0x100  0x00000007"], False),
    ],
)
def test_registers_are_read_with_their_fields(words, told, fields, capsys):
    """Also several, and by their addresses; i and j have twelve bits with a sign, from bits 0 and 16."""
    with ModelBoard() as model:
        model.registers |= {0x18: 0x4FF, 0x1C: 2 << 16 | 0x1000 - 3, 0x100: 7}
        assert run(["board", "read", *words, "--port", model.url]) == 0
        assert [line.strip() for line in capsys.readouterr().out.splitlines()] == told
        assert run(["board", "read", *words, "--port", model.url, "--json"]) == 0
        result = json.loads(capsys.readouterr().out)
    assert set(result) == {"address", "words", "fields"}
    assert [f"0x{word:08X}" for word in result["words"]] == [line.split()[1] for line in told if line.startswith("0x")]
    assert bool(result["fields"]) == fields


@pytest.mark.parametrize("kind", ["socket", "pty"])
def test_a_line_works_beyond_1023_open_files(kind):
    """A server with many connections has such file numbers; `select` refuses them."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    with ExitStack() as stack:
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        for _ in range(1024):
            stack.enter_context(open(os.devnull, "rb"))
        if kind == "socket":
            line = Line(f"socket://127.0.0.1:{server.getsockname()[1]}")
            far = stack.enter_context(server.accept()[0]).detach()
        else:
            far, near = os.openpty()
            line = Line(os.ttyname(near))
            stack.callback(os.close, near)
        stack.callback(os.close, far)
        stack.callback(line.close)
        assert line._port.fileno() > 1023
        packet = packed(Kind.READ, 7, b"body")
        assert line.send(packet, 1.0)
        assert os.read(far, 100) == b"\0" + packet
        os.write(far, packet)
        assert line.receive(1.0) == (Kind.READ, 7, b"body")
