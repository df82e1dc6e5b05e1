"""ray_stream: rays in order and equal to the twin's, whatever the stalls, across resets and changes of the display."""

import json
import tempfile
from pathlib import Path

import pytest
from bench import pack
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import ray_pipeline
from lippmann.simulation.harness import optics_parameters, packed
from random_cases import configured_display, random_rays
from runner import compiled, simulate

BENCH = Path(__file__).with_name("ray_stream_bench.sv")
BUILDS = [
    Build(14, "square", "paraxial", aims=True),
    pytest.param(Build(16, "hex", "exact", aims=True, max_cell_steps=1, cross_cells=True), marks=pytest.mark.full),
    pytest.param(Build(23, "square", "exact", viewer=True), marks=pytest.mark.full),
]


@pytest.mark.parametrize("build", BUILDS, ids=lambda b: f"{b.fraction_bits}-{b.grid}-{b.model}")
def test_ray_stream(build, seed, rng):
    near, far = build.near, build.near + 2
    (display, one), (_, other) = (configured_display(rng, build, build.model) for _ in range(2))
    displays = [one, other]
    # Fewer than the streams could take: 35 tests pass through them.
    rays = random_rays(rng, display, build, 600)
    inputs = {"b": near, "a": near, "v": 18, "u": 18}
    outputs = {"status": 3, "dz": near, "dy": near, "dx": near, "z": far, "y": far, "x": far, "j": 12, "i": 12}
    plan = {
        "case": f"{build.fraction_bits}-{build.grid}-{build.model}",
        "displays": [int.from_bytes(packed(d), "little") for d in displays],
        "rays": pack(inputs, dict(zip("uvab", rays, strict=True))),
        "exits": [pack(outputs, ray_pipeline(*rays, d, build)._asdict()) for d in displays],
    }
    program = compiled("ray_stream_bench", optics_parameters(build), BENCH.read_text())
    with tempfile.NamedTemporaryFile("w", dir=program.parent, suffix=".json") as file:
        json.dump(plan, file)
        file.flush()
        simulate(program, "ray_stream_bench", "cocotb_ray_stream", seed, {"LIPPMANN_PLAN": file.name})
