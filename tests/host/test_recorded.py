"""Recorded programs: traced once, for any size; what cannot be recorded; and the garbage of other scenes."""

import gc
import subprocess
import sys
import weakref

import drjit as dr
import numpy as np
import pytest
from lippmann.rendering import irradiance_cache_choice
from lippmann.rendering import shading as recording
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral
from lippmann.rendering.shading import Recorded
from lippmann.scenes.scene import load_scene
from lippmann.simulation.toolchain import repository
from scene_cases import focused_display


@pytest.fixture(scope="module")
def chart(mi):
    return load_scene(repository() / "scenes/chart/chart.xml")


class Hidden:
    """Holds what a recording does not see: what functions refer to is a part of it."""

    def __init__(self, values=None):
        self.values, self.traced = values, []


def test_a_program_is_traced_once_for_any_size(mi, chart):
    hidden = Hidden()

    def squares(numbers, shift):
        hidden.traced.append(dr.width(numbers))
        return numbers * numbers + shift

    program = Recorded(squares, chart)
    for size, shift in ((64, 1), (4096, 2), (1000, 7)):
        numbers = dr.arange(mi.UInt32, size)
        dr.make_opaque(numbers)
        found = program(numbers, dr.opaque(mi.UInt32, shift))
        np.testing.assert_array_equal(np.asarray(found), np.arange(size) ** 2 + shift)
    assert hidden.traced == [64]


def test_what_cannot_be_recorded_is_traced_each_time(mi, chart):
    """An array that is none of the arguments, as a plugin may hold one."""
    hidden = Hidden(mi.UInt32([3, 1, 4, 1, 5]))
    dr.eval(hidden.values)

    def shifted(numbers):
        hidden.traced.append(dr.width(numbers))
        return numbers + hidden.values

    program = Recorded(shifted, chart)
    for start in (0, 7):
        numbers = dr.arange(mi.UInt32, start, start + 5)
        dr.make_opaque(numbers)
        np.testing.assert_array_equal(np.asarray(program(numbers)), np.arange(5) + start + [3, 1, 4, 1, 5])
    assert hidden.traced == [5, 5, 5]  # the first call tried to record it


def test_an_error_of_the_function_itself_is_raised(mi, chart):
    """Every RuntimeError counted as "cannot be recorded", and the function was called once more."""
    calls = []

    def failing(numbers):
        calls.append(1)
        raise RuntimeError("jit_malloc(): out of memory")

    numbers = dr.arange(mi.UInt32, 4)
    dr.make_opaque(numbers)
    with pytest.raises(RuntimeError, match=r"^jit_malloc\(\): out of memory$"):
        Recorded(failing, chart)(numbers)
    assert calls == [1]


@pytest.mark.parametrize("shading", ["each", "shared", "auto"])
def test_the_renderers_programs_are_recorded_once(mi, chart, monkeypatch, shading):
    """Traced each time, they would give the same pictures, later. The trial's recordings serve the render.

    Samples are as many as no texture's values, for sizes that are equal by chance are another recording.
    """
    for name, value in (("MIN_RAYS", 0), ("MIN_LAMPS", 0), ("CACHE_DB", 0), ("RAYS_A_POINT", 0.01)):
        monkeypatch.setattr(irradiance_cache_choice, name, value)
    made, usual = [], Recorded.__init__

    def told(self, *arguments):
        made.append(self)
        usual(self, *arguments)

    monkeypatch.setattr(Recorded, "__init__", told)
    display = focused_display("square", width_px=90, height_px=70, pixel_pitch=0.1)
    rendered = render_integral(chart, display, "exact", Settings(samples=8, shading=shading))
    assert rendered.shading == ("shared" if shading == "auto" else shading)
    assert len(made) >= (1 if shading == "each" else 4)
    assert all(program._recordable for program in made)
    assert max(program._frozen.n_recordings for program in made) == 1


def test_a_scene_goes_with_its_program(mi):
    """Recordings kept scenes alive until the collector came, and all programs hold the code of every such scene."""

    def program_and_scene():
        scene = load_scene(repository() / "scenes/chart/chart.xml")
        return Recorded(lambda x: scene.mitsuba and x + 1, scene), weakref.ref(scene)

    program, scene = program_and_scene()
    gc.disable()
    try:
        program(mi.UInt32(1, 2))
        assert scene() is not None
        del program
        assert scene() is None
    finally:
        gc.enable()


#: A scene that becomes garbage, in a cycle, while another one's program is recorded, whose lists wake the collector.
WITH_GARBAGE = """
import sys
from pathlib import Path
import drjit as dr
from lippmann.rendering.shading import Recorded
from lippmann.scenes.scene import load_scene
from lippmann.base.variant import mitsuba, start_mitsuba
start_mitsuba("llvm")
mi = mitsuba()
new, old = (load_scene(Path(sys.argv[1])) for _ in range(2))
class Last:
    def __init__(self, scene):
        self.scene = scene
    def become_garbage(self):
        cycle = [self.scene]
        cycle.append(cycle)
        self.scene = None
last = Last(old)
del old
def down(scene, x):
    return scene.mitsuba.ray_test(mi.Ray3f(mi.Point3f(x, 0, 900), mi.Vector3f(0, 0, -1)))
dr.eval(down(last.scene, mi.Float(0)))
def work(numbers):
    last.become_garbage()
    kept = [[k] for k in range(1000000)]
    return down(new, mi.Float(numbers))
numbers = dr.arange(mi.UInt32, 64)
dr.make_opaque(numbers)
dr.eval(Recorded(work, new)(numbers))
print("whole")
"""


def test_garbage_is_kept_while_a_program_is_recorded():
    """Dr.Jit ended the process when the collector freed another scene during the recording."""
    scene = repository() / "scenes/chart/chart.xml"
    done = subprocess.run([sys.executable, "-c", WITH_GARBAGE, scene], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "whole\n"), done.stderr


@pytest.mark.parametrize(
    ("lamp", "recorded"),
    [
        ('<emitter type="point"/>', True),
        ('<emitter type="spot"/>', True),
        ('<emitter type="constant"/>', True),
        ('<emitter type="spot"><texture type="bitmap" name="texture">{}</texture></emitter>', False),
        ('<emitter type="projector"><texture type="bitmap" name="irradiance">{}</texture></emitter>', False),
        ('<emitter type="envmap"><string name="filename" value="stripes.png"/></emitter>', False),
    ],
)
def test_a_gpu_records_no_lamp_with_a_picture(mi, tmp_path, monkeypatch, lamp, recorded):
    """Dr.Jit ends the process that replays one (projector and spot, on an H200)."""
    mi.Bitmap(np.full((8, 16, 3), 200, np.uint8)).write(str(tmp_path / "stripes.png"))
    monkeypatch.setattr(recording, "current_device", lambda: "cuda")
    lamp = lamp.format('<string name="filename" value="stripes.png"/>')
    path = tmp_path / "lit.xml"
    path.write_text(f'<scene version="3.0.0"><shape type="sphere"/>{lamp}</scene>')
    hidden = Hidden()

    def doubled(numbers):
        hidden.traced.append(1)
        return 2 * numbers

    program = Recorded(doubled, load_scene(path))
    for _ in range(3):
        numbers = mi.UInt32([1, 2])
        np.testing.assert_array_equal(np.asarray(program(numbers)), [2, 4])
    assert len(hidden.traced) == (1 if recorded else 3)
