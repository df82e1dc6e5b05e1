"""Draws a display as SVG or PNG: its panel and lenslets, and its viewing zones from above."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lippmann.base.files import replacing
from lippmann.display.description import Display
from lippmann.display.subpixels import layout_of
from lippmann.engines import trace
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.crosstalk_and_viewing_zone import middle_eye, status_share, status_shares, viewing_distance, zones
from lippmann.optics.display_properties import percent
from lippmann.optics.rays import Floats, Indices, Status, gets_through
from lippmann.optics.system import System

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colours of Okabe and Ito, for all kinds of colour vision.
GLASS, LENSLET, IMAGE, RAY = "#56b4e9", "#0072b2", "#d55e00", "#e69f00"
#: Width of a close-up, lenslets.
CLOSE = 4.0
#: Lenslet marks across the drawn panel.
MARKS = 30.0
#: Maximum width, pixels, of a close-up in which pixels are drawn.
MAX_PIXELS = 150
#: Eye distances in `draw_zones`, as multiples of the viewing distance.
HEIGHTS = np.linspace(0.2, 3.0, 15)
#: Eyes at each distance in `draw_zones`.
PLACES = 41
#: Rays per eye in `draw_zones`.
MAP_RAYS = 256


@contextmanager
def _drawing(path: Path, down: int, across: int, size: tuple[float, float]) -> Iterator[npt.NDArray[np.object_]]:
    """Yield the axes of a drawing of `size` inches, then write it to the path."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    # Write text as characters, not as outlines, and equal SVGs for equal displays.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "lippmann", "font.size": 9}):
        figure = Figure(figsize=size, layout="constrained")
        yield figure.subplots(down, across, squeeze=False)
        kind = path.suffix.lower()[1:]
        with replacing(path) as temporary:
            figure.savefig(temporary, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None)


def draw_zones(display: Display, path: Path, eye_mm: Sequence[float] | None = None) -> None:
    """Draw a map, from above, of the crosstalk at eye positions."""
    usual, half = viewing_distance(display), 0.5 * display.panel.width_mm
    heights = (HEIGHTS * usual).tolist()
    middle = [middle_eye(display, z) for z in heights]
    pairs = zip(heights, zones(display, heights), strict=True)
    ends = [(z, zone.left_mm, zone.right_mm) for z, zone in pairs if zone is not None]
    widest = max([half] + [max(abs(start), abs(end)) for _, start, end in ends])
    places = np.linspace(-1.2 * widest, 1.2 * widest, PLACES)
    eyes = np.array([(x, y, z) for _, y, z in middle for x in places])
    shares = status_shares(display, eyes, MAP_RAYS).reshape(len(middle), len(places), -1)
    # Divide by rays that see light, not by all: eyes far to the side see dark panels.
    right, wrong = shares[..., Status.OK], shares[..., Status.CROSSTALK]
    wrong = wrong / np.maximum(right + wrong, 1.0 / MAP_RAYS)
    with _drawing(path, 1, 1, (7.0, 6.5)) as ((axis,),):
        levels = (0.0, 0.01, 0.1, 0.25, 0.5, 0.75, 1.0001)
        filled = axis.contourf(places, heights, wrong, levels, cmap="YlOrRd")
        axis.figure.colorbar(
            filled, label="crosstalk, fraction of the light", format=lambda share, _: f"{100 * share:.0f} %"
        )
        if ends:
            edge = {"facecolor": "none", "edgecolor": LENSLET, "linewidth": 2}
            axis.fill_betweenx(*zip(*ends, strict=True), **edge, label="zone without crosstalk")
        axis.plot((-half, half), (0.0, 0.0), color="black", linewidth=4, solid_capstyle="butt", label="panel")
        marked: dict[str, Sequence[float]] = {"viewing distance": middle_eye(display, usual)}
        if eye_mm is not None:
            marked["eye"] = eye_mm
        for (name, (x, y, z)), mark in zip(marked.items(), "o^", strict=False):
            share = status_share(display, (x, y, z))["crosstalk"]
            label = f"{name}: {x:g}, {y:g}, {z:g} mm, crosstalk {percent(share)}"
            axis.plot(x, z, mark, color="black", label=label)
        axis.set(xlabel="x, mm", ylabel="distance from the display, mm", title=f"{display.name}, from above")
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1))


def draw_display(display: Display, path: Path) -> None:
    """Draw the panel, close-ups of its middle and corner, and a section of lenslets."""
    panel, system = display.panel, System.of(display)
    half = np.array((panel.width_mm, panel.height_mm)) / 2.0
    with _drawing(path, 2, 2, (11.0, 9.0)) as ((overview, section), (centre, corner)):
        every = max(1, round(panel.width_mm / display.array.pitches_mm[0] / MARKS))
        span = int(np.hypot(*half) / display.array.row_pitch_mm / every) + 2
        x, y = _lenslets(system, (0.0, 0.0), span, every)
        inside = (abs(x) <= half[0]) & (abs(y) <= half[1])
        overview.plot(x[inside], y[inside], ".", color=LENSLET, markersize=3)
        _draw_edges(overview, display, system)
        if display.array.extent_mm is not None:
            overview.legend(loc="upper right")
        overview.set(
            title=f"panel {2 * half[0]:.4g} x {2 * half[1]:.4g} mm, "
            + ("all lenslets" if every == 1 else f"one of every {every} x {every} lenslets"),
            aspect="equal",
            xlim=(-1.06 * half[0], 1.06 * half[0]),
            ylim=(-1.06 * half[1], 1.06 * half[1]),
        )
        _draw_section(section, display)
        end = half
        if display.array.extent_mm is not None:
            end = np.minimum(half, system.frame.panel_from_array(*(0.5 * np.array(display.array.extent_mm))))
        name = "top right corner" if (end == half).all() else "top right corner of the array"
        close_ups = (centre, "middle", np.zeros(2)), (corner, name, end - display.array.coarsest_mm)
        for axis, what, place in close_ups:
            _draw_close(axis, display, system, place)
            _draw_edges(axis, display, system)
            axis.set_title(f"{what}: pixels, lenslets (blue), their elemental images (red)")
        for axis in (overview, centre, corner):
            axis.set(xlabel="x, mm", ylabel="y, mm")


def _lenslets(system: System, place: Sequence[float] | Floats, span: int, every: int = 1) -> tuple[Floats, Floats]:
    """Return centres of lenslets around a panel point: up to `span` steps of `every` lenslets in each direction."""
    i, j, *_ = system.lattice.locate(NumpyBackend(), *map(np.asarray, system.frame.array_from_panel(*place)))
    steps = every * np.mgrid[-span : span + 1, -span : span + 1].reshape(2, -1)
    i, j = i + steps[0], j + steps[1]
    present = system.lattice.present(NumpyBackend(), i, j)
    return system.centre(i[present], j[present])


def _draw_edges(axis: Axes, display: Display, system: System) -> None:
    corners = 0.5 * np.array([(-1, 1, 1, -1, -1), (-1, -1, 1, 1, -1)])
    x, y = np.reshape((display.panel.width_mm, display.panel.height_mm), (2, 1)) * corners
    axis.plot(x, y, color="black")
    if display.array.extent_mm is not None:
        x, y = system.frame.panel_from_array(*(np.reshape(display.array.extent_mm, (2, 1)) * corners))
        (line,) = axis.plot(x, y, color=LENSLET, linestyle="--", label="end of the array")
        line.set_gid("border")


def _draw_close(axis: Axes, display: Display, system: System, place: Floats) -> None:
    panel, pitch = display.panel, display.array.coarsest_mm
    reach = 0.5 * CLOSE * pitch
    sides = reach * np.array((-1, 1))
    axis.set(xlim=place[0] + sides, ylim=place[1] + sides, aspect="equal")
    first, last = (system.frame.pixel_from_panel(place[0] + a, place[1] - a) for a in (-reach, reach))
    columns, rows = (
        np.arange(max(0, int(low)), min(count, int(high) + 1) + 1)
        for low, high, count in zip(first, last, panel.size_px, strict=True)
    )
    x, y = system.frame.panel_from_pixel(columns, rows)
    if len(columns) <= MAX_PIXELS:
        axis.vlines(x, y.min(), y.max(), color="0.8", linewidth=0.5)
        axis.hlines(y, x.min(), x.max(), color="0.8", linewidth=0.5)
        _draw_subpixels(axis, display, system, columns[:-1], rows[:-1])
    corners = np.array(system.lattice.corners + system.lattice.corners[:1]).T
    x, y = system.frame.turn(*corners)
    centres = np.stack(_lenslets(system, place, 2 * int(CLOSE)), axis=1)
    # Draw lenslets if they or their elemental images are partly visible.
    far = reach + pitch + np.abs(place).max() * display.convergence
    for cx, cy in centres[(np.abs(centres - place) < far).all(axis=1)].tolist():
        axis.plot(cx + x, cy + y, color=LENSLET)
        axis.plot(cx, cy, "+", color=LENSLET)
        ax, ay = system.frame.array_from_panel(cx, cy)
        px, py = system.convergence.on_panel(corners[0], corners[1], ax, ay)
        axis.plot(*system.frame.panel_from_array(ax + px, ay + py), color=IMAGE, linewidth=1.0)


def _draw_subpixels(axis: Axes, display: Display, system: System, columns: Indices, rows: Indices) -> None:
    from matplotlib.collections import PolyCollection

    layout = layout_of(display.panel.subpixels)
    if layout is None:
        return
    for colour, west, north, east, south in layout.edges():
        column, row = int(0.5 * (west + east)), int(0.5 * (north + south))
        across = columns[(columns - column) % layout.columns == 0] - column
        down = rows[(rows - row) % layout.rows == 0] - row
        u, v = (tile.reshape(-1, 1) for tile in np.meshgrid(across, down))
        corners = u + np.array([west, east, east, west]), v + np.array([north, north, south, south])
        x, y = system.frame.panel_from_pixel(*corners)
        face = "0.6" if colour == "white" else colour
        # Rasterize the boxes: thousands of shapes would make the SVG large.
        boxes = PolyCollection(list(np.stack([x, y], axis=2)), facecolor=face, alpha=0.3, rasterized=True)
        axis.add_collection(boxes, autolim=False)


def _draw_section(axis: Axes, display: Display) -> None:
    array, system = display.array, System.of(display)
    pitch, reach = array.pitches_mm[0], 1.5 * array.focal_length_mm
    gap, thickness = display.gap_mm, array.thickness_mm
    sign, flat = (-1.0, -thickness) if system.plano_to_panel else (1.0, thickness)
    near = flat if system.plano_to_panel else 0.0
    across = np.linspace(-0.5, 0.5, 41) * pitch
    bulge = sign * (array.radius_mm - np.sqrt(array.radius_mm**2 - across**2))
    outline = np.concatenate([across + step * pitch for step in (-1, 0, 1)])
    axis.fill_between(outline, np.tile(bulge, 3), flat, color=GLASS, alpha=0.4, label="lenslets")
    axis.plot((-1.5 * pitch, 1.5 * pitch), (near - gap,) * 2, color="black", linewidth=3, label="panel")
    frame = system.frame
    i, j, *_ = system.lattice.locate(NumpyBackend(), *map(np.asarray, frame.array_from_panel(0.0, 0.0)))
    centre = np.array(system.lattice.centre(i, j))
    shares, aims = (part.ravel() for part in np.meshgrid((-0.3, 0.0, 0.3), np.linspace(-0.45, 0.45, 5)))
    x, y = system.convergence.on_panel(shares * pitch, 0.0 * shares, *centre)
    pixels = np.stack(frame.pixel_from_panel(*frame.panel_from_array(centre[0] + x, centre[1] + y)), axis=1)
    rays = trace(display, pixels, np.stack([aims * pitch, 0.0 * aims], axis=1))
    out = frame.turn_back(*rays.local_mm[:, :2].T)[0]
    slope = frame.turn_back(*rays.direction[:, :2].T)[0] / rays.direction[:, 2]
    share = gap / display.aperture_distance_mm
    for k in np.flatnonzero(gets_through(rays.status) & (rays.lenslet == (i, j)).all(axis=1)):
        entered = x[k] + share * (aims[k] * pitch - x[k])
        start = rays.local_mm[k, 2]
        places = x[k], entered, out[k], out[k] + slope[k] * (reach - start)
        axis.plot(places, (near - gap, near, start, reach), color=RAY, linewidth=0.8)
    focal, distance = array.focal_length_mm, display.aperture_distance_mm
    words = f"gap {gap:.4g}, thickness {thickness:.4g}, focal length {focal:.4g}, D {distance:.4g} mm"
    axis.set(xlabel="along a row of lenslets, mm", ylabel="z, mm", aspect="equal", title=words)
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
