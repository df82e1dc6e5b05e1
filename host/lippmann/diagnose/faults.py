"""What a tracer may have got wrong: faulty variants of golden, each with the step of the ray that it is made at.

A variant predicts the rays that a design with this fault gives. When foreign rays are not golden's but a variant's, the
variant is the diagnosis. Discrete slips (a sign, an axis, degrees for radians) have a variant each; a display's number
that is off by any amount is found by fitting it (`fitted`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from lippmann.conditioning.search import Floats
from lippmann.conditioning.steps import steps
from lippmann.display import Display, Grid
from lippmann.engines import trace
from lippmann.errors import LippmannError
from lippmann.optics import models
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import MODELS, Model, Rays
from lippmann.optics.system import System

#: The steps of a ray, in its order.
STAGES = ("panel", "lenslet", "aim", "first face", "dome", "exit", "status", "words")

#: Arrays of a foreign file, and the step that makes each.
STAGE_OF = {
    "panel_mm": "panel",
    "home": "lenslet",
    "start_mm": "lenslet",
    "near_mm": "aim",
    "lenslet": "lenslet",
    "centre_mm": "lenslet",
    "local_mm": "dome",
    "origin_mm": "dome",
    "direction": "exit",
    "status": "status",
}

#: Steps to those beside, in columns and rows or in lenslets.
BESIDE = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))

#: Rays as arrays by name.
Arrays = dict[str, Floats]


@dataclass(frozen=True)
class Given:
    """What rays are made from."""

    display: Display
    pixels: Floats
    aperture: Floats | None
    model: Model

    @property
    def aims(self) -> Floats:
        """(N, 2) aperture points, mm; 0 for chief rays."""
        return np.zeros_like(self.pixels) if self.aperture is None else self.aperture

    def some(self, chosen: Any) -> Given:
        """Return some of the rays."""
        return dataclasses.replace(
            self, pixels=self.pixels[chosen], aperture=None if self.aperture is None else self.aperture[chosen]
        )

    def with_array(self, **changes: Any) -> Given:
        """Return the same rays for another array; a glass becomes a plain index."""
        made = replace(self.display.array, **{"glass": None, **changes})
        return dataclasses.replace(self, display=dataclasses.replace(self.display, array=made))


@dataclass(frozen=True)
class Variant:
    """A fault: its name, the step that it is made at, and the rays that it gives.

    `silent` are arrays that it predicts nothing about.
    """

    name: str
    stage: str
    predict: Callable[[Given], Arrays]
    silent: tuple[str, ...] = ()


def arrays_of(rays: Rays) -> Arrays:
    """Return rays as arrays by the names that files have."""
    return {
        "lenslet": rays.lenslet.astype(np.float64),
        "centre_mm": rays.centre_mm,
        "local_mm": rays.local_mm,
        "origin_mm": rays.origin_mm,
        "direction": rays.direction,
        "status": rays.status.astype(np.float64)[:, None],
    }


def golden(given: Given) -> Arrays:
    """Return golden's rays, and its steps."""
    rays = arrays_of(trace(given.display, given.pixels, given.aperture, given.model))
    return {**rays, **steps(given.display, given.pixels, given.aims)._asdict()}


def variants(display: Display) -> Iterator[Variant]:
    """Yield the variants that make a difference on a display, in the order of the ray."""
    array, panel = display.array, display.panel
    w, h = panel.width_px, panel.height_px

    def pixels(name: str, move: Callable[[Floats], Floats]) -> Variant:
        return Variant(name, "panel", lambda g: golden(dataclasses.replace(g, pixels=move(g.pixels))))

    def numbers(name: str, stage: str, **changes: Any) -> Variant:
        return Variant(name, stage, lambda g: golden(g.with_array(**changes)))

    yield pixels("rows counted from the bottom (y flipped)", lambda p: np.column_stack([p[:, 0], h - p[:, 1]]))
    yield pixels("columns counted from the right (x flipped)", lambda p: np.column_stack([w - p[:, 0], p[:, 1]]))
    yield pixels("column and row swapped", lambda p: p[:, ::-1])
    yield pixels("pixel's corner for its centre (half a pixel)", lambda p: p - 0.5)
    yield pixels("half a pixel added twice", lambda p: p + 0.5)
    yield pixels(
        "rows counted from the bottom, one off (h - 1 - v)", lambda p: np.column_stack([p[:, 0], h - 1 - p[:, 1]])
    )
    yield pixels(
        "columns counted from the right, one off (w - 1 - u)", lambda p: np.column_stack([w - 1 - p[:, 0], p[:, 1]])
    )
    for du, dv in BESIDE:
        yield pixels(f"pixel off by one: ({du:+d}, {dv:+d})", partial(np.add, (du, dv)))
    turn = array.rotation_deg
    if array.offset_mm != (0.0, 0.0):
        x, y = array.offset_mm
        yield numbers("offset_mm left out", "panel", offset_mm=(0.0, 0.0))
        yield numbers("sign of offset_mm", "panel", offset_mm=(-x, -y))
        yield numbers("axes of offset_mm swapped", "panel", offset_mm=(y, x))
    if turn:
        yield numbers("sense of rotation_deg", "panel", rotation_deg=-turn)
        yield numbers("rotation_deg left out", "panel", rotation_deg=0.0)
        yield numbers("rotation_deg taken for radians", "panel", rotation_deg=math.degrees(turn))
        yield numbers("rotation_deg made radians twice", "panel", rotation_deg=math.radians(turn))
    yield from _lattice_variants(display)
    yield from _aim_variants(display)

    for model in MODELS:
        yield Variant(f"rays of the model {model}", "first face", partial(_of_model, model))
    n, R, T = array.index, array.radius_mm, array.thickness_mm
    flipped = "viewer" if array.plano_side == "panel" else "panel"
    yield numbers("plano_side turned over", "first face", plano_side=flipped)
    yield Variant("gap_mm left out", "first face", lambda g: golden(_gap(g, 0.0)))
    yield Variant("thickness added to gap_mm", "first face", lambda g: golden(_gap(g, g.display.gap_mm + T)))
    for name, radius in (
        ("focal length taken for the radius", array.focal_length_mm),
        ("radius taken for the focal length", R * (n - 1.0)),
        ("diameter taken for the radius", 0.5 * R),
        ("radius taken for the diameter", 2.0 * R),
    ):
        if radius >= array.half_diagonal_mm:
            yield numbers(name, "dome", radius_mm=radius)
    yield from _exit_variants(display)


def _of_model(model: Model, given: Given) -> Arrays:
    return golden(dataclasses.replace(given, model=model))


def _gap(given: Given, gap_mm: float) -> Given:
    return dataclasses.replace(given, display=dataclasses.replace(given.display, gap_mm=gap_mm))


def _lattice_variants(display: Display) -> Iterator[Variant]:
    """Wrong lenslets, and wrong numbers of the right ones."""
    array = display.array
    system = System.of(display)

    def relabelled(name: str, label: Callable[[Floats], Floats], moved: bool) -> Variant:
        def predict(g: Given) -> Arrays:
            rays = golden(g)
            lenslet = label(rays["lenslet"])
            rays["home"] = label(rays["home"])
            if moved:
                centre = system.frame.panel_from_array(*system.lattice.centre(lenslet[:, 0], lenslet[:, 1]))
                rays["centre_mm"] = np.stack(centre, axis=1)
                rays["origin_mm"] = rays["local_mm"] + np.column_stack([rays["centre_mm"], np.zeros(len(lenslet))])
            rays["lenslet"] = lenslet
            return rays

        return Variant(name, "lenslet", predict)

    for di, dj in BESIDE:
        step = np.array([di, dj], np.float64)
        yield relabelled(f"lenslet off by one: ({di:+d}, {dj:+d})", step.__add__, True)
        yield relabelled(f"lenslet's number off by one: ({di:+d}, {dj:+d})", step.__add__, False)
        neighbour = partial(_through_neighbour, step)
        yield Variant(
            f"neighbour's lenslet traced: ({di:+d}, {dj:+d})", "lenslet", neighbour, ("status", "start_mm", "near_mm")
        )
    other: Grid = "hex" if array.grid == "square" else "square"
    made = replace(array, grid=other)
    if array.radius_mm >= made.half_diagonal_mm:
        yield Variant(f"{other} grid for {array.grid}", "lenslet", lambda g: golden(g.with_array(grid=other)))
    yield relabelled("lenslet's axes swapped", lambda ij: ij[:, ::-1], False)
    if array.grid == "hex":
        yield relabelled(
            "hexagonal rows counted along the row", lambda ij: ij + np.floor(ij[:, 1:] / 2) * (1, 0), False
        )
        yield relabelled("hexagonal rows sheared the other way", lambda ij: ij + ij[:, 1:] * (1, 0), False)

        def sheared(g: Given) -> Arrays:
            """Odd rows to the left for to the right: the lattice seen in a mirror, with its labels."""
            rays = golden(g)
            lenslet = rays["lenslet"]
            centre = system.lattice.centre(lenslet[:, 0] - lenslet[:, 1], lenslet[:, 1])
            rays["centre_mm"] = np.stack(system.frame.panel_from_array(*centre), axis=1)
            rays["origin_mm"] = rays["local_mm"] + np.column_stack([rays["centre_mm"], np.zeros(len(lenslet))])
            return rays

        yield Variant("hexagonal rows moved the other way", "lenslet", sheared)
        yield Variant(
            "hexagonal rows along y for x",
            "lenslet",
            lambda g: golden(g.with_array(rotation_deg=g.display.array.rotation_deg + 90.0)),
            ("lenslet", "home"),
        )
    yield Variant("cells closed on their other side (tie rule)", "lenslet", _other_ties, ("panel_mm",))


def _through_neighbour(step: Floats, given: Given) -> Arrays:
    """Trace rays as if each were the lenslet's that stands `step` beside its own, whose dome knows no end."""
    system = System.of(given.display)
    frame, b = system.frame, NumpyBackend()
    start, home = steps(given.display, given.pixels, given.aims)[2:0:-1]
    cx, cy = system.lattice.centre(step[0], step[1])
    wide = Lattice(system.lattice.grid, 8.0 * system.lattice.pitch_mm)
    alone = dataclasses.replace(system, lattice=wide, dome=dataclasses.replace(system.dome, lattice=wide))
    x, y, aim = start[:, 0] - cx, start[:, 1] - cy, (given.aims[:, 0], given.aims[:, 1])
    ray = models.leave_panel(b, alone, x, y, aim, given.model).ray
    lenslet = home + step
    centre = np.stack(frame.panel_from_array(*system.lattice.centre(lenslet[:, 0], lenslet[:, 1])), axis=1)
    local = np.stack([*frame.turn(ray.x, ray.y), ray.z], axis=1)
    return {
        **golden(given),
        "home": lenslet,
        "lenslet": lenslet,
        "centre_mm": centre,
        "local_mm": local,
        "origin_mm": local + np.column_stack([centre, np.zeros(len(local))]),
        "direction": np.stack([*frame.turn(ray.dx, ray.dy), ray.dz], axis=1),
    }


def _other_ties(given: Given) -> Arrays:
    """Give points exactly on a cell's left or lower edge to the cell beyond it."""
    half = 0.5 * given.display.array.pitch_mm
    local = steps(given.display, given.pixels, given.aims).start_mm
    # Just beyond the edge, by less than any tolerance.
    pixel = given.display.panel.pixel_pitch_mm
    nudge = 1e-9 * given.display.array.pitch_mm / pixel
    moved = given.pixels.copy()
    tie = np.isclose(local, -half, rtol=1e-12, atol=0.0)
    moved[:, 0] -= np.where(tie[:, 0], nudge, 0.0)
    moved[:, 1] += np.where(tie[:, 1], nudge, 0.0)
    return golden(dataclasses.replace(given, pixels=moved))


def _aim_variants(display: Display) -> Iterator[Variant]:
    """Wrong aperture points."""

    def aimed(name: str, aim: Callable[[Given], Floats]) -> Variant:
        return Variant(name, "aim", lambda g: golden(dataclasses.replace(g, aperture=aim(g))))

    def toward(distance: float, g: Given) -> Floats:
        """Aims in the true aperture plane of rays that aim in a plane at another distance."""
        start = steps(g.display, g.pixels, g.aims).start_mm
        return np.asarray(start + (g.aims - start) * g.display.aperture_distance_mm / distance)

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
            yield aimed(name, partial(toward, distance))
    yield aimed("direction of the chief ray: sign", _backwards)


def _backwards(given: Given) -> Floats:
    """Return aims of rays that leave the panel away from where they should aim."""
    start = steps(given.display, given.pixels, given.aims).start_mm
    return np.asarray(2.0 * start - given.aims)


def _exit_variants(display: Display) -> Iterator[Variant]:
    """Right rays, written down wrongly."""
    array = display.array
    frame = System.of(display).frame

    def after(name: str, change: Callable[[Arrays], Arrays], stage: str = "exit") -> Variant:
        def predict(g: Given) -> Arrays:
            rays = golden(g)
            return {**rays, **change(rays)}

        return Variant(name, stage, predict)

    for name, signs in (
        ("sign of the direction's x", (-1, 1, 1)),
        ("sign of the direction's y", (1, -1, 1)),
        ("sign of the direction's z", (1, 1, -1)),
        ("sign of the direction's x and y", (-1, -1, 1)),
        ("sign of the direction", (-1, -1, -1)),
    ):
        yield after(name, partial(_times, signs))
    yield after("direction's x and y swapped", lambda r: {"direction": r["direction"][:, [1, 0, 2]]})
    yield after("direction not normalised: z is 1", lambda r: {"direction": r["direction"] / r["direction"][:, 2:]})
    yield Variant("direction not normalised: index times", "exit", lambda g: _scaled(g, array.index))
    if array.rotation_deg:

        def turned_back(rays: Arrays) -> Arrays:
            found = {}
            for name in ("direction", "local_mm"):
                x, y = frame.turn_back(rays[name][:, 0], rays[name][:, 1])
                found[name] = np.stack([x, y, rays[name][:, 2]], axis=1)
            return found

        yield after("rays left along the array's axes", turned_back)
    for name, z in (("flat face", array.thickness_mm), ("sphere's centre", array.radius_mm)):
        yield after(f"origin's z from the {name}", partial(_lifted, z), "dome")
    yield after("origin without the lenslet's centre", lambda r: {"origin_mm": r["local_mm"]}, "dome")


def _times(signs: tuple[int, ...], rays: Arrays) -> Arrays:
    return {"direction": rays["direction"] * signs}


def _lifted(height: float, rays: Arrays) -> Arrays:
    return {name: rays[name] + (0.0, 0.0, height) for name in ("local_mm", "origin_mm")}


def _scaled(given: Given, factor: float) -> Arrays:
    rays = golden(given)
    return {**rays, "direction": rays["direction"] * factor}


#: Numbers of a display that are fitted: name, step, how to set one.
FITTED: dict[str, tuple[str, Callable[[Given, float], Given], Callable[[Display], float]]] = {
    "array.index": ("first face", lambda g, v: g.with_array(index=v), lambda d: d.array.index),
    "gap_mm": ("first face", _gap, lambda d: d.gap_mm),
    "array.thickness_mm": ("first face", lambda g, v: g.with_array(thickness_mm=v), lambda d: d.array.thickness_mm),
    "array.radius_mm": ("dome", lambda g, v: g.with_array(radius_mm=v), lambda d: d.array.radius_mm),
    "array.rotation_deg": ("panel", lambda g, v: g.with_array(rotation_deg=v), lambda d: d.array.rotation_deg),
    "array.pitch_mm": ("lenslet", lambda g, v: g.with_array(pitch_mm=v), lambda d: d.array.pitch_mm),
    "panel.pixel_pitch_mm": (
        "panel",
        lambda g, v: dataclasses.replace(
            g, display=dataclasses.replace(g.display, panel=replace(g.display.panel, pixel_pitch_mm=v))
        ),
        lambda d: d.panel.pixel_pitch_mm,
    ),
    "array.offset_mm[0]": (
        "panel",
        lambda g, v: g.with_array(offset_mm=(v, g.display.array.offset_mm[1])),
        lambda d: d.array.offset_mm[0],
    ),
    "array.offset_mm[1]": (
        "panel",
        lambda g, v: g.with_array(offset_mm=(g.display.array.offset_mm[0], v)),
        lambda d: d.array.offset_mm[1],
    ),
}

#: How far from the display's number a fit looks, as shares of it (of a pitch, where it is 0 or an offset).
LOOKED = (-0.5, -0.3, -0.2, -0.1, -0.05, -0.02, -0.01, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
#: How far around the display's number pitches and turns are looked at so closely that the panel's corner moves by no
#: more than a share of a lenslet.
NEAR, CORNER = 0.02, 0.25
#: A rotation is looked for all round: none is near another.
ROTATIONS = range(-180, 180)
#: Steps of the secant that sharpens the best of these.
SHARPENINGS = 12


def fitted(given: Given, values: Arrays) -> Iterator[Variant]:
    """Yield variants with a number that is found from foreign rays: one of the display, a constant, a word length.

    For each number of the display, the value that explains the directions best.
    """
    yield from _constants(given, values)
    yield from _word_lengths(values["direction"])
    yield from _numbers(given, values["direction"])


def _constants(given: Given, values: Arrays) -> Iterator[Variant]:
    """A constant added to the direction, or to the exit point."""
    rays = golden(given)
    for name, what, unit in (("direction", "direction", ""), ("local_mm", "exit point", " mm")):
        if name not in values:
            continue
        added = np.median(values[name] - rays[name], axis=0)
        if not np.isfinite(added).all():
            continue
        added = np.where(np.abs(added) > 0.05 * np.abs(added).max(), added, 0.0)
        said = ", ".join(f"{value:+.3g}{unit} in {axis}" for value, axis in zip(added, "xyz", strict=True) if value)
        moved = (name, "origin_mm") if name == "local_mm" else (name,)
        yield Variant(f"a constant added to the {what}: {said}", STAGE_OF[name], partial(_added, moved, added))


def _added(names: tuple[str, ...], constant: Floats, given: Given) -> Arrays:
    rays = golden(given)
    return {**rays, **{name: rays[name] + constant for name in names}}


#: Bits of fraction that are looked for in directions: fewer are no design, more than the most are a float32's own.
COARSEST, FINEST = 4, 22


def _word_lengths(direction: Floats) -> Iterator[Variant]:
    """Directions whose components are all multiples of some power of two."""
    for bits in range(COARSEST, FINEST + 1):
        scaled = np.ldexp(direction, bits)
        if np.isfinite(scaled).all() and (scaled == np.round(scaled)).all():
            for how, rounded in (("rounded", np.round), ("truncated", np.floor)):
                yield Variant(f"direction {how} to {bits} bits of fraction", "exit", partial(_held, rounded, bits))
            return


def _held(rounded: Callable[[Floats], Floats], bits: int, given: Given) -> Arrays:
    rays = golden(given)
    return {**rays, "direction": np.ldexp(rounded(np.ldexp(rays["direction"], bits)), -bits)}


def _numbers(given: Given, direction: Floats) -> Iterator[Variant]:
    """Numbers of the display; `direction` is (N, 3)."""

    def loss(rays: Arrays) -> float:
        # The median: rays that change lenslets or fates on the way must not pull.
        return float(np.median(np.linalg.norm(rays["direction"] - direction, axis=1)))

    for name, (stage, put, get) in FITTED.items():
        value = get(given.display)
        # Offsets are the same again a pitch further: how large they are says nothing of how far they may be off.
        unit = value if value and "offset" not in name else given.display.array.pitch_mm

        def tried(v: float, put: Any = put) -> float:
            try:
                return loss(golden(put(given, v)))
            except (LippmannError, ValueError, ZeroDivisionError):
                return math.inf

        looked = [value + share * unit for share in LOOKED]
        if name == "array.rotation_deg":
            looked += [float(turn) for turn in ROTATIONS]
            looked += [value + math.degrees(share) for share in _near(given.display)]
        elif name in ("array.pitch_mm", "panel.pixel_pitch_mm"):
            looked += [value + share * unit for share in _near(given.display)]
        best = min((tried(v), v) for v in looked)[1]
        best = _sharpened(tried, best, 0.02 * abs(unit))
        if not math.isfinite(tried(best)):
            continue
        yield Variant(f"{name} is {best:.6g} for {value:.6g}", stage, partial(_with_number, put, best))


def _near(display: Display) -> Floats:
    """Return the shares of a pitch, or the turns, to look at one by one: each moves the panel's corner by as much.

    On a panel of many lenslets rays have other lenslets at the next of `LOOKED`, and tell nothing of what is between.
    """
    panel = display.panel
    step = CORNER * display.array.pitch_mm / (0.5 * math.hypot(panel.width_mm, panel.height_mm))
    most = int(NEAR / step)
    return step * np.arange(-most, most + 1, dtype=np.float64)


def _with_number(put: Callable[[Given, float], Given], value: float, given: Given) -> Arrays:
    return golden(put(given, value))


def _sharpened(loss: Callable[[float], float], best: float, width: float) -> float:
    """Return the minimum of a loss near a value, by thirds that shrink around the best."""
    for _ in range(4 * SHARPENINGS):
        best = min((loss(v), v) for v in (best - width, best, best + width))[1]
        width *= 0.6
    return best
