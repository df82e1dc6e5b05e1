"""Faulty variants of golden, each with the step of the ray that its fault is in.

A variant predicts the rays of a design with this fault. When foreign rays equal a variant's and not golden's, the
variant is the diagnosis. Discrete slips (a sign, an axis, degrees for radians) have a variant each; a wrong number of
the display is found by a fit (`fitted`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from itertools import combinations
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from lippmann.conformance.hard_cases import Out
from lippmann.conformance.ray_search import Floats
from lippmann.display.description import Display, Grid
from lippmann.errors import LippmannError
from lippmann.optics import models
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.rays import MODELS
from lippmann.optics.system import System

#: The steps of a ray, in its order.
STAGES = ("panel", "lenslet", "aim", "first face", "dome", "exit", "status", "words")

#: Arrays of a foreign file that may be compared: the step that computes each, and its columns.
FIELDS = {
    "panel_mm": ("panel", 2), "home": ("lenslet", 2), "start_mm": ("lenslet", 2), "near_mm": ("aim", 2),
    "lenslet": ("lenslet", 2), "centre_mm": ("lenslet", 2), "local_mm": ("dome", 3), "origin_mm": ("dome", 3),
    "direction": ("exit", 3), "status": ("status", 1),
}  # fmt: skip

#: Steps to neighbours, in columns and rows or in lenslets.
BESIDE = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))

TIE_RULE = "cells closed on their other side (tie rule)"

#: Rays as arrays by name.
Arrays = dict[str, Floats]


class Variant(NamedTuple):
    """A fault: the step that it is in, its name, and the rays that it gives, from the inputs and golden's rays.

    `silent` are arrays that it does not predict. It traces inputs that `change` returns, or changes golden's arrays by
    `bend`; None: it does otherwise.
    """

    stage: str
    name: str
    predict: Callable[[Out, Arrays], Arrays]
    silent: tuple[str, ...] = ()
    change: Callable[[Out], Out] | None = None
    bend: Callable[[Arrays], Arrays] | None = None


def golden(given: Out) -> Arrays:
    """Return golden's rays and steps, by the names of a file's arrays."""
    rays = given.traced()
    return {
        "lenslet": rays.lenslet.astype(np.float64),
        "centre_mm": rays.centre_mm,
        "local_mm": rays.local_mm,
        "origin_mm": rays.origin_mm,
        "direction": rays.direction,
        "status": rays.status.astype(np.float64)[:, None],
        **given.steps(),
    }


def _before(stage: str, name: str, change: Callable[[Out], Out], *silent: str) -> Variant:
    """Return the variant that traces changed inputs."""
    return Variant(stage, name, lambda given, _: golden(change(given)), silent, change)


def _after(stage: str, name: str, change: Callable[[Arrays], Arrays]) -> Variant:
    """Return the variant that changes some arrays of golden's rays."""
    return Variant(stage, name, lambda _, rays: rays | change(rays), bend=change)


def _with(stage: str, name: str, number: str, value: Any) -> Variant:
    """Return the variant with another number of the display."""
    return _before(stage, name, partial(_with_number, number, value))


def _with_number(name: str, value: Any, given: Out) -> Out:
    """Return the same rays for another number of the display, such as `array.index`; a glass becomes a plain index.

    `GLASS` is another index with the radius that keeps the focal length, radius / (index - 1).
    """
    display = given.display
    if name == GLASS:
        radius = display.array.radius_mm * (value - 1.0) / (display.array.index - 1.0)
        given, name = _with_number("array.radius_mm", radius, given), "array.index"
        display = given.display
    part, _, key = name.rpartition(".")
    key, _, entry = key.partition("[")
    if entry:
        old = attrgetter(f"{part}.{key}")(display)
        pair = old if isinstance(old, tuple) else (old, old)  # a variant may have made one of two
        value = tuple(value if f"{k}]" == entry else one for k, one in enumerate(pair))
    changes: dict[str, Any] = {key: value}
    if part == "panel":
        changes = {part: replace(display.panel, **changes)}
    elif part == "array":
        array = replace(display.array, **{"glass": None, **changes})
        if key in ("pitch_mm", "shear") and display.array.thickness_mm == display.array.sag_mm:
            array = replace(array, thickness_mm=array.sag_mm)  # by default: the tracer's follows its own cell
        changes = {part: array}
    return replace(given, display=replace(display, **changes))


def variants(display: Display) -> Iterator[Variant]:
    """Yield the variants that make a difference on a display, in the order of the ray."""
    for made in (_panel_variants, _lattice_variants, _aim_variants, _dome_variants, _exit_variants):
        yield from made(display)


def _panel_variants(display: Display) -> Iterator[Variant]:
    """Yield wrong pixels and wrong maps from panel to array."""
    array, w, h = display.array, display.panel.width_px, display.panel.height_px
    moves: dict[str, Callable[[Floats], Floats]] = {
        "rows counted from the bottom (y flipped)": lambda p: np.column_stack([p[:, 0], h - p[:, 1]]),
        "columns counted from the right (x flipped)": lambda p: np.column_stack([w - p[:, 0], p[:, 1]]),
        "column and row swapped": lambda p: p[:, ::-1],
        "pixel's corner for its centre (half a pixel)": lambda p: p - 0.5,
        "half a pixel added twice": lambda p: p + 0.5,
        "pixel coordinates rounded down to whole pixels": np.floor,
        "pixel coordinates rounded to whole pixels": np.round,
        "rows counted from the bottom, one off (h - 1 - v)": lambda p: np.column_stack([p[:, 0], h - 1 - p[:, 1]]),
        "columns counted from the right, one off (w - 1 - u)": lambda p: np.column_stack([w - 1 - p[:, 0], p[:, 1]]),
        **{f"pixel off by one: ({du:+d}, {dv:+d})": partial(np.add, (du, dv)) for du, dv in BESIDE},
    }

    def moved(name: str, move: Callable[[Floats], Floats]) -> Variant:
        return _before("panel", name, lambda g: replace(g, pixels=move(g.pixels)))

    yield from map(moved, moves, moves.values())
    x, y = array.offset_mm
    if (x, y) != (0.0, 0.0):
        yield _with("panel", "offset_mm left out", "array.offset_mm", (0.0, 0.0))
        yield _with("panel", "sign of offset_mm", "array.offset_mm", (-x, -y))
        yield _with("panel", "axes of offset_mm swapped", "array.offset_mm", (y, x))
    turn = array.rotation_deg
    if turn:
        yield _with("panel", "sense of rotation_deg", "array.rotation_deg", -turn)
        yield _with("panel", "rotation_deg left out", "array.rotation_deg", 0.0)
        yield _with("panel", "rotation_deg taken for radians", "array.rotation_deg", math.degrees(turn))
        yield _with("panel", "rotation_deg made radians twice", "array.rotation_deg", math.radians(turn))


def _lattice_variants(display: Display) -> Iterator[Variant]:
    """Yield wrong lenslets, and wrong numbers of the right ones."""
    array, system = display.array, System.of(display)

    def relabelled(name: str, label: Callable[[Floats], Floats], moved: bool = False) -> Variant:
        def change(rays: Arrays) -> Arrays:
            lenslet = label(rays["lenslet"])
            found = {"lenslet": lenslet, "home": label(rays["home"])}
            return found | _placed(system, rays["local_mm"], lenslet) if moved else found

        return _after("lenslet", name, change)

    for di, dj in BESIDE:
        step = np.array([di, dj], np.float64)
        yield relabelled(f"lenslet off by one: ({di:+d}, {dj:+d})", step.__add__, moved=True)
        yield relabelled(f"lenslet's number off by one: ({di:+d}, {dj:+d})", step.__add__)
        name, silent = f"neighbour's lenslet traced: ({di:+d}, {dj:+d})", ("status", "start_mm", "near_mm")
        yield Variant("lenslet", name, partial(_through_neighbour, step), silent)
    if array.grid == "square":
        silent = ("status", "start_mm", "near_mm")
        yield Variant("lenslet", "lenslet rounded down, not to the nearest", _rounded_down, silent)
    other: Grid = "hex" if array.grid == "square" else "square"
    if array.radius_mm >= replace(array, grid=other).half_diagonal_mm:
        yield _with("lenslet", f"{other} grid for {array.grid}", "array.grid", other)
    yield relabelled("lenslet's axes swapped", lambda ij: ij[:, ::-1], moved=True)
    yield relabelled("lenslet's axes swapped in its number", lambda ij: ij[:, ::-1])
    if array.grid == "hex":
        yield relabelled("hexagonal rows counted along the row", lambda ij: ij + np.floor(ij[:, 1:] / 2) * (1, 0))
        yield relabelled("hexagonal rows sheared the other way", lambda ij: ij + ij[:, 1:] * (1, 0))
        # Odd rows to the left for to the right: the mirrored lattice, with its labels.
        yield _after(
            "lenslet",
            "hexagonal rows moved the other way",
            lambda r: _placed(system, r["local_mm"], r["lenslet"] - r["lenslet"][:, 1:] * (1, 0)),
        )
        along_y = partial(_with_number, "array.rotation_deg", array.rotation_deg + 90.0)
        yield _before("lenslet", "hexagonal rows along y for x", along_y, "lenslet", "home")
    yield from _affine_variants(display)
    yield from _eye_variants(display)
    yield _before("lenslet", TIE_RULE, lambda g: replace(g, pixels=_other_ties(g)), "panel_mm")


def _affine_variants(display: Display) -> Iterator[Variant]:
    """Yield wrong numbers of a lattice that is not the regular one, or that ends."""
    array, (px, py) = display.array, display.array.pitches_mm
    if array.shear:
        yield _with("lenslet", "shear left out", "array.shear", 0.0)
        yield _with("lenslet", "sign of the shear", "array.shear", -array.shear)
    if px != py:
        yield _with("lenslet", "axes of pitch_mm swapped", "array.pitch_mm", (py, px))
        yield _with("lenslet", "pitch of a row for both of pitch_mm", "array.pitch_mm", px)
    if array.extent_mm is not None:
        yield _with("status", "extent_mm left out", "array.extent_mm", None)


def _eye_variants(display: Display) -> Iterator[Variant]:
    """Yield wrong elemental images of a display that converges on an eye."""
    eye_mm, (x, y) = display.viewing_distance_mm, display.viewing_axis_mm
    if eye_mm is None:
        return
    yield _with("lenslet", "viewing_distance_mm left out", "viewing_distance_mm", None)
    from_panel_mm = eye_mm - display.aperture_distance_mm
    yield _with("lenslet", "viewing_distance_mm counted from the panel", "viewing_distance_mm", from_panel_mm)
    if (x, y) != (0.0, 0.0):
        yield _with("lenslet", "viewing_axis_mm left out", "viewing_axis_mm", (0.0, 0.0))
        yield _with("lenslet", "sign of viewing_axis_mm", "viewing_axis_mm", (-x, -y))


def _placed(system: System, local_mm: Floats, lenslet: Floats) -> Arrays:
    """Return centres and origins of rays from some lenslets (N, 2)."""
    centre_mm = np.stack(system.centre(*lenslet.T), axis=1)
    return {"centre_mm": centre_mm, "origin_mm": local_mm + np.column_stack([centre_mm, np.zeros(len(lenslet))])}


def _through_neighbour(step: Floats, given: Out, rays: Arrays) -> Arrays:
    """Trace each ray through the lenslet `step` beside its own, with a dome that has no edge."""
    system = System.of(given.display)
    frame, b = system.frame, NumpyBackend()
    cx, cy = system.lattice.centre(*step.T)
    wide = replace(system.lattice, pitch_mm=tuple(8.0 * pitch for pitch in system.lattice.pitches_mm))
    alone = replace(system, lattice=wide, dome=replace(system.dome, lattice=wide))
    x, y, aim = rays["start_mm"][:, 0] - cx, rays["start_mm"][:, 1] - cy, (given.aims[:, 0], given.aims[:, 1])
    ray = models.leave_panel(b, alone, x, y, aim, given.model).ray
    lenslet = rays["home"] + step
    local = np.stack([*frame.turn(ray.x, ray.y), ray.z], axis=1)
    return {
        **rays,
        "home": lenslet,
        "lenslet": lenslet,
        "local_mm": local,
        "direction": np.stack([*frame.turn(ray.dx, ray.dy), ray.dz], axis=1),
        **_placed(system, local, lenslet),
    }


def _rounded_down(given: Out, rays: Arrays) -> Arrays:
    """Trace each ray through the lenslet whose number is rounded down: of the four around the point the lower left."""
    x, y = rays["start_mm"].T
    sides = np.stack([x - given.display.array.shear * y, y], axis=1)
    return _through_neighbour(np.where(sides < 0.0, -1.0, 0.0), given, rays)


def _other_ties(given: Out) -> Floats:
    """Return pixels with the points on a cell's left or lower edge moved beyond it, by less than any tolerance."""
    array = given.display.array
    x, y = given.steps()["start_mm"].T
    sides = np.stack([x - array.shear * y, y], axis=1)
    tie = np.isclose(sides, -0.5 * np.array(array.pitches_mm), rtol=1e-12, atol=0.0)
    nudge = 1e-9 * array.finest_mm / np.array(given.display.panel.pitches_mm) * (-1.0, 1.0)
    return np.asarray(given.pixels + np.where(tie, nudge, 0.0))


def _aim_variants(display: Display) -> Iterator[Variant]:
    """Yield wrong aperture points."""

    def aimed(name: str, aim: Callable[[Out], Floats]) -> Variant:
        return _before("aim", name, lambda g: replace(g, aperture=aim(g)))

    def toward(share: float, g: Out) -> Floats:
        """Return aims at a share of the way from the start to the aperture point, or beyond it."""
        start = g.steps()["start_mm"]
        return np.asarray(start + (g.aims - start) * share)

    yield aimed("aperture points not used", lambda g: np.zeros_like(g.aims))
    yield aimed("aperture points halved", lambda g: 0.5 * g.aims)
    yield aimed("aperture points doubled", lambda g: 2.0 * g.aims)
    yield aimed("sign of the aperture point", lambda g: -g.aims)
    yield aimed("axes of the aperture point swapped", lambda g: g.aims[:, ::-1])
    frame = System.of(display).frame
    if display.array.rotation_deg:
        yield aimed("aperture point along the panel's axes", lambda g: np.stack(frame.turn_back(*g.aims.T), axis=1))
    D, gap, T = display.aperture_distance_mm, display.gap_mm, display.array.thickness_mm
    for name, distance in (
        ("aperture plane without the index (gap + T)", gap + T),
        ("aperture plane with T times the index", gap + T * display.array.index),
        ("aperture plane at the flat face (gap)", gap),
        ("aperture plane at the focal length", display.array.focal_length_mm),
    ):
        if distance > 0.0 and abs(distance - D) > 1e-6 * D:
            yield aimed(name, partial(toward, D / distance))
    yield aimed("direction of the chief ray: sign", partial(toward, -1.0))


def _dome_variants(display: Display) -> Iterator[Variant]:
    """Yield wrong models and wrong numbers of the lens."""
    array = display.array
    n, R, T = array.index, array.radius_mm, array.thickness_mm
    for model in MODELS:
        yield _before("first face", f"rays of the model {model}", partial(replace, model=model))
    flipped = "viewer" if array.plano_side == "panel" else "panel"
    yield _with("first face", "plano_side turned over", "array.plano_side", flipped)
    yield _with("first face", "gap_mm left out", "gap_mm", 0.0)
    yield _with("first face", "thickness added to gap_mm", "gap_mm", display.gap_mm + T)
    for name, radius in (
        ("focal length taken for the radius", array.focal_length_mm),
        ("radius taken for the focal length", R * (n - 1.0)),
        ("diameter taken for the radius", 0.5 * R),
        ("radius taken for the diameter", 2.0 * R),
    ):
        if radius >= array.half_diagonal_mm:
            yield _with("dome", name, "array.radius_mm", radius)


def _exit_variants(display: Display) -> Iterator[Variant]:
    """Yield right rays with a fault in what is written down."""
    array, frame = display.array, System.of(display).frame

    def turned_back(rays: Arrays) -> Arrays:
        return {
            name: np.column_stack([*frame.turn_back(*rays[name][:, :2].T), rays[name][:, 2]])
            for name in ("direction", "local_mm")
        }

    bends: dict[str, Callable[[Floats], Floats]] = {
        "sign of the direction's x": lambda d: d * (-1, 1, 1),
        "sign of the direction's y": lambda d: d * (1, -1, 1),
        "sign of the direction's z": lambda d: d * (1, 1, -1),
        "sign of the direction's x and y": lambda d: d * (-1, -1, 1),
        "sign of the direction": lambda d: -d,
        "direction's x and y swapped": lambda d: d[:, [1, 0, 2]],
        "direction not normalised: z is 1": lambda d: d / d[:, 2:],
        "direction not normalised: index times": lambda d: d * array.index,
    }
    for times, said in ((2.0, "doubled"), (0.5, "halved")):
        bends[f"slopes of the direction {said}"] = partial(_steeper, times)
    for name, bend in bends.items():
        yield _bent(name, bend)
    if array.rotation_deg:
        for name in ("sign of the direction's x", "sign of the direction's y", "direction's x and y swapped"):
            yield _bent(f"{name}, along the array's axes", partial(_along_array, frame, bends[name]))
        yield _after("exit", "rays left along the array's axes", turned_back)
        offset = np.array([*array.offset_mm, 0.0])

        def place_turned_back(rays: Arrays) -> Arrays:
            found = {name: rays[name] - shift for name, shift in (("local_mm", 0.0), ("origin_mm", offset))}
            turned = {n: np.column_stack([*frame.turn_back(*v[:, :2].T), v[:, 2]]) for n, v in found.items()}
            return turned | {"origin_mm": turned["origin_mm"] + offset}

        yield _after("dome", "exit point left along the array's axes", place_turned_back)
    vertices = display.gap_mm + array.thickness_mm if array.plano_side == "panel" else display.gap_mm
    for name, z in (
        ("flat face", array.thickness_mm),
        ("sphere's centre", array.radius_mm),
        ("panel", vertices),
    ):
        yield _added("dome", f"origin's z from the {name}", ("local_mm", "origin_mm"), (0.0, 0.0, z))
    yield _after("dome", "origin without the lenslet's centre", lambda r: {"origin_mm": r["local_mm"]})


def _steeper(times: float, direction: Floats) -> Floats:
    """Return directions with other slopes."""
    steep = direction * (times, times, 1.0)
    return np.asarray(steep / np.linalg.norm(steep, axis=1)[:, None])


def _along_array(frame: Any, bend: Callable[[Floats], Floats], direction: Floats) -> Floats:
    """Return directions that are bent in the array's axes."""
    x, y, z = direction.T
    x, y, z = bend(np.stack([*frame.turn_back(x, y), z], axis=1)).T
    return np.stack([*frame.turn(x, y), z], axis=1)


def _bent(name: str, bend: Callable[[Floats], Floats]) -> Variant:
    """Return the variant with other directions."""
    return _after("exit", name, lambda rays: {"direction": bend(rays["direction"])})


def _added(stage: str, name: str, arrays: tuple[str, ...], constant: Any) -> Variant:
    """Return the variant with a constant added to some arrays."""
    return _after(stage, name, lambda rays: {array: rays[array] + constant for array in arrays})


#: What stands between the names of two faults.
PAIR = "; and "
#: The glass as a number: its index, at the display's focal length.
GLASS = "another glass, of the same focal length: array.index"
#: The display's numbers that are fitted, and the step that uses each.
FITTED = {
    "array.index": "first face",
    "gap_mm": "first face",
    "array.thickness_mm": "first face",
    "array.radius_mm": "dome",
    "array.rotation_deg": "panel",
    "array.pitch_mm": "lenslet",
    "array.pitch_mm[0]": "lenslet",
    "array.pitch_mm[1]": "lenslet",
    "array.shear": "lenslet",
    "panel.pixel_pitch_mm": "panel",
    "panel.pixel_pitch_mm[0]": "panel",
    "panel.pixel_pitch_mm[1]": "panel",
    "array.offset_mm[0]": "panel",
    "array.offset_mm[1]": "panel",
}

#: How far from the display's number a fit looks, as shares of it (of a pitch, for 0 or an offset).
LOOKED = (-0.5, -0.3, -0.2, -0.1, -0.05, -0.02, -0.01, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
#: Near the display's number, up to a share of `NEAR`, pitches and rotations are tried in steps that move the panel's
#: corner by `CORNER` pitches.
NEAR, CORNER = 0.02, 0.25
#: Rotations in degrees that are always tried.
ROTATIONS = range(-180, 180)
#: Steps that refine the best of these, each to 0.6 of the width before.
REFINEMENTS = 48
#: Most steps of a fit of two numbers.
MOST_STEPS = 25
#: Bits of fraction that are tried for directions: no design has fewer; a float32 has more than the largest.
COARSEST, FINEST = 4, 22


def fitted(given: Out, values: Arrays) -> Iterator[Variant]:
    """Yield variants with a number that is fitted to foreign rays: a constant, a word length, a number of the display.

    For each number of the display, the value that explains the directions best.
    """
    rays = golden(given)
    for name, what, unit in (("direction", "direction", ""), ("local_mm", "exit point", " mm")):
        added = np.median(values[name] - rays[name], axis=0) if name in values else np.array(math.nan)
        if not np.isfinite(added).all():
            continue
        added = np.where(np.abs(added) > 0.05 * np.abs(added).max(), added, 0.0)
        said = ", ".join(f"{value:+.3g}{unit} in {axis}" for value, axis in zip(added, "xyz", strict=True) if value)
        moved = (name, "origin_mm") if name == "local_mm" else (name,)
        yield _added(FIELDS[name][0], f"a constant added to the {what}: {said}", moved, added)
    yield from _word_lengths(values["direction"])
    for name in (*FITTED, GLASS):
        if _number_of(name, given.display) is not None:
            yield from _number(name, given, values["direction"])


def fitted_together(given: Out, values: Arrays) -> Iterator[tuple[Variant, ...]]:
    """Yield two numbers of the display that are fitted to foreign directions at once, near the display's own.

    One of which the other leaves nothing to explain is left out.
    """
    from scipy.optimize import least_squares  # at its first use: right rays need no fit

    for names in combinations(FITTED, 2):
        old = [value for name in names if (value := _number_of(name, given.display)) is not None]
        if len(old) < 2 or len({name.partition("[")[0] for name in names}) == 1:
            continue
        unit = np.array([abs(value) or given.display.array.coarsest_mm for value in old])

        def off(tried: Floats, names: tuple[str, ...] = names, unit: Floats = unit) -> Floats:
            out = given
            for name, value in zip(names, tried * unit, strict=True):
                out = _with_number(name, float(value), out)
            return np.asarray((out.traced().direction - values["direction"]).ravel())

        try:
            found = least_squares(off, old / unit, loss="soft_l1", f_scale=1e-4, diff_step=1e-6, max_nfev=MOST_STEPS)
        except (LippmannError, ValueError, ZeroDivisionError):
            continue
        some = [
            _with(FITTED[name], f"{name} is {value:.6g} for {was:.6g}", name, float(value))
            for name, value, was in zip(names, found.x * unit, old, strict=True)
            if f"{value:.6g}" != f"{was:.6g}"
        ]
        if some:
            yield tuple(some)


def _number_of(name: str, display: Display) -> float | None:
    """Return a number of the display by its name in `FITTED`; None when it is one pitch of two, or none of two."""
    path, _, entry = name.rpartition(" ")[2].partition("[")
    value = attrgetter(path)(display)
    if isinstance(value, tuple) != bool(entry) or (name == "array.shear" and not value):
        return None
    return float(value[int(entry[0])] if entry else value)


def _word_lengths(direction: Floats) -> Iterator[Variant]:
    """Yield directions in fixed point, if all components are multiples of some power of two."""
    for bits in range(COARSEST, FINEST + 1):
        scaled = np.ldexp(direction, bits)
        if np.isfinite(scaled).all() and (scaled == np.round(scaled)).all():
            for name, cut in (("rounded", np.round), ("truncated", np.floor)):
                bend = partial(lambda cut, bits, d: np.ldexp(cut(np.ldexp(d, bits)), -bits), cut, bits)
                yield _bent(f"direction {name} to {bits} bits of fraction", bend)
            return


def _number(name: str, given: Out, direction: Floats) -> Iterator[Variant]:
    """Yield the variant with a number of the display fitted to directions (N, 3), if any value gives rays."""
    display = given.display
    path, value = name.partition("[")[0], _number_of(name, display)
    if value is None:
        return
    # Offsets repeat after a pitch: their size says nothing about their error.
    unit = value if value and "offset" not in name else display.array.coarsest_mm

    @cache
    def loss(tried: float) -> float:
        """Return the median error: rays that change lenslet or status on the way must not weigh."""
        try:
            rays = _with_number(name, tried, given).traced()
        except (LippmannError, ValueError, ZeroDivisionError):
            return math.inf
        return float(np.median(np.linalg.norm(rays.direction - direction, axis=1)))

    looked = [value + share * unit for share in LOOKED]
    if name == "array.rotation_deg":
        looked += [float(turn) for turn in ROTATIONS]
        looked += [value + math.degrees(turn) for turn in _near(display)]
    elif path == "array.shear":
        looked += [value + turn for turn in _near(display)]
    elif path in ("array.pitch_mm", "panel.pixel_pitch_mm"):
        looked += [value + share * unit for share in _near(display)]
    best, width = min(sorted(looked), key=loss), 0.02 * abs(unit)
    for _ in range(REFINEMENTS):
        best = min((best - width, best, best + width), key=loss)
        width *= 0.6
    if math.isfinite(loss(best)):
        stage = FITTED[name.rpartition(" ")[2]]
        yield _with(stage, f"{name} is {best:.6g} for {value:.6g}", name, best)


def _near(display: Display) -> Floats:
    """Return shares of a pitch, or turns in radians, that move the panel's corner by steps of `CORNER` pitches."""
    # On a panel of many lenslets the next of `LOOKED` leads rays to other lenslets; a fit must look between.
    panel = display.panel
    step = CORNER * display.array.finest_mm / (0.5 * math.hypot(panel.width_mm, panel.height_mm))
    most = int(NEAR / step)
    return step * np.arange(-most, most + 1, dtype=np.float64)
