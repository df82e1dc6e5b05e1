"""Who may use a virtual board's line, and for how long."""

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from board_scenes import display_of
from lippmann.base.files import private_path
from lippmann.board import board_search
from lippmann.board import port as port_module
from lippmann.board.board import Board
from lippmann.cli import run
from lippmann.errors import NoBoardError
from lippmann.fixed.registers import BOARD_REGISTERS
from lippmann.simulation import virtual_board

LENS = BOARD_REGISTERS["lens"].address
#: Reads a file, or connects to a socket, as another user; prints what the system says.
AS_ANOTHER = """
import os, socket, sys
os.setgid(65534), os.setuid(65534)
try:
    if sys.argv[1].endswith("token"):
        open(sys.argv[1], "rb").read()
    else:
        socket.socket(socket.AF_UNIX).connect(sys.argv[1])
    print("got in")
except OSError as error:
    print(error.strerror)
"""


#: Compiled for other files' tests, too.
DISPLAY = display_of("square")


@pytest.fixture(scope="module")
def unix():
    with virtual_board.running(DISPLAY, idle_s=1) as board:
        yield board


@pytest.fixture(scope="module")
def tcp():
    with virtual_board.running(DISPLAY, port="tcp") as board:
        yield board


def closed(line, seconds=3.0):
    """Tell whether the board closes a connection soon."""
    line.settimeout(seconds)
    try:
        return line.recv(1) == b""
    except ConnectionResetError:
        return True
    except TimeoutError:
        return False


def of_another_user(path):
    if os.getuid():
        pytest.skip("to be another user needs root")
    words = [sys.executable, "-c", AS_ANOTHER, path]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()


def test_a_unix_socket_is_the_users_own(unix):
    path = Path(unix.url.removeprefix("unix://"))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    with Board.open(unix.url) as board:
        assert board.read(0) == [0x4C495042]
    assert of_another_user(path) == "Permission denied"
    with pytest.raises(NoBoardError, match=r"none\.sock: no board uses this socket; start your own board"):
        Board.open(f"unix://{path.with_name('none.sock')}")


def test_a_silent_program_makes_room_for_another(unix):
    with Board.open(unix.url) as first:
        with pytest.raises(NoBoardError, match="closed the connection"):
            Board.open(unix.url)
        assert first.read(0) == [0x4C495042]
        time.sleep(1.2)
        assert first.read(0) == [0x4C495042]  # nobody else came
        time.sleep(1.2)
        with Board.open(unix.url) as second:
            assert second.read(0) == [0x4C495042]
            with pytest.raises(NoBoardError, match="lost"):
                first.read(0)


@pytest.mark.parametrize("port", ["unix", "tcp"])
def test_another_board_takes_no_room(port):
    """A silent program makes room for a program that connects; that another board starts is none."""
    with virtual_board.running(DISPLAY, port=port, idle_s=1) as one, Board.open(one.url) as board:
        time.sleep(1.5)
        with virtual_board.running(DISPLAY):
            assert board.read(0) == [0x4C495042]


def test_tcp_asks_for_the_token(tcp, monkeypatch):
    port = int(tcp.url.rsplit(":", 1)[1])
    file = private_path() / f"tcp-{port}.token"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    token = file.read_text().strip()
    assert len(token) == 32
    with Board.open(tcp.url) as board:
        before = board.read(LENS)
    monkeypatch.setattr(port_module, "private_path", lambda: Path("/nowhere"))
    for url in (tcp.url, f"{tcp.url}?token={token[:-1]}x", f"{tcp.url}?token="):
        with pytest.raises(NoBoardError, match=r"closed the connection"):
            Board.open(url)
    with Board.open(f"{tcp.url}?token={token}") as board:
        assert board.read(LENS) == before
    assert of_another_user(file) == "Permission denied"


@pytest.mark.parametrize("said", [b"", pytest.param(b"0", marks=pytest.mark.full)])
def test_a_program_without_the_token_is_let_go(tcp, said):
    """Whether it says nothing, or too little."""
    with socket.create_connection(("127.0.0.1", int(tcp.url.rsplit(":", 1)[1]))) as line:
        line.sendall(said)
        assert closed(line, 8.0)
    with Board.open(tcp.url) as board:
        assert board.read(0) == [0x4C495042]


def test_a_part_of_the_token_is_told_nothing(tcp):
    """Else another user would find it letter by letter."""
    port = int(tcp.url.rsplit(":", 1)[1])
    token = (private_path() / f"tcp-{port}.token").read_text()
    wrong = "1" if token[0] == "0" else "0"
    for said in (token[:1], token[:-1], wrong, wrong + token[1:-1]):
        with socket.create_connection(("127.0.0.1", port)) as line:
            line.sendall(said.encode())
            assert not closed(line, 0.5)
            line.sendall(b"\n")
            assert closed(line, 0.5) == (said != token[:-1])


@pytest.mark.parametrize("port", ["unix", "tcp"])
def test_the_next_start_removes_the_line_of_a_killed_board(port):
    board = virtual_board.start(DISPLAY, port=port)
    board.process.send_signal(signal.SIGKILL)
    board.process.communicate()
    number = board.url.rsplit(":", 1)[1]
    left = private_path() / f"tcp-{number}.token" if port == "tcp" else Path(board.url.removeprefix("unix://"))
    assert left.exists()
    with virtual_board.running(DISPLAY):
        assert not left.exists()


def test_the_only_board_is_found_without_its_port(monkeypatch, capsys):
    """A user's own board on a Unix socket; a socket on which nobody listens is none, and two are named."""
    with tempfile.TemporaryDirectory() as short:
        monkeypatch.setattr(tempfile, "tempdir", short)
        monkeypatch.setattr(board_search, "adapter_ports", list)
        assert port_module.own_boards() == []
        with virtual_board.running(DISPLAY) as board:
            with socket.socket(socket.AF_UNIX) as dead:
                dead.bind(str(private_path() / "board-dead.sock"))
            assert port_module.own_boards() == [board.url]
            assert run(["board", "info", "--json"]) == 0
            assert json.loads(capsys.readouterr().out)["identity"] == DISPLAY.identity
            with virtual_board.running(DISPLAY) as other:
                assert run(["board", "info"]) == 1
                line = capsys.readouterr().err
                assert "2 boards answer (" in line
                assert all(url in line for url in (board.url, other.url))
        private_path().chmod(0o755)  # a folder that others may enter is none of ours
        assert port_module.own_boards() == []
