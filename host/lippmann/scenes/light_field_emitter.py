"""Defines the emitter `light_field`: a surface that shows each eye a different picture and lights nothing.

Each view is the surface's picture for one eye. A point's radiance is its colour in the
view from the position where the line of sight meets the plane of the eyes. Between the
two or four nearest eyes, the colour is interpolated linearly. Beyond the outermost eye,
it is constant.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from lippmann.base.variant import dr, mi
from lippmann.optics.backend import Arr

if TYPE_CHECKING:
    from mitsuba import Properties, SurfaceInteraction3f


def register_light_field() -> None:
    """Register the emitter plugin `light_field` for Mitsuba's current variant.

    The parameter `filename` is an .npz file. `views` (rows, columns, height, width, 3)
    are linear, lowest row and leftmost column of eyes first. `x_mm` (columns,), `y_mm`
    (rows,) and `distance_mm` are the eyes' positions from the window's centre;
    `size_mm` is the window's width and height.
    """

    class LightField(mi.Emitter):  # type: ignore[misc]
        def __init__(self, props: Properties) -> None:
            super().__init__(props)
            file = mi.file_resolver().resolve(mi.filesystem.path(props["filename"]))
            with np.load(str(file), allow_pickle=False) as arrays:
                views = arrays["views"]
                self.x, self.y, self.size = (arrays[name].tolist() for name in ("x_mm", "y_mm", "size_mm"))
                self.distance = float(arrays["distance_mm"])
            self.shape = views.shape[2:4]
            self.views = mi.TensorXf16(views.ravel().astype(np.float16), (views.size,)).array
            self.m_flags = mi.EmitterFlags.Surface

        def eval(self, si: SurfaceInteraction3f, active: Arr = True) -> Arr:
            u, v = si.uv.x, 1.0 - si.uv.y  # picture rows count downwards
            slope = self.distance / si.wi.z
            columns = _neighbours(self.x, (u - 0.5) * self.size[0] + si.wi.x * slope)
            rows = _neighbours(self.y, (0.5 - v) * self.size[1] + si.wi.y * slope)
            light = mi.Color3f(0.0)
            for (row, weight_y), (column, weight_x) in itertools.product(rows, columns):
                view = row * len(self.x) + column
                light += weight_x * weight_y * _view_colour(self.views, self.shape, view, u, v, active)
            return dr.select(active & (si.wi.z > 0.0), light, 0.0)

        def sample_direction(self, it: Arr, sample: Arr, active: Arr = True) -> tuple[Arr, Arr]:
            return dr.zeros(mi.DirectionSample3f), mi.Spectrum(0.0)

        def pdf_direction(self, it: Arr, ds: Arr, active: Arr = True) -> Arr:
            return mi.Float(0.0)

        def eval_direction(self, it: Arr, ds: Arr, active: Arr = True) -> Arr:
            return mi.Spectrum(0.0)

        def to_string(self) -> str:
            return f"LightField[{len(self.x)} x {len(self.y)} views]"

    mi.register_emitter("light_field", LightField)


def _view_colour(views: Arr, shape: tuple[int, int], view: Arr, u: Arr, v: Arr, active: Arr) -> Arr:
    height, width = shape
    x, y = u * width - 0.5, v * height - 0.5
    x0, y0 = dr.floor(x), dr.floor(y)
    colour = mi.Color3f(0.0)
    for dy, weight_y in ((0, 1.0 - (y - y0)), (1, y - y0)):
        for dx, weight_x in ((0, 1.0 - (x - x0)), (1, x - x0)):
            column = dr.clip(mi.Int32(x0) + dx, 0, width - 1)
            row = dr.clip(mi.Int32(y0) + dy, 0, height - 1)
            place = 3 * mi.UInt32((mi.Int32(view) * height + row) * width + column)
            pixel = [mi.Float(dr.gather(type(views), views, place + k, active)) for k in range(3)]
            colour += weight_x * weight_y * mi.Color3f(*pixel)
    return colour


def _neighbours(places: list[float], at: Arr) -> list[tuple[Arr, Arr]]:
    if len(places) == 1:
        return [(mi.Int32(0), mi.Float(1.0))]
    table = mi.Float(places)
    before = dr.binary_search(0, len(places) - 1, lambda k: dr.gather(mi.Float, table, k) <= at)
    first = mi.Int32(dr.clip(mi.Int32(before) - 1, 0, len(places) - 2))
    start, end = (dr.gather(mi.Float, table, mi.UInt32(first + k)) for k in (0, 1))
    weight = dr.clip((at - start) / (end - start), 0.0, 1.0)
    return [(first, 1.0 - weight), (first + 1, weight)]
