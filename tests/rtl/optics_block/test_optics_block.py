"""optics_block, from a display file to exit rays, as software drives it."""

import subprocess

import pytest
from lippmann.display import load_display
from lippmann.fixed.build import Build
from lippmann.sim.harness import parameters
from lippmann.sim.tools import optics_sources, repository, verilator_environment
from runner import compiled, seed, simulate

DISPLAYS = repository() / "scenes" / "displays"


def lint(top, *options):
    """What Verilator says of a top: its exit status and its messages."""
    command = ["verilator", "--lint-only", "--quiet-stats", "--top-module", top, *options]
    sources = map(str, optics_sources(repository()))
    run = subprocess.run([*command, *sources], env=verilator_environment(), capture_output=True, text=True, check=False)
    return run.returncode, run.stdout + run.stderr


@pytest.mark.parametrize(
    ("name", "model", "f", "walk"),
    [
        ("paper-square", "pinhole", 14, 0),
        pytest.param("paper-hex", "exact", 16, 1),
        pytest.param("paper-square", "exact", 23, 2, marks=pytest.mark.full),
    ],
)
def test_frames_from_a_display_file(name, model, f, walk, tmp_path):
    path = DISPLAYS / f"{name}.toml"
    build = Build.of(load_display(path), model, f, model != "pinhole", walk)
    # Another display for the same build: its array turned, and another pitch of pixels.
    text = path.read_text()
    other = tmp_path / "other.toml"
    other.write_text(text.replace("[array]", "[array]\nrotation_deg = 3.0\noffset_mm = [0.11, -0.07]"))
    assert other.read_text() != text
    folder = compiled("optics_block", parameters(build))
    environment = {
        "BLOCK_DISPLAY": str(path),
        "BLOCK_OTHER": str(other),
        "BLOCK_MODEL": model,
        "BLOCK_F": str(f),
        "BLOCK_WALK": str(walk),
    }
    simulate(folder, "optics_block", "block_frames", seed(), environment)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"F": 13}, "F must be 14 to 23"),
        ({"F": 24}, "F must be 14 to 23"),
        ({"Grid": 2}, "Grid must be GridSquare or GridHex"),
        ({"Model": 3}, "Model must be"),
        ({"Walk": 5, "Aims": 1}, "Walk must be 0, or up to 4"),
        ({"Walk": 1}, "Walk must be 0, or up to 4"),
    ],
)
def test_illegal_parameters_stop_elaboration(values, says):
    status, messages = lint("optics_block", "-Wno-lint", *(f"-G{name}={value}" for name, value in values.items()))
    assert status != 0
    assert says in messages


@pytest.mark.parametrize("top", ["raster", "optics_registers", "optics_block"])
def test_lint_is_silent(top):
    assert lint(top, "-Wall", str(repository() / "rtl" / "registers" / "lint.vlt")) == (0, "")
