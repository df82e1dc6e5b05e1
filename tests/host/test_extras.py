"""What an installation without extras does, and what it says of those that are missing."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from lippmann.errors import EXTRA_MODULES
from PIL import Image

TOP = Path(__file__).parents[2]
DISPLAY, FISH = TOP / "scenes/displays/vga-square.toml", TOP / "scenes/fish/fish.xml"
#: Runs commands as an installed package does, without the modules of some extras, up to the first that fails.
WITHOUT = """
import sys
for name in sys.argv[1].split(","):
    sys.modules[name] = None
from lippmann import errors
errors.__file__ = "/installed/lippmann/errors.py"
from lippmann.cli import run
for words in sys.argv[2:]:
    if code := run(words.split()):
        sys.exit(code)
"""


def lippmann(folder, extras, *commands):
    modules = ",".join(module for extra in extras for module in EXTRA_MODULES[extra])
    command = [sys.executable, "-c", WITHOUT, modules, *commands]
    return subprocess.run(command, check=False, cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("render", f"render {FISH} --display {DISPLAY} -o a.exr"),
        ("render", f"trace --display {DISPLAY} --engine fast --pixels 9 -o a.npz"),
        ("board", "board info --port socket://127.0.0.1:1"),
        ("calibrate", f"calibrate solve photos --display {DISPLAY} -o b.toml"),
        ("live", f"display a.png --display {DISPLAY} --force"),
        ("cluster", f"render {FISH} --display {DISPLAY} -o a.exr --workers 2 --samples 1"),
    ],
)
def test_a_missing_extra_is_named_with_the_command_that_installs_it(tmp_path, extra, words):
    Image.fromarray(np.zeros((480, 640, 3), np.uint8)).save(tmp_path / "a.png")
    done = lippmann(tmp_path, [extra], words)
    assert done.returncode == 3, done.stderr
    last = done.stderr.splitlines()[-1]
    assert re.fullmatch(rf"lippmann: \w+ cannot be imported \(.*\); run pip install 'lippmann\[{extra}\]'", last)


@pytest.mark.parametrize("command", ["calibrate", "live"])
def test_a_command_names_the_extra_with_all_that_it_needs(tmp_path, command):
    done = lippmann(tmp_path, ["board"], f"{command} --help")
    assert (done.returncode, f"run pip install 'lippmann[{command}]'" in done.stderr) == (3, True), done.stderr


def test_a_missing_extra_is_named_in_python_too():
    program = "import sys, lippmann; sys.modules['cobs'] = None; assert hasattr(lippmann, 'Board'); lippmann.Board.open"
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert "MissingLibraryError: cobs cannot be imported" in done.stderr


def test_rays_twin_vectors_and_regress_need_no_extra(tmp_path):
    done = lippmann(
        tmp_path,
        EXTRA_MODULES,
        f"inspect {DISPLAY} --draw d.svg",
        f"trace --display {DISPLAY} --pixels 100 -o golden.npz",
        f"trace --display {DISPLAY} --engine twin --pixels 100 -o twin.npz",
        f"vectors --display {DISPLAY} --case tangent --count 4 -o vectors",
        f"regress --display {DISPLAY} --rays golden.npz --report page",
    )
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "golden.npz") as rays:
        wrong = {**rays, "direction": rays["direction"] * [-1.0, 1.0, 1.0]}
    np.savez(tmp_path / "wrong.npz", **wrong)
    done = lippmann(tmp_path, EXTRA_MODULES, f"regress --display {DISPLAY} --rays wrong.npz --junit j.xml")
    assert done.returncode == 4, done.stderr


def test_doctor_lists_what_is_missing(tmp_path):
    done = lippmann(tmp_path, EXTRA_MODULES, "doctor --port socket://127.0.0.1:1 --json")
    checks = {check["check"]: check for check in json.loads(done.stdout)["checks"]}
    assert done.returncode == 3, done.stderr
    assert {"python", "numpy", "pyserial", "memory", "verilator", "povray"} <= set(checks)
    for name, module, extra in (
        ("mitsuba on llvm", "mitsuba|drjit", "render"),
        ("socket://127.0.0.1:1", "serial|cobs|qoi", "board"),
    ):
        assert not checks[name]["ok"]
        assert checks[name]["needed"]
        what = rf"({module}) cannot be imported \(.*\); run pip install 'lippmann\[{extra}\]'"
        assert re.fullmatch(what, checks[name]["detail"])


@pytest.mark.parametrize(
    ("extras", "commands"),
    [
        (["render"], "render layers animate capture observe view pattern export fit"),
        (["board"], "board stream play"),
        (["render", "board", "calibrate"], "calibrate"),
        (["render", "board", "live"], "display live"),
    ],
)
def test_the_commands_of_an_extra_start_with_it_alone(tmp_path, extras, commands):
    """Those that pyproject.toml has an extra bring, too."""
    others = [extra for extra in EXTRA_MODULES if extra not in extras]
    done = lippmann(tmp_path, others, *(f"{command} --help" for command in commands.split()))
    assert done.returncode == 0, done.stderr
