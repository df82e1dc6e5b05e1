"""`lippmann regress`: rays of an independent tracer, right and with planted faults, words, and maps of errors."""

import csv
import dataclasses
import json

import faulty_tracer
import lippmann
import numpy as np
import pytest
from lippmann.cli import run
from lippmann.conformance.error_bounds import Bounds
from lippmann.conformance.fault_search import fitted_together
from lippmann.conformance.hard_cases import changed, hard_sets
from lippmann.conformance.judge import judge
from lippmann.conformance.ray_sets import (
    INPUTS,
    ForeignRays,
    PanelRays,
    fixed_words,
    foreign_from_words,
    random_aims,
    random_pixels,
)
from lippmann.conformance.regress_page import ErrorMaps, edges
from lippmann.conformance.word_faults import find_rounding
from lippmann.display.description import display_text, load_display
from lippmann.fixed import lenslet_faces
from lippmann.fixed import ray_pipeline as twin
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.words import wrapped
from lippmann.simulation.toolchain import repository
from optics_cases import display_of
from scene_cases import display_toml

SEED = 64


def display_for(grid, **more):
    return display_of(
        grid, "panel", pitch=1.0, radius=1.2, index=1.52, thickness=1.5, gap=0.7, rotation=9.0, offset=(0.31, -0.17),
        width_px=640, height_px=400, pixel_pitch=0.05, **more,
    )  # fmt: skip


def skewed_display_for(grid):
    """Two pitches and a shear that move the lenslets of the panel's corner by up to 0.7 mm."""
    return display_for(grid, row_pitch=0.985, shear=0.03)


def ended_display_for(grid):
    """The skewed array, smaller than the panel of 32 mm x 20 mm."""
    return display_for(grid, row_pitch=0.985, shear=0.03, extent=(24.0, 15.0))


def eye_display_for(grid):
    """An eye 60 mm away, aside of the middle, so that elemental images lie up to half a pitch beside their lenslets."""
    return display_for(grid, eye=60.0, axis=(6.0, -4.0))


def rays_for(display, count=600):
    random = np.random.default_rng(SEED)
    return random_pixels(display, random, count), random_aims(display, random, count)


def judged(display, arrays, two_faults=True):
    fields = {name: np.asarray(array, np.float64) for name, array in arrays.items()}
    fields["status"] = fields["status"][:, None]
    foreign = ForeignRays(PanelRays("foreign", display, fields.pop("pixel"), fields.pop("aperture_mm")), fields)
    return judge(foreign, two_faults=two_faults)


def traced(display, pixels, aims, **how):
    """Golden's directions, or another engine's: all that a file need have."""
    rays = lippmann.trace(display, pixels, aims, **how)
    return {"pixel": pixels, "aperture_mm": aims, "direction": rays.direction, "status": rays.status}


#: Planted fault: step that must be named, a word of what is said.
FAULTS = {
    "x sign": ("panel", "x flipped"),
    "y flipped": ("panel", "y flipped"),
    "axis swap": ("panel", "swapped"),
    "half pixel": ("panel", "half a pixel"),
    "pixel pitch wrong": ("panel", "panel.pixel_pitch_mm is 0.050025"),
    "missing offset": ("panel", "offset_mm left out"),
    "rotation sense": ("panel", "sign of rotation_deg"),
    "degrees for radians": ("panel", "taken for radians"),
    "off-by-one lenslet": ("lenslet", "off by one: (+1, +0)"),
    "neighbour's lenslet": ("lenslet", "neighbour's lenslet traced: (+1, +0)"),
    "hex rows swapped": ("lenslet", "hexagonal rows moved the other way"),
    "aperture plane": ("aim", "aperture plane without the index"),
    "wrong index": ("first face", "array.index is 1.4585 for 1.52"),
    "another glass": ("first face", "another glass, of the same focal length: array.index is 1.4585 for 1.52"),
    "gap wrong": ("first face", "gap_mm is 0.7125 for 0.7"),
    "radius for focal length": ("dome", "focal length taken as the radius"),
    "normalisation missing": ("exit", "not normalised"),
    "direction sign": ("exit", "sign of the direction's x"),
    "wrong status code": ("status", "1 for 2"),
}


#: Planted faults of the lattice, the display, the step and what must be said.
LATTICE_FAULTS = [
    (eye_display_for, "missing eye", "lenslet", "viewing_distance_mm left out"),
    (eye_display_for, "eye from the panel", "lenslet", "viewing_distance_mm counted from the panel"),
    (eye_display_for, "missing axis", "lenslet", "viewing_axis_mm left out"),
    (skewed_display_for, "missing shear", "lenslet", "shear left out"),
    (skewed_display_for, "shear's sign", "lenslet", "sign of the shear"),
    (skewed_display_for, "pitches swapped", "lenslet", "axes of pitch_mm swapped"),
    # Where lenslets are missing a ray is blocked; the directions of the others are right.
    (ended_display_for, "missing extent", "status", "extent_mm left out"),
]


def inner_rays_for(display):
    """Aims that rays reach inside the cell, of an eye aside and of a wrong shear: that tracer has one dome alone."""
    pixels, aims = rays_for(display)
    return pixels, aims if display.viewing_distance_mm is None and display.array.regular else 0.7 * aims


@pytest.mark.parametrize(("made", "fault", "stage", "says"), LATTICE_FAULTS)
@pytest.mark.parametrize("grid", [pytest.param("square", marks=pytest.mark.full), "hex"])
def test_planted_faults_of_the_lattice_are_named(grid, made, fault, stage, says):
    """From directions alone, and with all steps."""
    display = made(grid)
    arrays = faulty_tracer.trace(display, *inner_rays_for(display), fault)
    for names in (("direction", "status"), arrays):
        verdict = judged(display, {name: arrays[name] for name in ("pixel", "aperture_mm", *names)})
        assert (verdict.stage, verdict.fault) == (stage, says), verdict


def test_a_tracer_whose_thickness_follows_its_own_cell():
    """Both leave thickness_mm to its default, the sag: without the shear the cell is smaller, and so is the sag."""
    tracers, right = (changed(skewed_display_for("hex"), shear=shear, thickness_mm=0.0) for shear in (0.0, 0.03))
    assert tracers.array.thickness_mm != right.array.thickness_mm
    verdict = judged(right, traced(tracers, *inner_rays_for(right)))
    assert (verdict.stage, verdict.fault) == ("lenslet", "shear left out"), verdict


@pytest.mark.parametrize("made", [display_for, eye_display_for, skewed_display_for, ended_display_for])
@pytest.mark.parametrize("grid", ["square", "hex"])
def test_a_right_tracer_is_right(grid, made):
    """Which also says that golden and the tracer of this folder agree within the tolerance."""
    display = made(grid)
    verdict = judged(display, faulty_tracer.trace(display, *inner_rays_for(display)))
    assert verdict.right, verdict
    assert verdict.on_edge < 10
    assert len(verdict.compared) == 7


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_named(fault):
    display = HEX if fault == "hex rows swapped" else SQUARE
    if fault == "wrong status code":
        display = changed(display, radius_mm=0.72, index=1.8, gap_mm=0.5)
    # Steps that the file does not have do not help.
    arrays = faulty_tracer.trace(display, *rays_for(display), fault)
    del arrays["panel_mm"]
    verdict = judged(display, arrays)
    stage, says = FAULTS[fault]
    assert verdict.stage == stage
    assert says in verdict.fault
    assert verdict.explained >= 0.97
    assert verdict.wrong > 20


#: 700 mm wide: half a thousandth moves most rays to other places of their lenslet, and to other lenslets.
WIDE = load_display(repository() / "scenes/displays/uhd-8k.toml")
SQUARE, HEX = display_for("square"), display_for("hex")
SQUARE_UPRIGHT, HEX_UPRIGHT = (changed(display, rotation_deg=0.0) for display in (SQUARE, HEX))


@pytest.mark.parametrize(
    ("display", "part", "wrong", "found"),
    [
        (WIDE, "panel", {"pixel_pitch_mm": 0.0908 * 1.0005}, ("panel", "panel.pixel_pitch_mm is 0.0908454 for 0.0908")),
        (WIDE, "panel", {"pixel_pitch_mm": 0.0908 * 0.9983}, ("panel", "panel.pixel_pitch_mm is 0.0906456 for 0.0908")),
        (WIDE, "array", {"pitch_mm": 1.0003}, ("lenslet", "array.pitch_mm is 1.0003 for 1")),
        (WIDE, "array", {"rotation_deg": 4.03}, ("panel", "array.rotation_deg is 4.03 for 4")),
        (WIDE, "array", {"rotation_deg": 3.63}, ("panel", "array.rotation_deg is 3.63 for 4")),
        # Turned by half a turn more, or a sixth, the lattice is the same: -177 degrees was named.
        (SQUARE_UPRIGHT, "array", {"rotation_deg": 3.0}, ("panel", "array.rotation_deg is 3 for 0")),
        (HEX_UPRIGHT, "array", {"rotation_deg": -5.0}, ("panel", "array.rotation_deg is -5 for 0")),
        (SQUARE, "array", {"offset_mm": (0.31, -0.62)}, ("panel", "array.offset_mm[1] is -0.62 for -0.17")),
        (SQUARE, "array", {"offset_mm": (0.31, -0.47)}, ("panel", "array.offset_mm[1] is -0.47 for -0.17")),
        (SQUARE, "array", {"offset_mm": (0.31, 0.03)}, ("panel", "array.offset_mm[1] is 0.03 for -0.17")),
        (SQUARE, "array", {"offset_mm": (0.31, 0.18)}, ("panel", "array.offset_mm[1] is 0.18 for -0.17")),
        (SQUARE, "array", {"plano_side": "viewer"}, ("first face", "plano_side reversed")),
    ],
)
def test_wrong_numbers_are_named_with_their_values(display, part, wrong, found):
    """However slight the error, and however small the number should be."""
    other = dataclasses.replace(display, **{part: dataclasses.replace(getattr(display, part), **wrong)})
    verdict = judged(display, traced(other, *rays_for(display, 300)))
    assert (verdict.stage, verdict.fault) == found


@pytest.mark.parametrize(("first", "last"), [(0, 129), (200, 329)])
def test_stale_register(first, last):
    """The first rays of a frame, or some in its middle, are still traced with the last frame's index."""
    rays = rays_for(SQUARE)
    arrays, old = (faulty_tracer.trace(SQUARE, *rays, fault) for fault in ("", "wrong index"))
    for name, array in arrays.items():
        array[first : last + 1] = old[name][first : last + 1]
    verdict = judged(SQUARE, arrays)
    assert verdict.stage == "first face"
    assert f"stale register: rays {first} to {last}" in verdict.fault
    assert "array.index is 1.4585" in verdict.fault


def flipped(display, pixels):
    return np.column_stack([pixels[:, 0], display.panel.height_px - 1 - pixels[:, 1]])


def other_grid(display):
    return changed(display, grid={"hex": "square", "square": "hex"}[display.array.grid])


#: Likely mistakes: rays that are traced, from display, pixels and aims; step and words that must be named.
MISTAKES = {
    "rows h-1-v": (lambda d, p, a: lippmann.trace(d, flipped(d, p), a), "panel", "one off (h - 1 - v)"),
    "column off by one": (lambda d, p, a: lippmann.trace(d, p - (-1, 0), a), "panel", "pixel off by one: (+1, +0)"),
    "row off by one": (lambda d, p, a: lippmann.trace(d, p - (0, 1), a), "panel", "pixel off by one: (+0, -1)"),
    "model paraxial": (lambda d, p, a: lippmann.trace(d, p, a, "paraxial"), "first face", "the model paraxial"),
    "model thin": (lambda d, p, a: lippmann.trace(d, p, a, "thin"), "first face", "the model thin"),
    "model pinhole": (lambda d, p, a: lippmann.trace(d, p, a, "pinhole"), "first face", "the model pinhole"),
    "other grid": (lambda d, p, a: lippmann.trace(other_grid(d), p, a), "lenslet", " grid for "),
    "aperture halved": (lambda d, p, a: lippmann.trace(d, p, 0.5 * a), "aim", "aperture points halved"),
    "rotation": (lambda d, p, a: lippmann.trace(changed(d, rotation_deg=47.0), p, a), "panel", "_deg is 47 for 9"),
}


@pytest.mark.parametrize("fields", [(), ("lenslet", "origin_mm", "centre_mm", "local_mm")])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_likely_mistakes_are_named(mistake, fields):
    display = display_for("square" if fields else "hex")
    pixels, aims = rays_for(display, 300)
    make, stage, says = MISTAKES[mistake]
    made = make(display, pixels, aims)
    arrays = {name: getattr(made, name) for name in ("direction", "status", *fields)}
    verdict = judged(display, {"pixel": pixels, "aperture_mm": aims, **arrays})
    assert verdict.stage == stage, verdict
    assert says in str(verdict.fault)
    assert verdict.explained >= 0.97


@pytest.mark.parametrize(("lag", "says"), [(1, "late by 1"), (3, "late by 3"), (-1, "early by 1")])
def test_late_outputs_are_named(lag, says):
    display = display_for("hex")
    rays = traced(display, *rays_for(display, 200))
    verdict = judged(display, rays | {name: np.roll(rays[name], lag, axis=0) for name in ("direction", "status")})
    assert verdict.stage == "exit"
    assert says in verdict.fault


@pytest.mark.full
def test_one_wrong_ray_is_no_delay_and_no_stale_register():
    """Among rays that are nearly alike, and among others."""
    (chief,) = hard_sets(SQUARE, "chief-ray", SEED, 24)
    for pixels, aims in ((chief.pixels, np.zeros_like(chief.pixels)), rays_for(SQUARE)):
        rays = traced(SQUARE, pixels, aims)
        rays["direction"] = rays["direction"].copy()
        rays["direction"][5] = 0.6, 0.0, 0.8
        verdict = judged(SQUARE, rays)
        assert (verdict.wrong, verdict.first_wrong, verdict.fault) == (1, 5, None)


def test_a_lost_ray_that_is_not_seen_as_lost_is_of_the_status():
    """Its other values say nothing."""
    display = changed(SQUARE, radius_mm=0.72, index=1.9, thickness_mm=0.0)
    rays = traced(display, *rays_for(display))
    lost = rays["status"] == 2
    assert lost.sum() > 20
    flat = np.where(lost[:, None], (0.8, 0.6, 0.0), rays["direction"])
    verdict = judged(display, rays | {"status": np.where(lost, 0, rays["status"]), "direction": flat})
    assert (verdict.stage, verdict.fault) == ("status", f"wrong status code: 0 for 2 ({lost.sum()} rays)")


def test_exit_points_of_another_frame():
    pixels, aims = rays_for(SQUARE)
    rays, gap, T = lippmann.trace(SQUARE, pixels, aims), SQUARE.gap_mm, SQUARE.array.thickness_mm
    turn = np.deg2rad(SQUARE.array.rotation_deg)
    x, y = (rays.origin_mm[:, :2] - SQUARE.array.offset_mm).T
    along = np.stack([np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x], axis=1)
    along += SQUARE.array.offset_mm
    for origin, says in (
        (np.add(rays.origin_mm, (0.0, 0.0, gap + T)), "origin's z measured from the panel"),
        (np.column_stack([along, rays.origin_mm[:, 2]]), "exit point not rotated from the array's axes"),
    ):
        verdict = judged(SQUARE, traced(SQUARE, pixels, aims) | {"origin_mm": origin})
        assert (verdict.stage, verdict.fault) == ("dome", says)


def test_a_fit_of_two_numbers_names_those_that_moved():
    """Index and gap are fitted to rays of another index: the gap stays, so it is not named."""
    rays = rays_for(SQUARE, 200)
    wrong = traced(changed(SQUARE, index=1.53), *rays)
    names = [
        one.name for some in fitted_together(PanelRays("", SQUARE, *rays), wrong) if len(some) == 1 for one in some
    ]
    assert "array.index is 1.53 for 1.52" in names


@pytest.mark.parametrize(("wrong", "looked_for"), [(7, False), (8, True)])
def test_two_faults_are_looked_for_in_eight_rays(monkeypatch, wrong, looked_for):
    """Two fitted numbers could be read from fewer, and the search takes half a minute."""
    looked = []
    monkeypatch.setattr("lippmann.conformance.fault_search.pairs", lambda *given: iter(looked.append(given) or ()))
    rays = traced(SQUARE, *rays_for(SQUARE, 200))
    turned = rays["direction"].copy()
    turned[:wrong] += np.random.default_rng(SEED).normal(0.0, 1e-2, (wrong, 3))
    verdict = judged(SQUARE, rays | {"direction": turned})
    assert (verdict.right, verdict.wrong, verdict.fault) == (False, wrong, None)
    assert bool(looked) == verdict.searched == looked_for


@pytest.fixture(scope="module")
def ties():
    """Rays on the edges of square cells: their display, pixels and aims, and right and wrong arrays."""
    (rays,) = hard_sets(display_of("square", "panel", pixel_pitch=0.0625), "cell-ties", SEED, 36)
    aims = np.zeros_like(rays.pixels)
    right, wrong = (faulty_tracer.trace(rays.display, rays.pixels, aims, fault) for fault in ("", "tie rule"))
    return rays, right, wrong


def test_tie_rule(ties):
    rays, right, wrong = ties
    assert judged(rays.display, right).right
    verdict = judged(rays.display, wrong)
    assert (verdict.stage, "tie rule" in verdict.fault) == ("lenslet", True)
    aims = right["aperture_mm"]
    swapped = faulty_tracer.trace(rays.display, rays.pixels[:, ::-1], aims, "tie rule") | {"pixel": rays.pixels}
    assert "column and row swapped; and cells closed on their" in judged(rays.display, swapped).fault


@pytest.mark.parametrize(("axis", "side"), [(0, "left"), (1, "lower")])
def test_tie_rule_of_one_axis(ties, axis, side):
    """Only the ties of one axis have the other owner: a column of pixels, or a row, goes to the neighbour."""
    rays, right, wrong = ties
    other = right["lenslet"][:, axis] != wrong["lenslet"][:, axis]
    assert other.sum() > 5
    mixed = {name: array.copy() for name, array in right.items()}
    for name, array in mixed.items():
        array[other] = wrong[name][other]
    verdict = judged(rays.display, mixed)
    assert (verdict.right, verdict.stage) == (False, "lenslet")
    assert f"every point on a {side} edge" in verdict.fault


def rays_and_chief_rays(display, count):
    pixels, aims = rays_for(display, count)
    (chief,) = hard_sets(display, "chief-ray", SEED, 10)
    return np.concatenate([pixels, chief.pixels]), np.concatenate([aims, np.zeros_like(chief.pixels)])


def test_saturated_value_wrapped():
    rays = rays_and_chief_rays(SQUARE, 600)
    verdict = judged(SQUARE, faulty_tracer.trace(SQUARE, *rays, "saturated value wrapped"))
    assert verdict.stage == "exit"
    assert "wrapped" in verdict.fault


def test_not_a_number_is_wrong_even_on_an_edge(ties):
    rays, right, _ = ties
    direction = right["direction"].copy()
    direction[5] = np.nan
    assert judged(rays.display, right | {"direction": direction}, two_faults=False).wrong == 1


#: Numbers of an array that move points, not the direction alone.
NUMBERS = ("index", "radius_mm", "rotation_deg", "thickness_mm")


def small_errors(display, rays, times):
    """Yield name, directions that are off by `times` 3 microradian, and what may be said of them."""
    random, right, size = np.random.default_rng(SEED), rays["direction"], 3e-6 * times
    turned = right + random.normal(0.0, size / 1.5, right.shape)
    yield "noise", turned, None
    for axis, where in ((0, "x"), (1, "y")):
        said = f"constant added to the direction: {size:+.3g} in {where}"
        yield f"bias in {where}", right + size * np.eye(3)[axis], said
    bits = round(-np.log2(2.0 * size))
    yield "rounded", np.round(right * 2.0**bits) / 2.0**bits, f"rounded to {bits} bits of fraction"
    yield "truncated", np.floor(right * 2.0**bits) / 2.0**bits, f"truncated to {bits} bits of fraction"
    pixels, aims = rays["pixel"], rays["aperture_mm"]
    for name in NUMBERS:
        value = getattr(display.array, name)
        moved = lippmann.trace(changed(display, **{name: value + 1e-6}), pixels, aims).direction - right
        wrong = value + 1e-6 * 1.5 * size / np.median(np.linalg.norm(moved, axis=1))
        made = lippmann.trace(changed(display, **{name: wrong}), pixels, aims)
        yield name, made.direction, f"array.{name} is {wrong:.6g} for"


@pytest.mark.parametrize(
    ("grid", "given", "times", "pairs"),
    [
        ("hex", ("lenslet",), 1.3, False),
        *(
            pytest.param(grid, given, times, True, marks=pytest.mark.full)
            for grid in ("square", "hex")
            for given in ((), ("lenslet",), ("lenslet", "local_mm"))
            for times in (1.2, 1.3, 2.0, 4.0, 10.0, 20.0)
        ),
    ],
)
def test_small_errors_are_no_other_faults(grid, given, times, pairs):
    """Errors that are hardly wrong were explained by variants that differ from golden in nothing that the file has.

    With `pairs`, two faults at once do not explain noise either. To look for them takes half a minute. Without, errors
    of one kind stand for their like.
    """
    display = display_for(grid)
    rays = traced(display, *rays_for(display, 300 if pairs else 150))
    full = lippmann.trace(display, rays["pixel"], rays["aperture_mm"])
    for name, direction, says in small_errors(display, rays, times):
        # Right lenslets, and where it is the direction alone that is off right points too.
        if ("local_mm" in given and name in NUMBERS) or (not pairs and name in ("bias in y", *NUMBERS[2:])):
            continue
        arrays = {**rays, "direction": direction, **{field: getattr(full, field) for field in given}}
        verdict = judged(display, arrays, two_faults=pairs)
        assert not verdict.right
        if says is None:
            assert (verdict.stage, verdict.fault) == ("exit", None), name
        else:
            assert says in str(verdict.fault), (name, verdict)


@pytest.mark.parametrize("grid", ["square", "hex"])
def test_the_tolerance_is_the_tolerance(grid):
    """2 microradian, and what a rounding to float32 of pixels up to 640 turns them by."""
    display = display_for(grid)
    pixels, aims = rays_for(display)
    assert judged(display, traced(display, pixels, aims)).compared[0].limits == (2.0, 2.0)
    verdict = judged(display, traced(changed(display, index=1.52005), pixels, aims))
    bound = 0.05 * 2.0**-15 / display.aperture_distance_mm * 1e6
    assert 2.0 <= verdict.compared[0].limits[0] <= 2.0 + bound < verdict.compared[0].limits[1] < 2.0 + 2.0 * bound
    assert not verdict.right
    rays = traced(display, pixels, aims)
    rays["direction"] = np.round(rays["direction"] * 2.0**16) / 2.0**16  # a step of 15 microradian
    assert judged(display, rays, two_faults=False).wrong > 400


@pytest.mark.parametrize("case", ["grazing-launch", "grazing-exit"])
def test_float32_is_right_on_hard_cases(case):
    """The engine fast works in float32 from the lenslet's centre on."""
    for rays in hard_sets(display_for("hex"), case, SEED, 24):
        assert isinstance(rays, PanelRays)
        aims = np.zeros_like(rays.pixels) if rays.aperture is None else rays.aperture
        verdict = judged(rays.display, traced(rays.display, rays.pixels, aims, engine="fast"))
        assert verdict.right, (rays.name, verdict)


@pytest.fixture(scope="module")
def case():
    case, why = fixed_words(PanelRays("words", SQUARE, *rays_and_chief_rays(SQUARE, 400)), 16)
    assert case is not None, why
    return case


@pytest.fixture
def judge_words(tmp_path, capsys):
    """A function that judges words through the command line; its exit code, and what it says as JSON."""
    words = ["regress", "--display", str(tmp_path / "display.toml"), "--rays", str(tmp_path / "rays.csv")]

    def judged_words(case, out, display=SQUARE):
        (tmp_path / "display.toml").write_text(display_text(display))
        with (tmp_path / "rays.csv").open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow([*INPUTS, *FixedRays._fields])
            writer.writerows(zip(*case.words, *out, strict=True))
        code = run([*words, "--fraction-bits", "16", "--json"])
        return code, json.loads(capsys.readouterr().out)

    return judged_words


def test_right_words(case, judge_words):
    code, said = judge_words(case, case.trace())
    assert (code, said["wrong"], said["stage"]) == (0, 0, None)


@pytest.mark.parametrize(
    ("name", "fault", "said"),
    [
        # The last rounding of the direction left out: floor(x) for floor(x + 1/2).
        ("guarded", lambda x: x >> 3, "truncation instead of rounding (downward): dx, dy, dz"),
        ("saturate", wrapped, "a word wrapped where it should saturate: dz"),
    ],
)
def test_truncation_for_rounding(case, judge_words, monkeypatch, name, fault, said):
    """The step out of the glass, and no other one, does an operation wrong."""

    def leave_dome(*arguments):
        with monkeypatch.context() as patched:
            patched.setattr(lenslet_faces, name, fault)
            return lenslet_faces.leave_dome(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(twin, "leave_dome", leave_dome)
        out = case.trace()
    code, verdict = judge_words(case, out)
    assert (code, verdict["stage"]) == (4, "exit")
    assert verdict["fault"].startswith(said)


def test_wrong_register(case, judge_words, monkeypatch):
    # This design has one fault, and to look for two takes long.
    monkeypatch.setattr("lippmann.conformance.judge.find_two_faults", lambda seen: None)
    wrong = dataclasses.replace(case.registers, **{n: -getattr(case.registers, n) for n in ("x_from_v", "y_from_u")})
    code, said = judge_words(case, ray_pipeline(*case.words, wrong, case.build))
    assert code == 4
    assert said["stage"] in ("panel", "lenslet")


def by_turns(words, one, other):
    """One number and another, as many as words."""
    return np.where(np.arange(len(words)) % 2, one, other)


#: Slips of words: what is made of right ones, the step and a word of what is said.
SLIPS = {
    # Lenslets are right to the bit, and no variant may give them.
    "z off by a constant": (lambda out: out._replace(z=out.z + 256), "dome", "a constant added"),
    "sign of x": (lambda out: out._replace(x=-out.x), "dome", "sign of the words x"),
    "sign of x and dx": (lambda out: out._replace(x=-out.x, dx=-out.dx), "dome", "sign of the words x, dx"),
    "x and y swapped": (lambda out: out._replace(x=out.y, y=out.x), "dome", "words swapped: x, y"),
    "dx and dy swapped": (lambda out: out._replace(dx=out.dy, dy=out.dx), "exit", "words swapped: dx, dy"),
    "status code": (lambda out: out._replace(status=np.where(out.status == 0, 4, out.status)), "status", "4 for 0"),
    "truncated": (lambda out: out._replace(dx=out.dx - np.sign(out.dx)), "exit", "of rounding (towards zero): dx"),
    "rounded otherwise": (lambda out: out._replace(dy=out.dy + by_turns(out.dy, 2, -1)), "exit", "another rounding"),
    "golden's rounding": (lambda out: out._replace(dy=out.dy + by_turns(out.dy, 20, -12)), "exit", "golden can tell"),
    "one clock late": (lambda out: FixedRays(*(np.roll(word, 1) for word in out)), "exit", "late by 1"),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_slips_of_words_are_named(slip, case, judge_words):
    made, stage, says = SLIPS[slip]
    code, said = judge_words(case, made(case.trace()))
    assert (code, said["stage"]) == (4, stage)
    assert says in said["fault"]


def test_tie_rule_of_words(ties, judge_words):
    """Lenslets alone are wrong, one to the left, and only of points on the cells' left edges."""
    rays = ties[0]
    case, why = fixed_words(rays, 16)
    assert case is not None, why
    out = case.trace()
    tie = (rays.pixels[case.mask, 0] - 200.0) / 16.0 % 1.0 == 0.5
    assert 10 < tie.sum() < len(tie)
    code, said = judge_words(case, out._replace(i=out.i - tie), rays.display)
    assert (code, said["wrong"], said["stage"]) == (4, tie.sum(), "lenslet")
    assert said["fault"].startswith("cells closed on their other side (tie rule)")


def test_a_word_far_off_is_not_called_wrapped(case):
    """2^62 is no word of 18 bits gone round; one that is off by 2^18 is, either way."""
    out = case.trace()
    for added, wraps in ((1 << 62, False), (1 << 18, True), (-(1 << 18), True), (1 << 19, False)):
        dx = out.dx.copy()
        dx[3] += added
        said = find_rounding(out._replace(dx=dx), out, case.build)
        assert (said == "a word wrapped where it should saturate: dx") == wraps, (added, said)


def test_the_reference_lists_the_faults():
    page = (repository() / "docs/reference/diagnoses.md").read_text()
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")][1:]
    assert len(rows) >= 20
    for stage, says in (*FAULTS.values(), *(row[2:] for row in LATTICE_FAULTS)):
        assert any(row[0] == stage and says in row[1] for row in rows), says


DISPLAY = display_of("square", "panel", radius=2.0, thickness=None, width_px=96, height_px=48, pixel_pitch=0.1)


def test_maps_and_bins_by_hand():
    """48 cells a side: pixel (10.5, 20.5) of 96 x 48 is cell (5, 20); aperture (0.3, -0.3) of 1.2 pitches (36, 12)."""
    pixels = np.array([[10.5, 20.5], [10.9, 20.1], [95.9, 47.9], [1.0, 1.0], [2.0, 2.0]])
    aims = np.array([[0.3, -0.3], [0.3, -0.3], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    far = np.array([3e-6, 2e-6, 0.0, 1.0, np.inf])
    judged = np.array([True, True, True, False, True])
    maps = ErrorMaps()
    for part in (slice(0, 2), slice(2, 5)):
        given = PanelRays("hand", DISPLAY, pixels[part], aims[part])
        maps.count(given, {"direction": far[part]}, {"direction": np.full(5, 1e-6)[part]}, judged[part])
    found = maps["direction"]
    assert (found.unit, found.rays) == ("microradian", 3)
    assert (found.worst, found.worst_units) == (pytest.approx(3.0), pytest.approx(3.0))
    for counted, cells in (
        (found.panel, {(20, 5): pytest.approx(3.0), (47, 47): 0.0}),
        (found.lenslet, {(12, 36): pytest.approx(3.0), (24, 24): 0.0}),
    ):
        assert {tuple(map(int, cell)): counted[tuple(cell)] for cell in np.argwhere(counted >= 0.0)} == cells
    # 2 and 3 lie between 10^0.25 = 1.78 and 10^0.5 = 3.16.
    place = int(np.argmin(np.abs(edges() - 10**0.25))) + 1
    assert {int(k): int(found.counts[k]) for k in np.flatnonzero(found.counts)} == {0: 1, place: 2}


def test_tiny_and_huge_errors_are_counted_at_the_ends():
    given = PanelRays("hand", DISPLAY, np.full((2, 2), 3.0), None)
    maps = ErrorMaps()
    maps.count(given, {"origin_mm": np.array([1e-30, 1e30])}, {"origin_mm": np.ones(2)}, np.ones(2, bool))
    assert maps["origin_mm"].unit == "nm"
    assert np.flatnonzero(maps["origin_mm"].counts).tolist() == [1, len(edges())]


def chief(count, seed):
    pixels = np.random.default_rng(seed).uniform((0, 0), (96, 48), (count, 2))
    return PanelRays("foreign", DISPLAY, pixels, None)


def test_a_planted_error_of_numbers_is_at_its_pixel():
    """A direction within 60 degrees of the axis: a float32 of its largest component has steps of 2^-24."""
    given = chief(200, 3)
    direction = given.trace().direction.copy()
    ray = int(np.argmax(np.abs(direction[:, 2]) > 0.75))
    direction[ray, 0] += 1e-5
    maps, foreign = ErrorMaps(), ForeignRays(given, {"direction": direction})
    maps.add(foreign, Bounds())
    assert judge(foreign, two_faults=False).wrong == 1
    found = maps["direction"]
    column, row = (np.floor(given.pixels[ray] / (2.0, 1.0))).astype(int)
    assert found.panel[row, column] == found.panel.max() == pytest.approx(10.0, rel=1e-9)
    assert found.worst_units == pytest.approx(1e-5 / 2.0**-24, rel=1e-9)
    assert found.counts[0] == 199


def test_a_word_that_is_one_off_is_one_unit_off():
    bits = 16
    words = {name: np.zeros(50, np.int64) for name in (*"uvab", *FixedRays._fields)}
    words |= {"u": np.arange(50) << 18, "v": np.full(50, 24 << 18)}
    twin = foreign_from_words(words, DISPLAY, "exact", bits).words[0].trace()
    columns = {**words, **{name: getattr(twin, name).copy() for name in FixedRays._fields}}
    columns["dx"][7] += 1
    columns["y"][9] -= 2
    maps, foreign = ErrorMaps(), foreign_from_words(columns, DISPLAY, "exact", bits)
    maps.add(foreign, Bounds())
    assert judge(foreign).wrong == 2
    assert maps["direction"].worst_units == pytest.approx(1.0)
    assert maps["direction"].worst == pytest.approx(1e6 * 2.0**-17)
    assert maps["local_mm"].worst_units == pytest.approx(2.0)
    assert maps["local_mm"].worst == pytest.approx(1e6 * 2.0 * 2.0 * 2.0**-17)
    assert [int(found.counts[0]) for found in maps.values()] == [49, 49]


@pytest.mark.parametrize("added", [0.0, 1e-4])
def test_the_page_tells_the_verdict(added, tmp_path, capsys):
    given = chief(300, 5)
    rays = given.trace()
    direction = rays.direction + np.array([added, 0.0, 0.0])
    (tmp_path / "d.toml").write_text(display_toml(DISPLAY))
    np.savez(tmp_path / "mine.npz", pixel=given.pixels, direction=direction, origin_mm=rays.origin_mm)
    words = ["regress", "--display", tmp_path / "d.toml", "--rays", tmp_path / "mine.npz", "--json"]
    code = run([*map(str, words), "--report", str(tmp_path / "page")])
    assert code == (4 if added else 0)
    page = (tmp_path / "page/errors.md").read_text()
    assert "# Errors of 300 rays" in page
    if added:
        assert "In the first, mine, 300 of 300 rays are wrong. The first wrong step is exit: a constant added" in page
        assert "| exit | direction | 300 | 100 | microradian |" in page
    else:
        assert "**All rays are correct**, in 1 set." in page
    assert "| dome | origin_mm | 300 | 0 | nm | 0 |" in page
    with (tmp_path / "page/errors-sets.csv").open() as file:
        (row,) = csv.DictReader(line for line in file if line[0] != "#")
    assert (row["set"], row["rays"], row["wrong"]) == ("mine", "300", "300" if added else "0")
    assert json.loads(capsys.readouterr().out)["right"] is (added == 0.0)
    assert (tmp_path / "page/errors.html").read_text().count("<img") == 2
