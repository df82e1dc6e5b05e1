"""When Embree is told that rays go the same way: it depends on the processor, and pictures do not depend on it."""

import re

import numpy as np
import pytest
from lippmann.base import machine
from lippmann.base.variant import current_device
from lippmann.rendering import lights as coherence
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import scene_of
from scene_cases import focused_display, generator

CPUINFO = """processor\t: {}
model name\t: Some Processor
flags\t\t: fpu sse2 {}
vmx flags\t: vnmi
"""


@pytest.mark.parametrize(
    ("flags", "name", "hint"),
    [
        ("", "Some Processor", [False, False]),
        ("avx avx2", "Some Processor with AVX2", [False, False]),
        ("avx2 avx512f", "Some Processor with AVX2", [False, False]),
        ("avx2 avx512f avx512vl", "Some Processor with AVX-512", [True, False]),
    ],
)
def test_only_rays_of_the_display_with_avx512_are_coherent(mi, monkeypatch, flags, name, hint):
    told = "\n".join(CPUINFO.format(k, flags) for k in range(2))
    monkeypatch.setattr(machine, "_information", lambda: told)
    assert machine.features() == {"fpu", "sse2", *flags.split()}
    assert machine.processor_name() == name
    assert list(np.array(mi.Bool(coherence.coherence_hint(mi.UInt32([0, 1])))) & [True, True]) == hint


def test_packets_are_those_of_the_programs_that_drjit_writes(mi):
    if current_device() != "llvm":
        pytest.skip("a GPU has no packets")
    import drjit as dr

    dr.eval()  # what others left to do
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        dr.eval(dr.opaque(mi.Float, 2.0, 100) * 3.0)
        (written,) = (k["ir"].getvalue() for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT)
    widest = max(int(width) for width in re.findall(r"<(\d+) x float>", written))
    assert machine.has_avx512() == (widest == 16)


@pytest.mark.parametrize("shading", ["each", "shared"])
def test_the_hint_changes_no_picture(mi, monkeypatch, shading):
    random = generator(71)
    white = {"type": "twosided", "bsdf": {"type": "diffuse"}}
    wall = mi.ScalarTransform4f().translate([0, 0, -6]).scale([12, 12, 1])
    mirror = mi.ScalarTransform4f().translate([0, -3, 0]).rotate([1, 0, 0], -70).scale([12, 12, 1])
    parts = {
        "wall": {"type": "rectangle", "to_world": wall, "bsdf": white},
        "mirror": {"type": "rectangle", "to_world": mirror, "bsdf": {"type": "conductor", "material": "none"}},
    }
    for k in range(40):
        centre = list(random.uniform([-9, -2, -5], [9, 7, 5]))
        parts[f"ball{k}"] = {"type": "sphere", "center": centre, "radius": 0.8, "bsdf": white}
    for k in range(3):
        parts[f"lamp{k}"] = {"type": "point", "position": [8.0 * k - 8.0, 15.0, 20.0], "intensity": 4000.0}
    display = focused_display("square", width_px=288, height_px=216, pixel_pitch=1.0 / 12.0)
    pictures = []
    for wide in (False, True):
        monkeypatch.setattr(coherence, "has_avx512", lambda wide=wide: wide)
        scene = scene_of({"type": "scene", **parts}, Placement(near_mm=30.0, far_mm=-30.0))
        rendered = render_integral(scene, display, "exact", Settings(samples=4, shading=shading))
        assert rendered.shading == shading
        pictures.append(rendered.radiance)
    assert pictures[0].max() > 0.1
    # Rays that meet two surfaces at one place may take either; others round differently, at most.
    differ = np.abs(pictures[0] - pictures[1]) > 1e-4 * pictures[0].max()
    assert np.mean(differ.any(axis=-1)) < 1e-4
