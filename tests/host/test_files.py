"""Files that appear whole or not at all: after kill -9, a power cut and on a full disk."""

import errno
import os
import re
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk
from lippmann.base import files
from lippmann.base.animation import write_animation
from lippmann.base.images import write_picture
from lippmann.base.programs import run_program
from lippmann.cli import run
from lippmann.errors import InputError, NoSpaceError
from lippmann.motion.video import write_video
from scene_cases import small_toml

TINY = small_toml(64, 64, "dpi = 254")


class Disk:
    """A folder's disk that a power cut leaves with what was synced, and any later names.

    `names` are those of the folder when it was last synced, `content` that of each file when it was last synced; a file
    that never was is empty, which is what file systems leave.
    """

    def __init__(self, folder, monkeypatch):
        self.folder, self.calls, self.states = folder, [], []
        self.names = self._now()
        self.content = {path.stat().st_ino: path.read_bytes() for path in folder.iterdir()}
        fsync, replace = os.fsync, os.replace

        def synced(handle):
            fsync(handle)
            where = Path(f"/proc/self/fd/{handle}").resolve()
            self.calls.append("fsync folder" if where == folder else "fsync file")
            if where == folder:
                self.names = self._now()
            else:
                self.content[os.fstat(handle).st_ino] = where.read_bytes()
            self.look()

        def replaced(source, target):
            self.look()
            replace(source, target)
            self.calls.append("rename")
            self.look()

        monkeypatch.setattr(os, "fsync", synced)
        monkeypatch.setattr(os, "replace", replaced)

    def _now(self):
        return {path.name: path.stat().st_ino for path in self.folder.iterdir()}

    def look(self):
        """Note what a power cut at this moment may leave: the synced names, or the present ones."""
        self.states += [
            {name: self.content.get(inode, b"") for name, inode in names.items()} for names in (self.names, self._now())
        ]


@pytest.mark.parametrize("of_old", [True, False])
def test_a_power_cut_leaves_the_old_file_or_the_new_one(tmp_path, monkeypatch, of_old):
    path = tmp_path / "a.bin"
    if of_old:
        path.write_bytes(b"old")
    disk = Disk(tmp_path, monkeypatch)
    with files.replacing(path) as partial:
        partial.write_bytes(b"new")
        disk.look()
    allowed = {b"new", b"old" if of_old else None}
    assert {state.get("a.bin") for state in disk.states} == allowed
    assert disk.calls == ["fsync file", "rename", "fsync folder"]
    assert {name: disk.content[inode] for name, inode in disk.names.items()}["a.bin"] == b"new"


#: Writes half a file, and half a folder, says so and waits.
HALF = """
import sys, time
from pathlib import Path
from lippmann.base.files import partial_folder, replacing
with replacing(Path(sys.argv[1], "a.bin")) as partial, partial_folder(Path(sys.argv[1], "set")) as folder:
    partial.write_bytes(b"half")
    (folder / "below").mkdir()
    (folder / "below" / "b").write_bytes(b"half")
    print("half", flush=True)
    time.sleep(60)
"""


def test_the_next_start_removes_what_a_killed_process_left_and_nothing_else(tmp_path, monkeypatch):
    kept = {".bashrc", ".a.partial.bin", ".a.123.partial.bin", "a.partial.bin"}
    for name in kept:
        (tmp_path / name).write_text("mine")
    with subprocess.Popen([sys.executable, "-c", HALF, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "half\n"
        half = {path.name for path in tmp_path.iterdir()} - kept
        assert len(half) == 2
        files.remove_stale(tmp_path)  # its owner lives
        assert {path.name for path in tmp_path.iterdir()} == kept | half
        process.kill()
    (tmp_path / "tiny.toml").write_text(TINY)
    out = tmp_path / "rays.npz"
    assert run(["trace", "--display", str(tmp_path / "tiny.toml"), "--pixels", "9", "-o", str(out)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == kept | {"tiny.toml", "rays.npz"}


def test_a_later_process_of_the_same_number_is_not_the_owner(tmp_path):
    mine = tmp_path / files.partial_name("a.bin")
    machine, pid, life = files.PARTIAL.fullmatch(mine.name).groups()[:3]
    assert int(pid) == os.getpid()
    other = tmp_path / mine.name.replace(life, "0" * 8)
    elsewhere = tmp_path / mine.name.replace(machine, "0" * 8)
    for path in (mine, other, elsewhere):
        path.write_text("")
    files.remove_stale(tmp_path)
    assert {*tmp_path.iterdir()} == {mine, elsewhere}
    long_ago = time.time() - files.FOREIGN_S - 10
    os.utime(elsewhere, (long_ago, long_ago))
    files.remove_stale(tmp_path)
    assert {*tmp_path.iterdir()} == {mine}


@pytest.mark.parametrize("name", ["x" * 220 + ".exr", "ü" * 110 + ".exr", "a:b.mkv", "a\n.png", "noending"])
def test_partial_names_fit_and_are_known_again(name, tmp_path):
    partial = files.partial_name(name)
    (tmp_path / partial).write_text("")  # the file system takes it
    assert files.PARTIAL.fullmatch(partial)
    assert Path(partial).suffix == Path(name).suffix or not Path(name).suffix


def test_two_threads_that_write_one_file_do_not_tear_each_other(tmp_path):
    path, both_write = tmp_path / "a.bin", threading.Barrier(2, timeout=10.0)

    def write(content):
        with files.replacing(path) as partial, partial.open("wb") as stream:
            stream.write(content[: len(content) // 2])
            stream.flush()
            both_write.wait()
            stream.write(content[len(content) // 2 :])

    contents = [b"a" * 1000, b"b" * 1000]
    with ThreadPoolExecutor(2) as threads:
        list(threads.map(write, contents))
    assert path.read_bytes() in contents
    assert [file.name for file in tmp_path.iterdir()] == ["a.bin"]


def test_another_users_private_folder_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(files.tempfile, "gettempdir", lambda: str(tmp_path))
    place = files.private_folder()
    assert place.stat().st_mode & 0o777 == 0o700
    assert files.private_folder() == place
    place.chmod(0o755)
    with pytest.raises(InputError, match="not your private folder"):
        files.private_folder()
    place.rmdir()
    place.symlink_to(tmp_path)
    with pytest.raises(InputError, match="not your private folder"):
        files.private_folder()


def test_planted_links_are_not_followed(tmp_path, monkeypatch):
    """In a folder that others may write, a temporary file's name can be guessed."""
    monkeypatch.setattr(files, "partial_name", lambda name: f".{name}.guessed.partial")
    mine = tmp_path / "mine"
    mine.write_text("precious")
    target = tmp_path / "a.bin"
    (tmp_path / files.partial_name("a.bin")).symlink_to(mine)
    with files.replacing(target) as partial:
        assert not partial.is_symlink()
        partial.write_bytes(b"new")
    assert (target.read_bytes(), target.is_symlink(), mine.read_text()) == (b"new", False, "precious")
    (tmp_path / "log").symlink_to(mine)
    with files.new_file(tmp_path / "log") as log:
        log.write(b"words")
    assert ((tmp_path / "log").read_text(), mine.read_text()) == ("words", "precious")


def test_a_file_that_was_not_written_does_not_replace_another(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"old")
    with pytest.raises(InputError, match="nothing was written"), files.replacing(tmp_path / "a.bin"):
        pass
    assert (tmp_path / "a.bin").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_only_files_of_ones_own_are_heard(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("words")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    os.mkfifo(tmp_path / "pipe")
    assert files.own_text(tmp_path / "a") == "words"
    refusals = {"link": "Too many levels of symbolic links", "pipe": "regular file", "none": "No such file"}
    for name, words in refusals.items():
        with pytest.raises(OSError, match=words):
            files.own_text(tmp_path / name)
    monkeypatch.setattr(os, "getuid", lambda: os.stat(tmp_path).st_uid + 1)
    with pytest.raises(PermissionError, match="this user's regular file"):
        files.own_text(tmp_path / "a")


@pytest.fixture
def full(tmp_path):
    with full_disk(tmp_path / "full") as place:
        yield place


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".png", ".mkv", ".mp4", ".gif", ".npz", "vectors"])
def test_a_full_disk_is_exit_code_3_and_leaves_nothing(full, tmp_path, suffix, capsys):
    (tmp_path / "tiny.toml").write_text(TINY)
    noise = np.random.default_rng(1).random((128, 256, 3), np.float32)
    frames = [np.roll((255 * noise).astype(np.uint8), 31 * k, axis=1) for k in range(30)]
    out, said = full / f"out{suffix}", r"cannot be written \(No space left on device\); free space"
    write = {
        ".gif": lambda: write_animation(out, [noise, noise[::-1]]),
        **dict.fromkeys((".mkv", ".mp4"), lambda: write_video(out, frames, 256, 128, 10.0)),
        **dict.fromkeys((".exr", ".tif", ".png"), lambda: write_picture(out, noise, {})),
    }
    if suffix in write:
        with pytest.raises(NoSpaceError, match=said):
            write[suffix]()
    else:
        words = ["vectors"] if suffix == "vectors" else ["trace", "--pixels", "2000"]
        assert run([*words, "-o", str(out), "--display", str(tmp_path / "tiny.toml")]) == 3
        assert re.search(said, capsys.readouterr().err.splitlines()[-1])
    assert list(full.iterdir()) == []


COMMANDS = {
    "export povray": ["export", "povray", "scenes/chart/chart.xml"],
    "export views": ["export", "views", "scenes/chart/chart.xml", "--fit", "--across", "2"],
    "layers": ["layers", "scenes/chart/chart.xml", "--fit", "--samples", "1"],
    "calibrate patterns": ["calibrate", "patterns"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_leaves_no_folder(full, tmp_path, capsys, command):
    (tmp_path / "tiny.toml").write_text(TINY)
    (full / "rest").write_bytes(bytes(64 << 10))
    display = [] if command == "calibrate patterns" else ["--display"]
    out = "out" if command == "export povray" else "deep/out"
    words = [*display, str(tmp_path / "tiny.toml"), "-o", str(full / out)]
    assert run([*COMMANDS[command], *words]) == 3, capsys.readouterr().err
    assert "free space" in capsys.readouterr().err
    assert [path.name for path in full.rglob("*")] == ["rest"]


def test_a_folder_that_a_command_found_stays(tmp_path):
    """Only what it made itself, and left empty, is removed after a failure."""
    (tmp_path / "there").mkdir()
    (tmp_path / "full").mkdir()
    for folder in ("there/a/b", "full/c"):
        files.make_folder(tmp_path / folder)
    (tmp_path / "full/c/file").write_text("kept")
    files.remove_empty()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["c", "file", "full", "there"]


def test_sockets_of_folders_with_spaces_are_alive(tmp_path):
    path = tmp_path / "a b  c" / "board.sock"
    path.parent.mkdir()
    with socket.socket(socket.AF_UNIX) as there:
        there.bind(str(path))
        there.listen()
        assert str(path) in files.listening()
    assert str(path) not in files.listening()


#: Writes a file, and tells that its work is done; a signal comes while Python ends.
LATE = """
import atexit, os, signal, sys
from lippmann.__main__ import main
atexit.register(lambda: os.kill(os.getpid(), int(sys.argv[1])))
main(["pattern", "ramp", "--display", sys.argv[2], "-o", sys.argv[3]])
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_after_the_work_changes_nothing(tmp_path, number):
    (tmp_path / "tiny.toml").write_text(TINY)
    words = [str(int(number)), str(tmp_path / "tiny.toml"), str(tmp_path / "p.png")]
    done = subprocess.run([sys.executable, "-c", LATE, *words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("Traceback")) == (0, 0), done.stderr
    assert (tmp_path / "p.png").exists()


def test_folders_that_do_not_fit(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(NoSpaceError, match=r"new: cannot be written \(Disk quota exceeded\); free space"):
        files.make_folder(tmp_path / "new")


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0] != b"Z"
    except OSError:
        return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_programs_programs_too(tmp_path, number):
    """Sent to the command alone, as `kill` does; the second program ignores the signal."""
    (tmp_path / "stubborn.py").write_text(
        "import os, signal, subprocess, sys, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "open(sys.argv[1], 'w').write(f'{os.getpid()} {child.pid} ')\ntime.sleep(60)\n"
    )
    code = """
        import signal, sys
        from lippmann.base import interrupts, programs
        signal.signal(int(sys.argv.pop(1)), signal.SIG_DFL)  # nohup, where the tests may run, has SIGHUP ignored
        programs.GRACE_S = 0.5
        interrupts.install()
        try:
            programs.run_program([sys.executable, *sys.argv[1:]])
        except KeyboardInterrupt:
            sys.exit(interrupts.exit_code())
    """
    told = tmp_path / "pids"
    words = [sys.executable, "-c", textwrap.dedent(code), str(int(number)), tmp_path / "stubborn.py", told]
    with subprocess.Popen(words, stderr=subprocess.PIPE) as process:
        until = time.monotonic() + 30
        while not (told.exists() and told.read_text().endswith(" ")) and time.monotonic() < until:
            time.sleep(0.02)
        process.send_signal(number)
        assert process.wait(20) == 128 + number
    pids = [int(word) for word in told.read_text().split()]
    until = time.monotonic() + 10
    while any(map(alive, pids)) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(map(alive, pids))


def test_what_a_program_prints_is_text_whatever_it_is():
    done = run_program([sys.executable, "-c", r"import os; os.write(1, b'a\xff'); os.write(2, b'\xfe\n'); os._exit(3)"])
    assert (done.returncode, done.stdout, done.stderr) == (3, "a\ufffd", "\ufffd\n")
    with pytest.raises(subprocess.TimeoutExpired):
        run_program([sys.executable, "-c", "import time; time.sleep(60)"], timeout_s=0.3)
