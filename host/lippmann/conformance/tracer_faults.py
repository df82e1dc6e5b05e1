"""Variants of the golden engine, with one fault each. The variant that matches tested rays is the diagnosis."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from lippmann.conformance.coverage_points import tied_sides
from lippmann.conformance.ray_sets import PanelRays, unit_vectors
from lippmann.display.description import Display
from lippmann.errors import LippmannError
from lippmann.optics import models
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.rays import MODELS, Floats
from lippmann.optics.system import PanelFrame, System

#: Steps of a ray's trace, in order.
STAGES = ("panel", "lenslet", "aim", "first face", "dome", "exit", "status", "words")

#: Arrays in a file of rays: trace step that computes the array, and number of columns.
FIELDS = {
    "panel_mm": ("panel", 2),
    "home": ("lenslet", 2),
    "start_mm": ("lenslet", 2),
    "near_mm": ("aim", 2),
    "lenslet": ("lenslet", 2),
    "centre_mm": ("lenslet", 2),
    "local_mm": ("dome", 3),
    "origin_mm": ("dome", 3),
    "direction": ("exit", 3),
    "status": ("status", 1),
}

#: Index differences between a pixel or lenslet and its neighbours.
BESIDE = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))

TIE_RULE = "cells closed on their other side (tie rule)"
#: Name of the parameter that changes index and radius, at constant focal length.
GLASS = "another glass, of the same focal length: array.index"
#: Exceptions from a fault that makes the display or all rays invalid.
NO_RAYS = (LippmannError, ValueError, ZeroDivisionError)

#: A value in a display file.
Number = Any
#: A function that changes points, lenslet indices or directions.
Bend = Callable[[Floats], Floats]
#: Ray arrays, keyed by name.
Arrays = dict[str, Floats]


class Variant(NamedTuple):
    """A fault changes inputs, trace or outputs.

    A fault does not predict the arrays in `silent`.
    """

    stage: str
    name: str
    change: Callable[[PanelRays], PanelRays] | None = None
    bend: Callable[[Arrays], Arrays] | None = None
    trace: Callable[[PanelRays, Arrays], Arrays] | None = None
    silent: tuple[str, ...] = ()

    def predict(self, inputs: PanelRays, rays: Arrays) -> Arrays:
        """Return the rays of a design with this fault; `rays` are the golden rays."""
        if self.change is not None and (changed := self.change(inputs)) is not inputs:
            rays = golden(changed)
        if self.trace is not None:
            rays = self.trace(inputs, rays)
        return rays if self.bend is None else rays | self.bend(rays)


def golden(inputs: PanelRays) -> Arrays:
    """Return golden rays and intermediate values, keyed as in a file of rays."""
    rays = inputs.trace()
    return {
        "lenslet": rays.lenslet.astype(np.float64),
        "centre_mm": rays.centre_mm,
        "local_mm": rays.local_mm,
        "origin_mm": rays.origin_mm,
        "direction": rays.direction,
        "status": rays.status.astype(np.float64)[:, None],
        **inputs.steps(),
    }


def with_number(name: str, value: Number, inputs: PanelRays) -> PanelRays:
    """Set the display parameter `name`, such as `array.index`, to `value`."""
    display = inputs.display
    if name == GLASS:  # the focal length is radius / (index - 1)
        radius = display.array.radius_mm * (value - 1.0) / (display.array.index - 1.0)
        return with_number("array.index", value, with_number("array.radius_mm", radius, inputs))
    path, _, entry = name.partition("[")
    part, _, key = path.rpartition(".")
    if entry:
        old = attrgetter(path)(display)
        pair = old if isinstance(old, tuple) else (old, old)  # a single pitch counts for x and y
        value = tuple(value if f"{k}]" == entry else one for k, one in enumerate(pair))
    if part == "array":
        array = replace(display.array, **{"glass": None, key: value})
        if key in ("pitch_mm", "shear") and display.array.thickness_mm == display.array.sag_mm:
            array = replace(array, thickness_mm=array.sag_mm)  # keep the default thickness
        key, value = part, array
    elif part == "panel":
        key, value = part, replace(display.panel, **{key: value})
    return replace(inputs, display=replace(display, **{key: value}))


def turn_back(frame: PanelFrame, vectors: Floats) -> Floats:
    """Convert vectors (N, 3) from the panel's axes to the array's axes."""
    return np.column_stack([*frame.turn_back(*vectors[:, :2].T), vectors[:, 2]])


def variants(display: Display) -> Iterator[Variant]:
    """Yield the faults that change a display's rays, in the order of the trace steps."""
    for variants_of_step in (_panel_variants, _number_variants, _lattice_variants, _aim_variants, _exit_variants):
        yield from variants_of_step(display)
    yield from (Variant("first face", f"rays of the model {model}", partial(replace, model=model)) for model in MODELS)


def _number_variants(display: Display) -> Iterator[Variant]:
    array, turn, system = display.array, display.array.rotation_deg, System.of(display)
    (x, y), (px, py), (axis_x, axis_y) = array.offset_mm, array.pitches_mm, display.viewing_axis_mm
    radius_mm = array.radius_mm
    grid = "hex" if array.grid == "square" else "square"
    plano_side = "viewer" if array.plano_side == "panel" else "panel"
    from_panel_mm = (display.viewing_distance_mm or math.inf) - display.aperture_distance_mm
    for stage, name, number, value in (
        ("panel", "offset_mm left out", "array.offset_mm", (0.0, 0.0)),
        ("panel", "sign of offset_mm", "array.offset_mm", (-x, -y)),
        ("panel", "axes of offset_mm swapped", "array.offset_mm", (y, x)),
        ("panel", "sign of rotation_deg", "array.rotation_deg", -turn),
        ("panel", "rotation_deg left out", "array.rotation_deg", 0.0),
        ("panel", "rotation_deg taken for radians", "array.rotation_deg", math.degrees(turn)),
        ("panel", "rotation_deg converted to radians twice", "array.rotation_deg", math.radians(turn)),
        ("lenslet", f"{grid} grid for {array.grid}", "array.grid", grid),
        ("lenslet", "shear left out", "array.shear", 0.0),
        ("lenslet", "sign of the shear", "array.shear", -array.shear),
        ("lenslet", "axes of pitch_mm swapped", "array.pitch_mm", (py, px)),
        ("lenslet", "first of pitch_mm for both", "array.pitch_mm", px),
        ("status", "extent_mm left out", "array.extent_mm", None),
        ("lenslet", "viewing_distance_mm left out", "viewing_distance_mm", None),
        ("lenslet", "viewing_distance_mm counted from the panel", "viewing_distance_mm", from_panel_mm),
        ("lenslet", "viewing_axis_mm left out", "viewing_axis_mm", (0.0, 0.0)),
        ("lenslet", "sign of viewing_axis_mm", "viewing_axis_mm", (-axis_x, -axis_y)),
        ("first face", "plano_side reversed", "array.plano_side", plano_side),
        ("first face", "gap_mm left out", "gap_mm", 0.0),
        ("first face", "thickness added to gap_mm", "gap_mm", display.gap_mm + array.thickness_mm),
        ("dome", "focal length taken as the radius", "array.radius_mm", array.focal_length_mm),
        ("dome", "radius taken as the focal length", "array.radius_mm", radius_mm * (array.index - 1.0)),
        ("dome", "radius halved", "array.radius_mm", 0.5 * radius_mm),
        ("dome", "radius doubled", "array.radius_mm", 2.0 * radius_mm),
    ):
        change = partial(with_number, number, value)
        with suppress(*NO_RAYS):
            if System.of(change(PanelRays("", display, np.zeros((0, 2)), None)).display) != system:
                yield Variant(stage, name, change)


def _panel_variants(display: Display) -> Iterator[Variant]:
    w, h = display.panel.size_px
    moves: dict[str, Bend] = {
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
    for name, move in moves.items():
        yield Variant("panel", name, partial(lambda move, rays: replace(rays, pixels=move(rays.pixels)), move))


def _lattice_variants(display: Display) -> Iterator[Variant]:
    array, system = display.array, System.of(display)

    def relabelled(name: str, label: Bend, moved: bool = False) -> Variant:
        def bend(rays: Arrays) -> Arrays:
            lenslet = label(rays["lenslet"])
            labels = {"lenslet": lenslet, "home": label(rays["home"])}
            return labels | _placed(system, rays["local_mm"], lenslet) if moved else labels

        return Variant("lenslet", name, bend=bend)

    silent = ("status", "start_mm", "near_mm")
    for di, dj in BESIDE:
        step, sides = np.array([di, dj], np.float64), f"({di:+d}, {dj:+d})"
        yield relabelled(f"lenslet off by one: {sides}", step.__add__, moved=True)
        yield relabelled(f"lenslet's number off by one: {sides}", step.__add__)
        trace = partial(_through_neighbour, step)
        yield Variant("lenslet", f"neighbour's lenslet traced: {sides}", trace=trace, silent=silent)
    if array.grid == "square":
        yield Variant("lenslet", "lenslet rounded down, not to the nearest", trace=_rounded_down, silent=silent)
    yield relabelled("lenslet's axes swapped", lambda ij: ij[:, ::-1], moved=True)
    yield relabelled("lenslet's axes swapped in its number", lambda ij: ij[:, ::-1])
    if array.grid == "hex":
        yield relabelled("hexagonal lenslets in offset coordinates", lambda ij: ij + np.floor(ij[:, 1:] / 2) * (1, 0))
        yield relabelled("hexagonal rows sheared the other way", lambda ij: ij + ij[:, 1:] * (1, 0))
        # Odd rows move left instead of right; the lenslet indices follow the lattice.
        yield Variant(
            "lenslet",
            "hexagonal rows moved the other way",
            bend=lambda r: _placed(system, r["local_mm"], r["lenslet"] - r["lenslet"][:, 1:] * (1, 0)),
        )
        along_y = partial(with_number, "array.rotation_deg", array.rotation_deg + 90.0)
        yield Variant("lenslet", "hexagonal rows along y for x", along_y, silent=("lenslet", "home"))
    yield Variant("lenslet", TIE_RULE, lambda g: replace(g, pixels=_across_ties(g)), silent=("panel_mm",))


def _placed(system: System, local_mm: Floats, lenslet: Floats) -> Arrays:
    centre_mm = np.stack(system.centre(*lenslet.T), axis=1)
    return {"centre_mm": centre_mm, "origin_mm": local_mm + np.column_stack([centre_mm, np.zeros(len(lenslet))])}


def _through_neighbour(step: Floats, inputs: PanelRays, rays: Arrays) -> Arrays:
    system = System.of(inputs.display)
    frame = system.frame
    wide = replace(system.lattice, pitch_mm=tuple(8.0 * pitch for pitch in system.lattice.pitches_mm))
    alone = replace(system, lattice=wide, dome=replace(system.dome, lattice=wide))
    x, y = (rays["start_mm"] - np.stack(system.lattice.centre(*step.T), axis=-1)).T
    aim_x, aim_y = inputs.aims.T
    ray = models.leave_panel(NumpyBackend(), alone, x, y, (aim_x, aim_y), inputs.model).ray
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


def _rounded_down(inputs: PanelRays, rays: Arrays) -> Arrays:
    x, y = rays["start_mm"].T
    sides = np.stack([x - inputs.display.array.shear * y, y], axis=1)
    return _through_neighbour(np.where(sides < 0.0, -1.0, 0.0), inputs, rays)


def _across_ties(inputs: PanelRays) -> Floats:
    ties = tied_sides(inputs)
    nudge = 1e-9 * inputs.display.array.finest_mm / np.array(inputs.display.panel.pitches_mm) * (-1.0, 1.0)
    return inputs.pixels + np.stack([ties[0], ties[-1]], axis=1) * nudge


def _aim_variants(display: Display) -> Iterator[Variant]:

    def aimed(name: str, aim: Callable[[PanelRays], Floats]) -> Variant:
        return Variant("aim", name, lambda g: replace(g, aperture=aim(g)))

    def toward(share: float, g: PanelRays) -> Floats:
        start = g.steps()["start_mm"]
        return start + (g.aims - start) * share

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
    yield aimed("sign of the chief ray's direction", partial(toward, -1.0))


def _exit_variants(display: Display) -> Iterator[Variant]:
    array, frame = display.array, System.of(display).frame
    bends: dict[str, Bend] = {
        "sign of the direction's x": lambda d: d * (-1, 1, 1),
        "sign of the direction's y": lambda d: d * (1, -1, 1),
        "sign of the direction's z": lambda d: d * (1, 1, -1),
        "sign of the direction's x and y": lambda d: d * (-1, -1, 1),
        "sign of the direction": lambda d: -d,
        "direction's x and y swapped": lambda d: d[:, [1, 0, 2]],
        "direction not normalised: z is 1": lambda d: d / d[:, 2:],
        "direction not normalised: length is the index": lambda d: d * array.index,
        "slopes of the direction doubled": lambda d: unit_vectors(d * (2.0, 2.0, 1.0)),
        "slopes of the direction halved": lambda d: unit_vectors(d * (0.5, 0.5, 1.0)),
    }
    for name, bend in bends.items():
        yield change_direction(name, bend)
    if array.rotation_deg:
        for name in ("sign of the direction's x", "sign of the direction's y", "direction's x and y swapped"):
            yield change_direction(f"{name}, along the array's axes", partial(_along_array, frame, bends[name]))
        name = "rays not rotated from the array's axes"
        yield Variant("exit", name, bend=lambda r: {n: turn_back(frame, r[n]) for n in ("direction", "local_mm")})
        offset = np.array([*array.offset_mm, 0.0])

        def turn_points_back(rays: Arrays) -> Arrays:
            origin_mm = turn_back(frame, rays["origin_mm"] - offset) + offset
            return {"local_mm": turn_back(frame, rays["local_mm"]), "origin_mm": origin_mm}

        yield Variant("dome", "exit point not rotated from the array's axes", bend=turn_points_back)
    vertices = display.gap_mm + array.thickness_mm if array.plano_side == "panel" else display.gap_mm
    for name, z in (("flat face", array.thickness_mm), ("sphere's centre", array.radius_mm), ("panel", vertices)):
        yield add_constant("dome", f"origin's z measured from the {name}", ("local_mm", "origin_mm"), (0.0, 0.0, z))
    yield Variant("dome", "origin without the lenslet's centre", bend=lambda r: {"origin_mm": r["local_mm"]})


def _along_array(frame: PanelFrame, bend: Bend, direction: Floats) -> Floats:
    x, y, z = bend(turn_back(frame, direction)).T
    return np.stack([*frame.turn(x, y), z], axis=1)


def change_direction(name: str, bend: Bend) -> Variant:
    """Return a fault that changes ray directions."""
    return Variant("exit", name, bend=lambda rays: {"direction": bend(rays["direction"])})


def add_constant(stage: str, name: str, arrays: tuple[str, ...], constant: Floats | tuple[float, ...]) -> Variant:
    """Return a fault that adds a constant to the named arrays."""
    return Variant(stage, name, bend=lambda rays: {array: rays[array] + constant for array in arrays})
