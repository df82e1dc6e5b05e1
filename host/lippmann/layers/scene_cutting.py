"""Cuts a Mitsuba scene into layers for a display.

Depths come from what eyes see (`slabs_of`). Each slab is rendered by itself from the middle eye (`peel`): rays start
at the slab's front, so that a layer holds what nearer layers hide. Where a surface crosses from one slab to the next,
the farther layer goes on with it underneath the nearer one, as far as a moving eye can look behind that layer's edge:
no hole opens.

A layer shows all of its slab at one depth. For an eye that moves, a point then is off by the difference of two
disparities, u = z / (E - z) at the distance E of the eyes: so many mm does a point at depth z move across the display,
against the eye, for each mm of the eye. To first order the error of the view is this shift times the picture's
gradient. The slabs are those with the least mean square of it over all points that are seen; they are found exactly, by
dynamic programming over a histogram.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.variant import current_device, dr, mi
from lippmann.display.description import Display
from lippmann.engines import trace
from lippmann.errors import InputError, whole_number
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.stack import MAX_LAYERS, Floats, Layer, LayerStack, Picture, quantise
from lippmann.optics.backend import Arr
from lippmann.optics.rays import Status
from lippmann.optics.sample_points import points_in_pixel
from lippmann.optics.zones import half_width, middle_eye, viewing_distance
from lippmann.rendering.bands import CHUNK_SAMPLES
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import make_integrator
from lippmann.rendering.sampling import Lines, Seeds, first_hit, sampler_of
from lippmann.scenes.scene import Scene

#: Texels of a slot across and down, unless others are given.
SLOT = (256, 192)
#: How far a display's rays reach is measured in so many lenslets at each edge of the panel, at so many places along it.
EDGE_LENSLETS, REACH_RAYS = 2.0, 101
#: Rays across and down that look for a scene's depths, and for the part of an area that a slab covers.
DEPTH_RAYS, TRIAL_RAYS, TRIAL_SAMPLES = (256, 192), (128, 96), 4
#: Texels that a layer continues underneath a nearer one at least.
EDGE_TEXELS = 2.0
#: Coverage above which a texel belongs to a surface.
COVERED = 0.5


class Reach(NamedTuple):
    """How far a display's rays and its eyes reach."""

    #: Rays, N of them: where they meet the plane z = 0, mm (N, 2), and their slopes (N, 2).
    places_mm: Floats
    slopes: Floats
    #: The middle eye, and how far other eyes are from it at most, mm.
    eye_mm: Point
    aside_mm: float

    def area(self, depth_mm: float) -> Area:
        """Return the area that rays meet at a depth; at infinity, of their slopes."""
        points = self.slopes if math.isinf(depth_mm) else self.places_mm + depth_mm * self.slopes
        (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
        return Area(depth_mm, float(left), float(bottom), float(right), float(top))


@dataclass(frozen=True)
class Cut:
    """A cut scene: the layers, the slabs that they show, and the errors of their palettes, dB.

    `apart` is the number of the layer of what moves by itself; None without.
    """

    stack: LayerStack
    slabs: tuple[Slab, ...]
    palette_db: tuple[float, ...]
    apart: int | None = None


def check_slot(slot: tuple[int, int]) -> None:
    """Refuse slots, texels across and down, that no board has (`SceneBuild`)."""
    try:
        SceneBuild(1, None, *slot)
    except InputError as error:
        raise InputError(f"slot {slot[0]}x{slot[1]}: {error}") from None


def reach_of(display: Display) -> Reach:
    """Return how far a display's chief rays reach, and its eyes: to the sides from where the whole panel is seen."""
    panel = display.panel
    # The farthest rays leave the lenslets at the panel's edges.
    band = math.ceil(EDGE_LENSLETS * display.array.coarsest_mm / min(panel.pitches_mm))
    sides = panel.width_px, panel.height_px
    every = [np.unique(np.linspace(0, side - 1, REACH_RAYS).astype(int)) for side in sides]
    edge = [np.unique(np.r_[: min(band, side), max(side - band, 0) : side]) for side in sides]
    grids = np.meshgrid(edge[0], every[1]), np.meshgrid(every[0], edge[1])
    rays = trace(display, np.concatenate([np.stack(grid, axis=-1).reshape(-1, 2) for grid in grids]) + 0.5)
    good = rays.status == Status.OK
    if not good.any():
        raise InputError(f"display '{display.name}': no ray leaves its lenslets; look with lippmann inspect")
    slopes = rays.direction[good, :2] / rays.direction[good, 2:]
    origin = rays.origin_mm[good]
    eye = middle_eye(display, viewing_distance(display))
    widest = half_width(display) * eye[2]
    return Reach(origin[:, :2] - origin[:, 2:] * slopes, slopes, eye, max(widest - 0.5 * panel.width_mm, 0.25 * widest))


def cut_scene(
    scene: Scene,
    display: Display,
    count: int,
    slot: tuple[int, int] = SLOT,
    settings: Settings | None = None,
    apart: Scene | None = None,
) -> Cut:
    """Cut a placed scene into at most `count` layers for a display; a scene of fewer depths gives fewer.

    `slot` is the most texels of a layer, across and down. `apart` is what moves by itself, as a scene without the rest:
    it becomes one layer more, at its own depth.

    Raises InputError for counts and sizes out of range, and a scene of which no eye sees anything.
    """
    count = whole_number("count", count, 1 if apart is None else 2, MAX_LAYERS)
    check_slot(slot)
    cutter = _Cutter(display, reach_of(display), slot, Settings(samples=16) if settings is None else settings)
    parts = [] if apart is None else [(cutter.slabs(apart, 1)[0], apart)]
    parts += [(slab, scene) for slab in cutter.slabs(scene, count - len(parts))]
    parts.sort(key=lambda part: -part[0].depth_mm)
    layers, slabs, errors = list[Layer](), list[Slab](), list[float]()
    background, before, apart_number = np.zeros(3), None, None
    for slab, part in parts:
        view = cutter.picture(part, slab, before if part is scene else None)
        before = slab if part is scene else before
        if view is None:
            continue
        apart_number = apart_number if part is scene else len(layers)
        layer, error_db = layer_of(*view)
        layers.append(layer)
        slabs.append(slab)
        errors.append(error_db)
        # What shows beside the last layer's texture.
        opacity, light = view[1].opacity, view[1].light
        background = (opacity[..., None] * light).sum(axis=(0, 1)) / max(opacity.sum(), 1e-9)
    if not layers:
        raise InputError(f"{scene.path}: no layer has any texel; place the scene with --fit")
    stack = LayerStack(tuple(layers), np.clip(background, 0.0, 1.0))
    return Cut(stack, tuple(slabs), tuple(errors), apart_number)


def layer_of(area: Area, picture: Picture) -> tuple[Layer, float]:
    """Return the layer that shows a picture in an area, and the error of its palette, dB."""
    texels, palette, error_db = quantise(picture.rgba)
    return Layer(texels, palette, area.depth_mm, area.matrix(texels.shape[1], texels.shape[0])), error_db


@dataclass(frozen=True)
class _Cutter:
    """What all slabs of a cut have in common."""

    display: Display
    reach: Reach
    slot: tuple[int, int]
    settings: Settings

    def slabs(self, scene: Scene, count: int) -> list[Slab]:
        """Return the slabs of a scene that eyes in the middle and to all sides see."""
        x, y, z = self.reach.eye_mm
        front, aside, window = min(scene.depth_range_mm[1], z), self.reach.aside_mm, self.reach.area(0.0)
        eyes = [(x + a * aside, y + b * aside, z) for a, b in ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1))]
        trial = replace(self.settings, samples=TRIAL_SAMPLES)
        depths, detail = zip(*(seen_depths(scene, window, eye, DEPTH_RAYS, trial) for eye in eyes), strict=True)
        try:
            return slabs_of(np.concatenate(depths), np.concatenate(detail), count, z, front)
        except InputError as error:
            raise InputError(f"{scene.path}: {error}") from None

    def picture(self, scene: Scene, slab: Slab, before: Slab | None) -> tuple[Area, Picture] | None:
        """Return a slab's picture and the area that it covers; None when no ray meets anything of it."""
        display, reach, slot, settings = self.display, self.reach, self.slot, self.settings
        depth = math.inf if math.isinf(slab.depth_mm) else slab.depth_mm
        # A texel more on each side, so that no ray meets the half texel where a bilinear texture fades out.
        reached = reach.area(depth)
        texel = max(finest_texel(depth, display), *np.divide(reached.size, slot).tolist())
        reached = reached.grown(texel)
        between = slab.front_mm, slab.back_mm
        trial = peel(scene, reached, reach.eye_mm, between, TRIAL_RAYS, replace(settings, samples=TRIAL_SAMPLES))
        mask = trial.coverage > 0.0
        if not mask.any():
            return None
        hidden = 0.0
        if before is not None and not math.isinf(depth):
            # So far behind the nearer layer's edge an eye can look, which is at most so far aside; and the texels at
            # the edges of both layers, which are covered in part.
            hidden = reach.aside_mm * (before.depth_mm - depth) / (reach.eye_mm[2] - before.depth_mm)
            hidden += EDGE_TEXELS * texel
        area = reached.cells(mask, hidden)
        size = texels_for(area, display, slot)
        view = peel(scene, area, reach.eye_mm, between, size, settings)
        if hidden > 0.0 and before is not None:
            under = peel(scene, area, reach.eye_mm, (before.front_mm, slab.front_mm), size, settings)
            view = _continued(view, under, (area.size[1] / size[1], area.size[0] / size[0]), hidden)
        colour = view.light / np.maximum(view.coverage, 1e-9)[..., None]
        return area, Picture(np.clip(colour, 0.0, 1.0), np.clip(view.coverage, 0.0, 1.0))


def _continued(view: Slice, under: Slice, texel_mm: tuple[float, float], hidden_mm: float) -> Slice:
    """Return a slab's picture that goes on with the nearer slab's surfaces, `hidden_mm` beyond its own ones."""
    from scipy.ndimage import distance_transform_edt  # at its first use: it takes as long to load as all of render

    own = view.coverage > COVERED
    if not own.any():
        return view
    near = distance_transform_edt(~own, sampling=texel_mm) <= hidden_mm
    # Parts of a texel that one surface covers in both slabs lie side by side: they add up.
    added = np.where(near, np.minimum(1.0 - view.coverage, under.coverage), 0.0)
    share = added / np.maximum(under.coverage, 1e-9)
    return Slice(view.light + share[..., None] * under.light, view.coverage + added)


def texels_for(area: Area, display: Display, slot: tuple[int, int]) -> tuple[int, int]:
    """Return the texels across and down: a slot's, or fewer where they would be finer than what a pixel sees."""
    width, height = (max(2, math.ceil(side / finest_texel(area.depth_mm, display))) for side in area.size)
    return min(slot[0], width), min(slot[1], height)


def finest_texel(depth_mm: float, display: Display) -> float:
    """Return how far apart rays of neighbouring pixels are at a depth, at least a pixel, mm; of a sky, their slopes."""
    pixel = display.panel.coarsest_mm
    slope = pixel / display.aperture_distance_mm
    return slope if math.isinf(depth_mm) else max(pixel, abs(depth_mm) * slope)


Point = tuple[float, float, float]


@dataclass(frozen=True)
class Area:
    """A rectangle, mm, in the plane z = `depth_mm`; at a depth of infinity, of slopes dx/dz and dy/dz."""

    depth_mm: float
    left: float
    bottom: float
    right: float
    top: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height."""
        return self.right - self.left, self.top - self.bottom

    def grown(self, margin: float) -> Area:
        """Return the area with a margin on each side."""
        low, high = (self.left - margin, self.bottom - margin), (self.right + margin, self.top + margin)
        return Area(self.depth_mm, *low, *high)

    def matrix(self, width: int, height: int) -> Floats:
        """Return the matrix (2, 3) from (x, y, 1) to the texels of a texture that covers the area."""
        a, d = width / self.size[0], -height / self.size[1]
        return np.array([[a, 0.0, -a * self.left], [0.0, d, -d * self.top]])

    def cells(self, mask: npt.NDArray[np.bool_], margin: float) -> Area:
        """Return the part that a mask's true cells cover, with a margin and a cell on each side, within this area."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        across, down = self.size[0] / mask.shape[1], self.size[1] / mask.shape[0]
        return Area(
            self.depth_mm,
            max(self.left, self.left + columns[0] * across - (margin + across)),
            max(self.bottom, self.top - (rows[-1] + 1) * down - (margin + down)),
            min(self.right, self.left + (columns[-1] + 1) * across + (margin + across)),
            min(self.top, self.top - rows[0] * down + (margin + down)),
        )


@dataclass(frozen=True)
class Slice:
    """What an eye sees of a slab: light (height, width, 3) times coverage, and coverage (height, width); float64."""

    light: Floats
    coverage: Floats


def peel(
    scene: Scene,
    area: Area,
    eye_mm: Point,
    between_mm: tuple[float, float],
    size: tuple[int, int],
    settings: Settings,
) -> Slice:
    """Return what an eye sees in an area, of the surfaces between two depths (front, back); others are transparent.

    `size` is (width, height). With a back of -infinity the scene's surroundings are seen, too.
    """
    width, height = size
    (front, back), samples = between_mm, settings.samples
    integrator = make_integrator(scene, settings)
    surroundings = math.isinf(back) and scene.mitsuba.environment() is not None
    light, coverage = np.empty((width * height, 3)), np.empty(width * height)
    seeds = Seeds(dr.opaque(mi.UInt32, settings.seed), dr.opaque(mi.UInt32, 0))
    step = max(1, CHUNK_SAMPLES[current_device()] // samples)
    for first in range(0, width * height, step):
        interrupts.check()
        count = min(step, width * height - first)
        index = dr.arange(mi.UInt32, count * samples)
        texel = dr.opaque(mi.UInt32, first) + index // samples
        lines = _lines(area, eye_mm, size, texel, index % samples, settings)
        ray, valid, z = first_hit(scene, lines, front)
        visible = valid & (z >= dr.opaque(mi.Float, back))
        if surroundings:
            visible |= ~valid
        sampler = sampler_of(seeds, texel, index % samples)
        radiance, _, _ = integrator.sample(scene.mitsuba, sampler, ray, None, visible)
        colour = dr.select(visible, mi.Color3f(radiance), 0.0)
        share = dr.select(visible, mi.Float(1.0), 0.0)
        dr.eval(colour, share)
        for k, values in enumerate((*colour, share)):
            mean = np.asarray(dr.block_reduce(dr.ReduceOp.Add, values, samples), np.float64) / samples
            (coverage if k == 3 else light[:, k])[first : first + count] = mean
    return Slice(light.reshape(height, width, 3), coverage.reshape(height, width))


def seen_depths(
    scene: Scene, area: Area, eye_mm: Point, size: tuple[int, int], settings: Settings
) -> tuple[Floats, Floats]:
    """Return the depths (N,) of the surfaces that an eye sees in an area, and how much detail each of them shows (N,).

    Detail is the squared difference of neighbouring texels, which is the nearer one's: a surface hides with its edge
    what is behind it. The surroundings are at -infinity.
    """
    front = min(scene.depth_range_mm[1], eye_mm[2])
    index = dr.arange(mi.UInt32, size[0] * size[1])
    # A single sample is at the texel's centre.
    lines = _lines(area, eye_mm, size, index, dr.zeros(mi.UInt32, size[0] * size[1]), replace(settings, samples=1))
    _, valid, z = first_hit(scene, lines, front)
    shape = size[1], size[0]
    depths = np.where(np.asarray(valid), np.asarray(z, np.float64), -np.inf).reshape(shape)
    colour = np.sqrt(np.clip(peel(scene, area, eye_mm, (front, -math.inf), size, settings).light, 0.0, 1.0))
    detail = np.zeros(shape)
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        square = ((colour[other] - colour[one]) ** 2).sum(axis=-1)
        nearer = depths[one] > depths[other]
        detail[one] += np.where(nearer, square, 0.0)
        detail[other] += np.where(nearer, 0.0, square)
    there = np.isfinite(depths) | (scene.mitsuba.environment() is not None)
    return depths[there], detail[there]


def _lines(area: Area, eye_mm: Point, size: tuple[int, int], texel: Arr, sample: Arr, settings: Settings) -> Lines:
    """Return the lines from samples of an area's texels to an eye; of an area of slopes, through the origin."""
    # Opaque, so that another area or eye needs no compilation.
    columns = dr.opaque(mi.UInt32, size[0])
    left, top, across, down = (
        dr.opaque(mi.Float, value) for value in (area.left, area.top, area.size[0] / size[0], area.size[1] / size[1])
    )
    row = texel // columns
    s, t = points_in_pixel(texel, sample, settings.samples, settings.seed)
    x = left + (mi.Float(texel - row * columns) + s) * across
    y = top - (mi.Float(row) + t) * down
    if math.isinf(area.depth_mm):
        ray = dr.normalize(mi.Vector3f(x, y, 1.0))
        return Lines((mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)), (ray.x, ray.y, ray.z), mi.Bool(True))
    eye_x, eye_y, eye_z, depth = (dr.opaque(mi.Float, value) for value in (*eye_mm, area.depth_mm))
    ray = dr.normalize(mi.Vector3f(eye_x - x, eye_y - y, eye_z - depth))
    return Lines((x, y, depth), (ray.x, ray.y, ray.z), mi.Bool(True))


#: Bins of the histogram of disparities.
BINS = 512
#: What a point without any detail counts, in mean details.
PLAIN = 0.05
#: Least width of a bin: 0.001 mm for an eye that moves 100 mm. Rounding does not make two depths of one.
FINEST = 1e-5
#: Disparity at infinity.
SKY = -1.0


@dataclass(frozen=True)
class Slab:
    """The part of a scene that a layer shows: z from `front_mm` back to `back_mm`, at the depth `depth_mm`."""

    front_mm: float
    back_mm: float
    depth_mm: float


def disparity(z_mm: npt.ArrayLike, eye_mm: float) -> Floats:
    """Return the disparity of depths before an eye at a distance; -1 at z = -infinity."""
    z = np.asarray(z_mm, np.float64)
    far = np.isneginf(z)
    return np.where(far, SKY, np.where(far, 0.0, z) / (eye_mm - np.where(far, 0.0, z)))


def depth_of(u: float, eye_mm: float) -> float:
    """Return the depth of a disparity; the inverse of `disparity`."""
    return -math.inf if u <= SKY else eye_mm * u / (1.0 + u)


def slabs_of(z_mm: Floats, detail: Floats, count: int, eye_mm: float, front_mm: float) -> list[Slab]:
    """Return at most `count` slabs, from front to back, for the depths (N,) that eyes at a distance see.

    `detail` (N,) is the squared gradient of the picture there. Points without any count a little, too.

    Depths of -infinity, of a scene's surroundings, get a slab of their own or share the last one. `front_mm` is the
    front of the first slab; the last one has no back. There are fewer slabs than asked for where the depths have fewer
    values.

    Raises InputError when no eye sees anything.
    """
    if not z_mm.size:
        raise InputError("no eye sees any of the scene's surfaces; place it with --fit")
    u = disparity(z_mm, eye_mm)
    near = u[u > SKY]
    low, high = (float(near.min()), float(near.max())) if near.size else (0.0, 0.0)
    step = max((high - low) / (BINS - 1), FINEST)
    # Bin 0 is the sky; each other bin is known by the mean of its disparities.
    place = np.where(u > SKY, 1 + np.rint((u - low) / step).astype(np.int64), 0)
    mean_detail = float(detail.mean())
    share = detail + (PLAIN * mean_detail if mean_detail > 0.0 else 1.0)
    weight, total = (np.bincount(place, values, BINS + 1) for values in (share, share * u))
    used = np.flatnonzero(weight)[::-1]  # from front to back
    mean = total[used] / weight[used]
    ends = partition(mean, np.asarray(weight[used], np.float64), min(count, len(used)))
    slabs, front = [], front_mm
    for first, end in zip([0, *ends[:-1]], ends, strict=True):
        back = -math.inf if end == len(used) else depth_of(0.5 * (mean[end - 1] + mean[end]), eye_mm)
        depth = depth_of(float(np.average(mean[first:end], weights=weight[used][first:end])), eye_mm)
        slabs.append(Slab(front, back, depth))
        front = back
    return slabs


def partition(values: Floats, weights: Floats, count: int) -> list[int]:
    """Return the ends of `count` runs of ordered values with the least sum of weighted squares about their means."""
    n = len(values)
    sums = [np.concatenate([[0.0], np.cumsum(weights * values**power)]) for power in range(3)]

    def spread(end: int) -> Floats:
        """Return the sum of squares of the runs from each start before an end."""
        w, m, q = (one[end] - one[:end] for one in sums)
        return np.asarray(np.maximum(q - m * m / w, 0.0))

    runs = [spread(end) for end in range(1, n + 1)]
    best = np.array([run[0] for run in runs])
    starts = []
    for _ in range(count - 1):
        start, cost = np.zeros(n, np.int64), np.full(n, np.inf)
        for end in range(2, n + 1):
            through = best[: end - 1] + runs[end - 1][1:]
            start[end - 1] = 1 + int(np.argmin(through))
            cost[end - 1] = through[start[end - 1] - 1]
        starts.append(start)
        best = cost
    ends = [n]
    for start in reversed(starts):
        ends.append(int(start[ends[-1] - 1]))
    return ends[::-1]
