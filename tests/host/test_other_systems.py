"""What runs where Unix is not: an interpreter without the modules and functions that only Unix has."""

import subprocess
import sys
from pathlib import Path

import lippmann as lp
from model_board import ModelBoard
from scene_cases import small_toml

SCENES = Path(__file__).parents[2] / "scenes"
#: Hides what Windows has not, of Python's own modules. Other packages, with ways of their own there, are loaded before.
HIDE = """
import os, selectors, select, signal, socket, subprocess, sys, time
import cobs.cobs, cv2, drjit, mitsuba, msgspec, numpy, OpenImageIO, PIL.Image, qoi, scipy.optimize
import serial.tools.list_ports, serial.urlhandler.protocol_socket
for name in ("resource", "fcntl", "termios", "tty", "pty", "pwd", "grp", "syslog", "crypt", "readline"):
    sys.modules[name] = None
functions = {
    os: (
        "getuid geteuid getgid getegid getgroups sched_getaffinity sched_setaffinity killpg getpgid setsid fork "
        "forkpty uname sysconf mkfifo getloadavg nice chown lchown fchown fchmod statvfs fstatvfs wait3 wait4 openpty "
        "posix_fadvise posix_fallocate sendfile pread preadv pwrite getpriority ttyname"
    ),
    signal: "SIGHUP SIGKILL SIGUSR1 SIGUSR2 SIGALRM pthread_sigmask pthread_kill siginterrupt setitimer sigwait",
    select: "poll epoll",
    selectors: "PollSelector EpollSelector",
    socket: "AF_UNIX socketpair",
    time: "clock_gettime CLOCK_BOOTTIME",
}
for flag in ("O_NOFOLLOW", "O_CLOEXEC", "O_DIRECTORY", "O_NONBLOCK"):
    functions[os] += " " + flag
"""
WORK = """
for module, names in functions.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
import lippmann as lp
display = lp.load_display(sys.argv[1])
image = lp.render(sys.argv[2], display, samples=1, device="llvm")
image.save("fish.exr")
image.save("fish.png")
again = lp.IntegralImage.load("fish.exr", display)
view = lp.observe(again, eye=(0, 0, 300), samples=1, device="llvm")
view.save("view.png")
with lp.Board.open(sys.argv[3]) as board:
    sent = board.show(image)
from lippmann.cli import run
assert run(["calibrate", "patterns", sys.argv[1], "-o", "patterns"]) == 0
import lippmann.calibration.solve
print("tiles", sent.tiles)
"""


def test_render_save_observe_and_stream_need_nothing_that_only_unix_has(tmp_path):
    (tmp_path / "tiny.toml").write_text(small_toml(64, 48, gap_mm=0.0))
    display = lp.load_display(tmp_path / "tiny.toml")
    with ModelBoard(64, 48, identity=int(display.identity, 16)) as board:
        words = [sys.executable, "-c", HIDE + WORK, "tiny.toml", SCENES / "fish/fish.xml", board.url]
        done = subprocess.run(words, check=False, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith("tiles ")
