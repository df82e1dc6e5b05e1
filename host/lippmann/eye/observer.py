"""Computes an eye's view, through the real lenslets, of a panel that shows an integral image.

Rays are traced against the light: from the eye through the view's window (plane z = 0)
and the lenslets to a pixel or sub-pixel of the panel. Crosstalk means that a ray
through a lenslet ends at a neighbour's pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.images import Radiance, StoredRows, write_picture
from lippmann.base.variant import current_device, dr, mi
from lippmann.display.description import Display, Panel, Point3
from lippmann.display.subpixels import layout_of
from lippmann.errors import InputError, as_number, check_choice, check_flags, whole_number
from lippmann.optics.backend import Arr, DrJitBackend
from lippmann.optics.crosstalk_and_viewing_zone import FARTHEST_EYE_MM, TOO_FAR
from lippmann.optics.rays import MODELS, Model, Status
from lippmann.optics.sample_points import points_in_square
from lippmann.optics.system import System
from lippmann.optics.trace import PixelHits, pixels_from_rays
from lippmann.rendering.integral_image import Showable
from lippmann.rendering.sampling import Window

#: Maximum rays traced at once.
CHUNK_RAYS = 1 << 21
#: Maximum bytes read at once from an image on disk.
STORED_BYTES = 1 << 27
#: An image of linear light, (height, width, 3).
Light = npt.NDArray[np.floating]
#: Function that returns rays' colours, given their mask, columns, rows and hits.
LookUp = Callable[[Arr, Arr, Arr, PixelHits], list[Arr]]


@dataclass(frozen=True)
class Eye:
    """An eye: centre (z > 0) and diameter of its pupil (0: a pinhole), and z of the plane in focus."""

    position_mm: Point3
    pupil_mm: float = 0.0
    focus_z_mm: float = 0.0

    def __post_init__(self) -> None:
        if np.array(self.position_mm, object).shape != (3,):
            raise InputError(f"eye: {self.position_mm} is not a position; give (x, y, z) in mm")
        if not all(map(math.isfinite, map(as_number, (*self.position_mm, self.pupil_mm, self.focus_z_mm)))):
            raise InputError("eye: a coordinate, the pupil or the focus is not finite; give numbers in mm")
        if max(map(abs, self.position_mm)) > FARTHEST_EYE_MM:
            raise InputError(TOO_FAR)
        if self.position_mm[2] <= 0.0:
            raise InputError(f"eye: z {self.position_mm[2]:g} mm is not in front of the display; give z > 0")
        if not 0.0 <= self.pupil_mm <= FARTHEST_EYE_MM:
            what = f"pupil {self.pupil_mm:g} mm is negative or over {FARTHEST_EYE_MM:g} mm"
            raise InputError(f"eye: {what}; give the diameter in mm")
        if self.focus_z_mm >= self.position_mm[2]:
            raise InputError("eye: the focus is behind the eye; give a focus depth below the eye's z")


@dataclass(frozen=True, eq=False, repr=False)
class View(Showable):
    """An eye's view: linear radiance (height, width, 3) float32, fraction of rays per status, metadata."""

    radiance: Radiance
    status_share: dict[str, float]
    metadata: dict[str, str] = field(default_factory=dict)

    def save(self, path: str | Path) -> None:
        """Write the view as linear .exr or .tif, or as sRGB .png; may raise InputError."""
        write_picture(path, self.radiance, self.metadata)


def whole_window(display: Display, width_px: int | None = None) -> Window:
    """Return the window that covers the panel, `width_px` wide; by default one pixel per lenslet."""
    panel = display.panel
    if width_px is None:
        width_px = max(1, round(panel.width_mm / display.array.pitches_mm[0]))
    height_px = max(1, round(width_px * panel.height_mm / panel.width_mm))
    return Window(panel.width_mm, panel.height_mm, width_px, height_px)


def check_size(radiance: Light | StoredRows, display: Display) -> None:
    """Refuse an image of another size than a display's panel."""
    panel = display.panel
    if radiance.shape != panel.shape:
        raise InputError(
            f"the image is {radiance.shape[1]} x {radiance.shape[0]} pixels, but the panel of '{display.name}' has "
            f"{panel.width_px} x {panel.height_px}; render it for this display"
        )


def observe(
    radiance: Light | StoredRows,
    display: Display,
    eye: Eye,
    window: Window,
    samples: int = 16,
    model: Model = "exact",
    seed: int = 0,
    crosstalk: bool = True,
) -> View:
    """Return an eye's view of a display that shows `radiance`; the display may be misaligned.

    `radiance` is linear, (height, width, 3). Only the visible parts of an image on disk
    (`StoredRows`) are read. The view covers the window, with `samples` rays per pixel.
    If `crosstalk` is false, rays that end in another lenslet's cell see black. Raises
    InputError if the image does not have the panel's size, the model is unknown, or
    `samples` is out of range.
    """
    panel = display.panel
    check_size(radiance, display)
    check_choice("model", model, MODELS)
    check_flags(crosstalk=crosstalk)
    samples = whole_number("samples", samples, 1, 65536)
    seed = whole_number("seed", seed, 0, 2**32 - 1)
    if 3 * panel.width_px * panel.height_px >= 2**32:
        raise InputError(f"the panel of '{display.name}' has more values than 32 bits can index; take a smaller panel")
    b, system = DrJitBackend(current_device()), System.of(display)
    total, chunk = window.width_px * window.height_px, max(1, CHUNK_RAYS // samples)
    if not isinstance(radiance, StoredRows):
        look_up = _light_in_memory(radiance)
    else:
        look_up = partial(_light_on_disk, radiance)
        # Bytes in the panel's rows behind one row of the view.
        row_bytes = 12 * panel.width_px * max(1, panel.height_px // window.height_px)
        chunk = min(chunk, window.width_px * max(1, STORED_BYTES // row_bytes))
    out = np.empty((total, 3), np.float32)
    counts = np.zeros(len(Status), np.int64)
    for start in range(0, total, chunk):
        interrupts.check()
        count = min(chunk, total - start)
        index = dr.arange(mi.UInt32, count * samples)
        pixel = dr.opaque(mi.UInt32, start) + index // samples
        hits = pixels_from_rays(b, system, *eye_rays(b, eye, window, pixel, index % samples, seed), model)
        visible = (hits.status == int(Status.OK)) | ((hits.status == int(Status.CROSSTALK)) & mi.Bool(crosstalk))
        colour = _emitted_light(b, panel, look_up, hits, visible)
        mean = [dr.block_reduce(dr.ReduceOp.Add, c, samples) * (1.0 / samples) for c in colour]
        dr.eval(mean, hits.status)
        for k in range(3):
            out[start : start + count, k] = np.asarray(mean[k])
        counts += np.bincount(np.asarray(hits.status), minlength=len(Status))
    share = {status.name.lower(): float(counts[status]) / (total * samples) for status in Status}
    return View(out.reshape(window.height_px, window.width_px, 3), share)


def _emitted_light(b: DrJitBackend, panel: Panel, look_up: LookUp, hits: PixelHits, visible: Arr) -> list[Arr]:
    column = mi.UInt32(dr.clip(dr.floor(hits.u), 0, panel.width_px - 1))
    row = mi.UInt32(dr.clip(dr.floor(hits.v), 0, panel.height_px - 1))
    # Look up first: if this evaluates the hits, the code below does not trace again.
    colour = look_up(visible, column, row, hits)
    if panel.black:
        colour = [dr.select(visible, panel.black + (1.0 - panel.black) * c, 0.0) for c in colour]
    layout = layout_of(panel.subpixels)
    if layout is None:
        return colour
    # A sub-pixel is smaller than its pixel, so it is brighter. White emits all colours.
    parts = layout.split_light(colour, dr.minimum(colour[0], dr.minimum(colour[1], colour[2])))
    colour = [mi.Float(0.0)] * 3
    for k, gain, inside in layout.emitters(b, hits.u, hits.v):
        for c in (k,) if k < 3 else range(3):
            colour[c] = colour[c] + dr.select(inside, gain * parts[k], 0.0)
    return colour


def _light_in_memory(radiance: Light) -> LookUp:
    light = mi.Float(np.ascontiguousarray(radiance, np.float32).ravel())

    def look_up(visible: Arr, column: Arr, row: Arr, hits: PixelHits) -> list[Arr]:
        place = (row * radiance.shape[1] + column) * 3
        return [dr.gather(mi.Float, light, place + k, visible) for k in range(3)]

    return look_up


def _light_on_disk(radiance: StoredRows, visible: Arr, column: Arr, row: Arr, hits: PixelHits) -> list[Arr]:
    """Look up the rays' colours in an image on disk."""
    dr.eval(visible, column, row, hits.u, hits.v, hits.status)
    _, width, _ = radiance.shape
    rows = max(1, STORED_BYTES // (12 * width))
    part = row // rows
    colour = [mi.Float(0.0)] * 3
    for number in np.unique(np.asarray(part)[np.asarray(visible)]):
        first = int(number) * rows
        light = mi.Float(radiance[first : first + rows].ravel())
        place = ((row - dr.opaque(mi.UInt32, first)) * width + column) * 3
        in_part = visible & (part == dr.opaque(mi.UInt32, int(number)))
        colour = [c + dr.gather(mi.Float, light, place + k, in_part) for k, c in enumerate(colour)]
        dr.eval(colour)
    return colour


def eye_rays(
    b: DrJitBackend, eye: Eye, window: Window, pixel: Arr, sample: Arr, seed: int
) -> tuple[tuple[Arr, ...], tuple[Arr, ...]]:
    """Return origins in the pupil, and unit directions (double), of rays through the window's pixels."""
    row = pixel // window.width_px
    column = pixel - row * window.width_px
    s, t = points_in_square(pixel, sample, seed, stream=0)
    x, y = window.point(b.double(column) + b.double(s), b.double(row) + b.double(t))
    double: Arr = b.double
    numbers = *eye.position_mm, eye.focus_z_mm, 0.5 * eye.pupil_mm
    ex, ey, ez, focus, radius = (dr.opaque(double, number) for number in numbers)
    if eye.pupil_mm > 0.0:
        p, q = points_in_square(pixel, sample, seed)
        disk = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(p, q))
        # A pixel's rays meet in the plane in focus, on the line from the pupil's centre.
        reach = (ez - focus) / ez
        fx, fy = ex + (x - ex) * reach, ey + (y - ey) * reach
        ex = ex + b.double(disk.x) * radius
        ey = ey + b.double(disk.y) * radius
        dx, dy, dz = fx - ex, fy - ey, focus - ez
    else:
        dx, dy, dz = x - ex, y - ey, -ez
    scale = 1.0 / dr.sqrt(dx * dx + dy * dy + dz * dz)
    return (ex, ey, ez), (dx * scale, dy * scale, dz * scale)
