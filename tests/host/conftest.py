"""Fixtures that several tests share: Mitsuba started once a worker; measurements of the maintainers' programs.

A fixture that loads a scene lives no longer than its file. Dr.Jit's programs hold the code of every material, light and
shape of all scenes that are alive, also of those that are not rendered: with the shipped scenes kept by one file, the
tests of another took eight times as long.
"""

import os

import pytest
from lippmann.base.variant import mitsuba, start_mitsuba


@pytest.fixture(scope="session")
def mi():
    """Mitsuba on the CPU, whatever else the machine has; `make test-gpu` asks for the GPU."""
    start_mitsuba(os.environ.get("LIPPMANN_TEST_DEVICE", "llvm"))
    return mitsuba()


@pytest.fixture
def refusal_of(capfd):
    """Runs a command that must be refused: nothing on stdout, one line on stderr, the exit code; returns the line."""
    from lippmann.cli import run

    def run_refused(*words, code=2):
        capfd.readouterr()
        assert run([*map(str, words)]) == code
        out, err = capfd.readouterr()
        assert out == ""
        # `auto` may have told its choice before.
        (line,) = [one for one in err.splitlines() if not one.startswith("model ")]
        assert line.startswith("lippmann: ")
        return line

    return run_refused


@pytest.fixture
def no_desktop(monkeypatch):
    """Neither a desktop nor SDL's dummy of one."""
    for variable in ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR"):
        monkeypatch.delenv(variable, raising=False)
