"""optics_block, from a display file to exit rays, as software drives it."""

import pytest
from lippmann.display.description import load_display
from lippmann.fixed.build import Build
from lippmann.simulation.harness import optics_parameters
from lippmann.simulation.toolchain import repository
from runner import compiled, seed, simulate

DISPLAYS = repository() / "scenes" / "displays"


@pytest.mark.parametrize(
    ("name", "model", "f", "steps", "eye"),
    [
        pytest.param("paper-square", "pinhole", 14, 0, None, marks=pytest.mark.full),
        pytest.param("paper-hex", "exact", 16, 1, 300.0),
        pytest.param("paper-square", "exact", 23, 2, None, marks=pytest.mark.full),
    ],
)
def test_frames_from_a_display_file(name, model, f, steps, eye, tmp_path):
    path = DISPLAYS / f"{name}.toml"
    if eye is not None:
        # All that has registers of its own: an eye, two pitches, a shear, and an array that ends on the panel.
        near = tmp_path / "near.toml"
        text = path.read_text().replace("[panel]", f"viewing_distance_mm = {eye}\n\n[panel]")
        lattice = "pitch_mm = [2.32, 2.27]\nshear = 0.05\nextent_mm = [60.0, 40.0]"
        near.write_text(text.replace("pitch_mm = 2.3", lattice))
        path = near
    build = Build.of(load_display(path), model, f, model != "pinhole", steps)
    assert (build.converge, build.shear) == (eye is not None, eye is not None)
    # Another display for the same build: its array turned, and another pitch of pixels.
    text = path.read_text()
    other = tmp_path / "other.toml"
    other.write_text(text.replace("[array]", "[array]\nrotation_deg = 3.0\noffset_mm = [0.11, -0.07]"))
    assert other.read_text() != text
    program = compiled("optics_block", optics_parameters(build))
    environment = {
        "BLOCK_DISPLAY": str(path),
        "BLOCK_OTHER": str(other),
        "BLOCK_MODEL": model,
        "BLOCK_F": str(f),
        "BLOCK_WALK": str(steps),
    }
    simulate(program, "optics_block", "block_frames", seed(), environment)
