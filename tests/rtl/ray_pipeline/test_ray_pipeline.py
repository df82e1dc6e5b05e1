"""ray_pipeline against its twin: every model, grid and orientation, over random displays."""

import pytest
from bench import Instance, Segment, stream
from lippmann.fixed.build import Build
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.optics.rays import Status
from lippmann.simulation.harness import optics_parameters, packed
from optics import random_configuration, ray_words

#: At every commit. Of the pinhole's, paraxial and converged exact chief rays test_batch.py has a build each, in which a
#: wrong latency would give another ray's words.
FAST = [
    Build(23, "square", "exact", aims=True, max_cell_steps=1),
    Build(16, "hex", "exact", viewer=True, aims=True, max_cell_steps=2, cross_cells=True),
    Build(23, "hex", "exact", aims=True, max_cell_steps=1, converge=True, shear=True),
    Build(16, "square", "exact", viewer=True, aims=True, max_cell_steps=1, shear=True),
]
#: The latencies of the other kinds; test_batch.py compares 76 kinds of build over ten million rays.
FULL = [
    Build(18, "hex", "paraxial", aims=True),
    Build(14, "square", "pinhole"),
    Build(22, "hex", "exact", max_cell_steps=1, converge=True),
    Build(14, "hex", "exact", viewer=True, aims=True, max_cell_steps=2),
    Build(21, "square", "exact", aims=True, max_cell_steps=4),
    Build(14, "hex", "pinhole", converge=True),
    Build(23, "square", "paraxial", aims=True, converge=True),
    Build(22, "hex", "paraxial", aims=True, shear=True),
]


def instance(build: Build) -> Instance:
    near, far = build.near, build.near + 2
    p = optics_parameters(build)
    return Instance(
        "ray_pipeline",
        {"u_i": 18, "v_i": 18, "a_i": near, "b_i": near},
        {"i_o": 12, "j_o": 12, **dict.fromkeys(("x_o", "y_o", "z_o"), far),
         **dict.fromkeys(("dx_o", "dy_o", "dz_o"), near), "status_o": 3},
        f"lipp_optics_pkg::ray_latency({p['Build']})",
        p,
        {"config_i": 1140},
    )  # fmt: skip


def statuses(build: Build) -> set[Status]:
    """What becomes of a build's rays, over enough displays.

    Chief rays without an eye pass the middle of the aperture: none misses its dome or leaves through a neighbour's, and
    hardly one is totally reflected. With an eye those that would miss their dome walk on where a build can.
    """
    found = {Status.OK, Status.BLOCKED}
    if build.aims:
        found |= {Status.MISSED, Status.CROSSTALK}
    if build.model == "exact" and (build.aims or build.converge):
        found |= {Status.INTERNAL_REFLECTION, Status.CROSSTALK if build.max_cell_steps else Status.MISSED}
    return found


@pytest.mark.parametrize(
    "build", [*FAST, *(pytest.param(b, marks=pytest.mark.full) for b in FULL)],
    ids=lambda b: optics_parameters(b)["Build"],
)  # fmt: skip
def test_equals_twin(build, seed, rng, seen):
    one = instance(build)
    batch, missing = [], statuses(build)
    for number in range(2000):
        if number >= 12 and not missing:
            break
        config = random_configuration(rng, build)
        u, v, a, b = ray_words(rng, 250, build, config)
        rays: FixedRays = ray_pipeline(u, v, a, b, config, build)
        found = {status for status in missing if (rays.status == int(status)).any()}
        if number >= 12 and not found:  # some fates are rare: a dozen displays, and then those that show one more
            continue
        missing -= found
        words = {"u_i": u, "v_i": v, "a_i": a, "b_i": b}
        expected = {f"{k}_o": w for k, w in rays._asdict().items()}
        register = int.from_bytes(packed(config), "little")
        batch.append((one, Segment({"config_i": register}, words, expected)))
        for status in sorted(statuses(build)):
            seen.point(f"status {status.name.lower()}", rays.status == int(status))
        seen.point("towards +x", rays.dx > 0)
        seen.point("towards -y", rays.dy < 0)
        if number >= 11 and not missing:
            break
    stream([one], batch, one.name, seed)
