"""Cuts a Mitsuba scene into layers for a display.

The depths that eyes see divide a scene into slabs (`slabs_of`). Each slab is rendered
alone, for the middle eye (`peel`). Rays start at a slab's front, so that a layer has
surfaces that nearer layers hide. Where a surface crosses into the next slab, the next
layer continues the surface under the nearer layer, as far as a moving eye sees.

A layer shows its whole slab at one depth. For eyes at the distance E, a point at depth
z has the disparity u = z / (E - z): if the eye moves by 1 mm, the point moves by u mm
across the display. To first order, a view's error is the picture's gradient times the
difference between a point's disparity and its layer's. The slabs minimise the mean
square error of views over all visible points (`partition`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.variant import current_device, dr, mi
from lippmann.display.description import Display, Pair, Point3
from lippmann.engines import trace
from lippmann.errors import InputError, input_error, located, whole_number
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.stack import MAX_LAYERS, Floats, Layer, LayerStack, Size, quantise, rgba_of
from lippmann.optics.backend import Arr
from lippmann.optics.crosstalk_and_viewing_zone import half_width, middle_eye, viewing_distance
from lippmann.optics.rays import Bools, Status
from lippmann.optics.sample_points import points_in_pixel
from lippmann.rendering.memory_estimate import CHUNK_SAMPLES
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import make_integrator
from lippmann.rendering.sampling import Lines, Seeds, first_hit, sampler_of
from lippmann.scenes.scene import Scene

#: Default size of a slot, texels across and down.
SLOT = (256, 192)
#: Width in lenslets of the strip at each panel edge that `reach_of` traces.
EDGE_LENSLETS = 2.0
#: Rays that `reach_of` traces along each edge of the panel.
REACH_RAYS = 101
#: Rays across and down that find a scene's depths.
DEPTH_RAYS = (256, 192)
#: Texels across and down of a trial view that finds a slab's area.
TRIAL_RAYS = (128, 96)
#: Samples per texel of a trial view.
TRIAL_SAMPLES = 4
#: Minimum texels that a layer continues under a nearer layer.
EDGE_TEXELS = 2.0
#: Coverage above which a texel belongs to a surface.
COVERED = 0.5


class Reach(NamedTuple):
    """Range of a display's exit rays and of its viewers' eyes."""

    #: Points where rays meet the plane z = 0, mm (N, 2).
    places_mm: Floats
    #: Slopes dx/dz and dy/dz of the rays, (N, 2).
    slopes: Floats
    #: Position of the middle eye, mm.
    eye_mm: Point3
    #: Maximum sideways distance of an eye from the middle eye, mm.
    aside_mm: float

    def area(self, depth_mm: float) -> Area:
        """Return the area that rays meet at a depth; at infinity, the range of the rays' slopes."""
        points = self.slopes if math.isinf(depth_mm) else self.places_mm + depth_mm * self.slopes
        return Area(depth_mm, *points.min(axis=0).tolist(), *points.max(axis=0).tolist())


@dataclass(frozen=True)
class Cut:
    """A cut scene: the layers, their slabs, and the PSNR of their palettes, dB."""

    stack: LayerStack
    slabs: tuple[Slab, ...]
    palette_db: tuple[float, ...]
    #: Index of the layer of separately moving objects.
    apart: int | None = None


def check_slot(slot: Size) -> None:
    """Refuse a slot size that no board has."""
    with located(f"slot {slot[0]}x{slot[1]}"):
        SceneBuild(1, None, *slot)


def reach_of(display: Display) -> Reach:
    """Return the `Reach` of a display's chief rays and its viewers' eyes."""
    panel = display.panel
    # The outermost rays leave the lenslets at the panel's edges.
    band = math.ceil(EDGE_LENSLETS * display.array.coarsest_mm / min(panel.pitches_mm))
    sides = panel.size_px
    every = [np.unique(np.linspace(0, side - 1, REACH_RAYS).astype(int)) for side in sides]
    edge = [np.unique(np.r_[: min(band, side), max(side - band, 0) : side]) for side in sides]
    grids = np.meshgrid(edge[0], every[1]), np.meshgrid(every[0], edge[1])
    rays = trace(display, np.concatenate([np.stack(grid, axis=-1).reshape(-1, 2) for grid in grids]) + 0.5)
    good = rays.status == Status.OK
    if not good.any():
        raise InputError(f"display '{display.name}': no ray leaves its lenslets; see lippmann inspect")
    slopes = rays.direction[good, :2] / rays.direction[good, 2:]
    origin = rays.origin_mm[good]
    eye = middle_eye(display, viewing_distance(display))
    widest = half_width(display) * eye[2]
    return Reach(origin[:, :2] - origin[:, 2:] * slopes, slopes, eye, max(widest - 0.5 * panel.width_mm, 0.25 * widest))


def cut_scene(
    scene: Scene,
    display: Display,
    count: int,
    slot: Size = SLOT,
    settings: Settings | None = None,
    apart: Scene | None = None,
) -> Cut:
    """Cut a placed scene into at most `count` layers for a display; few scene depths give fewer layers.

    `slot` is a layer's maximum size in texels. `apart` is a scene of separately
    moving objects, which becomes one layer at its own depth.

    Raises InputError for counts and sizes out of range, and scenes that no eye sees.
    """
    count = whole_number("count", count, 1 if apart is None else 2, MAX_LAYERS)
    check_slot(slot)
    reach = reach_of(display)
    settings = Settings(samples=16) if settings is None else settings
    parts = [] if apart is None else [(_find_slabs(apart, 1, reach, settings)[0], apart)]
    parts += [(slab, scene) for slab in _find_slabs(scene, count - len(parts), reach, settings)]
    parts.sort(key=lambda part: -part[0].depth_mm)

    entries, background, before = [], np.zeros(3), None
    for slab, part in parts:
        view = _render_slab(part, slab, before if part is scene else None, display, reach, slot, settings)
        before = slab if part is scene else before
        if view is None:
            continue
        area, colour, opacity = view
        entries.append((*layer_of(area, colour, opacity), slab, part is apart))
        # The background continues the last layer with its mean colour.
        background = (opacity[..., None] * colour).sum(axis=(0, 1)) / max(opacity.sum(), 1e-9)
    if not entries:
        raise InputError(f"{scene.path}: all layers are empty; place the scene with --fit")
    layers, errors, slabs, moves = zip(*entries, strict=True)
    stack = LayerStack(layers, np.clip(background, 0.0, 1.0))
    return Cut(stack, slabs, errors, moves.index(True) if True in moves else None)


def layer_of(area: Area, light: Floats, opacity: Floats) -> tuple[Layer, float]:
    """Return a layer that shows a picture in an area, and its palette's PSNR, dB."""
    texels, palette, error_db = quantise(rgba_of(light, opacity))
    return Layer(texels, palette, area.depth_mm, area.matrix(texels.shape[1], texels.shape[0])), error_db


def _find_slabs(scene: Scene, count: int, reach: Reach, settings: Settings) -> list[Slab]:
    (x, y, z), aside, window = reach.eye_mm, reach.aside_mm, reach.area(0.0)
    eyes = [(x + a * aside, y + b * aside, z) for a, b in ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1))]
    trial = replace(settings, samples=TRIAL_SAMPLES)
    views = [seen_depths(scene, window, eye, DEPTH_RAYS, trial) for eye in eyes]
    depths, detail = (np.concatenate(values) for values in zip(*views, strict=True))
    if not depths.size:
        raise input_error(scene.path, "no eye sees any surface of the scene", "place the scene with --fit")
    return slabs_of(depths, detail, count, z, min(scene.depth_range_mm[1], z))


def _render_slab(
    scene: Scene, slab: Slab, before: Slab | None, display: Display, reach: Reach, slot: Size, settings: Settings
) -> tuple[Area, Floats, Floats] | None:
    """Render a slab; return its area, colour and opacity, or None if rays meet no surface."""
    depth = math.inf if math.isinf(slab.depth_mm) else slab.depth_mm
    # Add a texel on each side, because bilinear textures fade in the outer half texel.
    reached = reach.area(depth)
    texel = max(finest_texel(depth, display), *np.divide(reached.size, slot).tolist())
    reached = Area(depth, reached.x0 - texel, reached.y0 - texel, reached.x1 + texel, reached.y1 + texel)
    between = slab.front_mm, slab.back_mm
    trial = peel(scene, reached, reach.eye_mm, between, TRIAL_RAYS, replace(settings, samples=TRIAL_SAMPLES))
    mask = trial.coverage > 0.0
    if not mask.any():
        return None

    hidden = 0.0
    if before is not None and not math.isinf(depth):
        # `hidden` is the width, mm, that eyes see behind a nearer edge, plus `EDGE_TEXELS` texels.
        hidden = reach.aside_mm * (before.depth_mm - depth) / (reach.eye_mm[2] - before.depth_mm)
        hidden += EDGE_TEXELS * texel

    area = reached.cells(mask, hidden)
    size = texels_for(area, display, slot)
    view = peel(scene, area, reach.eye_mm, between, size, settings)
    if hidden > 0.0 and before is not None:
        under = peel(scene, area, reach.eye_mm, (before.front_mm, slab.front_mm), size, settings)
        view = _extend_slice(view, under, (area.size[1] / size[1], area.size[0] / size[0]), hidden)
    colour = view.light / np.maximum(view.coverage, 1e-9)[..., None]
    return area, np.clip(colour, 0.0, 1.0), np.clip(view.coverage, 0.0, 1.0)


def _extend_slice(view: Slice, under: Slice, texel_mm: Pair, hidden_mm: float) -> Slice:
    """Extend a slab's picture by at most `hidden_mm` below the nearer slab, with its texels `under`."""
    from scipy.ndimage import distance_transform_edt  # scipy loads slowly

    own = view.coverage > COVERED
    if not own.any():
        return view
    near = distance_transform_edt(~own, sampling=texel_mm) <= hidden_mm
    # A surface may cover parts of a texel in both slabs: the parts add up.
    added = np.where(near, np.minimum(1.0 - view.coverage, under.coverage), 0.0)
    share = added / np.maximum(under.coverage, 1e-9)
    return Slice(view.light + share[..., None] * under.light, view.coverage + added)


def texels_for(area: Area, display: Display, slot: Size) -> Size:
    """Return an area's texels across and down: at most `slot`, no finer than `finest_texel`."""
    width, height = (max(2, math.ceil(side / finest_texel(area.depth_mm, display))) for side in area.size)
    return min(slot[0], width), min(slot[1], height)


def finest_texel(depth_mm: float, display: Display) -> float:
    """Return the spacing of rays at a depth (mm, at least a pixel); at infinity, the spacing of their slopes."""
    pixel = display.panel.coarsest_mm
    slope = pixel / display.aperture_distance_mm
    return slope if math.isinf(depth_mm) else max(pixel, abs(depth_mm) * slope)


@dataclass(frozen=True)
class Area:
    """A rectangle at z = `depth_mm`, in mm, or in slopes of rays at infinity; (x1, y1) is top right."""

    depth_mm: float
    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size(self) -> Pair:
        """Width and height of the rectangle."""
        return self.x1 - self.x0, self.y1 - self.y0

    def matrix(self, width: int, height: int) -> Floats:
        """Return the matrix (2, 3) from (x, y, 1) to texels of a texture that covers the area."""
        a, d = width / self.size[0], -height / self.size[1]
        return np.array([[a, 0.0, -a * self.x0], [0.0, d, -d * self.y1]])

    def cells(self, mask: Bools, margin: float) -> Area:
        """Return the area of a mask's true cells, plus a margin and a cell on each side."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        across, down = self.size[0] / mask.shape[1], self.size[1] / mask.shape[0]
        return Area(
            self.depth_mm,
            max(self.x0, self.x0 + columns[0] * across - (margin + across)),
            max(self.y0, self.y1 - (rows[-1] + 1) * down - (margin + down)),
            min(self.x1, self.x0 + (columns[-1] + 1) * across + (margin + across)),
            min(self.y1, self.y1 - rows[0] * down + (margin + down)),
        )


class Slice(NamedTuple):
    """An eye's view of a slab: light times coverage (height, width, 3), and coverage (height, width)."""

    light: Floats
    coverage: Floats


def peel(scene: Scene, area: Area, eye_mm: Point3, between_mm: Pair, size: Size, settings: Settings) -> Slice:
    """Render the surfaces between two depths (front, back), as an eye sees them in an area.

    `size` is (width, height). A back of -infinity includes the scene's surroundings.
    """
    (width, height), (front, back), samples = size, between_mm, settings.samples
    integrator = make_integrator(scene, settings)
    surroundings = math.isinf(back) and scene.mitsuba.environment() is not None
    means = np.empty((height * width, 4))
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
            sums = np.asarray(dr.block_reduce(dr.ReduceOp.Add, values, samples), np.float64)
            means[first : first + count, k] = sums / samples
    light, coverage = np.split(means.reshape(height, width, 4), [3], axis=2)
    return Slice(light, coverage[..., 0])


def seen_depths(scene: Scene, area: Area, eye_mm: Point3, size: Size, settings: Settings) -> tuple[Floats, Floats]:
    """Return the depths (N,) that an eye sees in an area, -infinity for surroundings, and the detail (N,).

    Detail is the squared colour difference of two neighbouring texels. It counts for
    the nearer texel, whose surface hides farther surfaces behind its edge.
    """
    front, (width, height) = min(scene.depth_range_mm[1], eye_mm[2]), size
    index = dr.arange(mi.UInt32, width * height)
    lines = _lines(area, eye_mm, size, index, dr.zeros(mi.UInt32, width * height), replace(settings, samples=1))
    _, valid, z = first_hit(scene, lines, front)
    depths = np.where(np.asarray(valid), np.asarray(z, np.float64), -np.inf).reshape(height, width)
    colour = np.sqrt(np.clip(peel(scene, area, eye_mm, (front, -math.inf), size, settings).light, 0.0, 1.0))
    detail = np.zeros_like(depths)
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        square = ((colour[other] - colour[one]) ** 2).sum(axis=-1)
        nearer = depths[one] > depths[other]
        detail[one] += np.where(nearer, square, 0.0)
        detail[other] += np.where(nearer, 0.0, square)
    there = np.isfinite(depths) | (scene.mitsuba.environment() is not None)
    return depths[there], detail[there]


def _lines(area: Area, eye_mm: Point3, size: Size, texel: Arr, sample: Arr, settings: Settings) -> Lines:
    # Lines run from points in texels to an eye. For a sky, lines start at the origin.
    columns = dr.opaque(mi.UInt32, size[0])
    places = area.x0, area.y1, area.size[0] / size[0], area.size[1] / size[1]
    x0, y1, across, down = (dr.opaque(mi.Float, value) for value in places)
    row = texel // columns
    s, t = points_in_pixel(texel, sample, settings.samples, settings.seed)
    x = x0 + (mi.Float(texel - row * columns) + s) * across
    y = y1 - (mi.Float(row) + t) * down
    if math.isinf(area.depth_mm):
        ray = dr.normalize(mi.Vector3f(x, y, 1.0))
        return Lines((mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)), (ray.x, ray.y, ray.z), mi.Bool(True))
    eye_x, eye_y, eye_z, depth = (dr.opaque(mi.Float, value) for value in (*eye_mm, area.depth_mm))
    ray = dr.normalize(mi.Vector3f(eye_x - x, eye_y - y, eye_z - depth))
    return Lines((x, y, depth), (ray.x, ray.y, ray.z), mi.Bool(True))


#: Bins in the histogram of disparities.
BINS = 512
#: Weight of a point without detail, as a fraction of the mean detail.
PLAIN = 0.05
#: Minimum width of a disparity bin: 0.001 mm of shift for an eye that moves 100 mm.
FINEST = 1e-5
#: Disparity at infinity.
SKY = -1.0


class Slab(NamedTuple):
    """The part of a scene, from z = `front_mm` to `back_mm`, that a layer shows at `depth_mm`."""

    front_mm: float
    back_mm: float
    depth_mm: float


def disparity(z_mm: npt.ArrayLike, eye_mm: float) -> Floats:
    """Return the disparity of depths z for an eye at distance `eye_mm`; -1 at z = -infinity."""
    z = np.asarray(z_mm, np.float64)
    far = np.isneginf(z)
    near = np.where(far, 0.0, z)
    return np.where(far, SKY, near / (eye_mm - near))


def depth_of(u: float, eye_mm: float) -> float:
    """Return the depth for a disparity: the inverse of `disparity`."""
    return -math.inf if u <= SKY else eye_mm * u / (1.0 + u)


def slabs_of(z_mm: Floats, detail: Floats, count: int, eye_mm: float, front_mm: float) -> list[Slab]:
    """Return at most `count` slabs, front to back, for depths (N,) seen by eyes at distance `eye_mm`.

    `detail` (N,) is the picture's squared gradient at the points of these depths.
    Surroundings, at depth -infinity, have their own slab or share the last slab. The
    first slab starts at `front_mm`. The last slab ends at -infinity.
    """
    u = disparity(z_mm, eye_mm)
    near = u[u > SKY]
    low, high = (float(near.min()), float(near.max())) if near.size else (0.0, 0.0)
    step = max((high - low) / (BINS - 1), FINEST)
    # Bin 0 contains the sky. Each bin above 0 is represented by its mean disparity.
    place = np.where(u > SKY, 1 + np.rint((u - low) / step).astype(np.int64), 0)
    mean_detail = float(detail.mean())
    share = detail + (PLAIN * mean_detail if mean_detail > 0.0 else 1.0)
    weight, total = (np.bincount(place, values, BINS + 1) for values in (share, share * u))
    used = np.flatnonzero(weight)[::-1]  # bins from front to back
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
    """Split ordered values into `count` runs of minimum weighted variance; return the runs' ends."""
    n = len(values)
    sums = [np.concatenate([[0.0], np.cumsum(weights * values**power)]) for power in range(3)]
    # `runs[end - 1][start]` is the weighted squared deviation of values[start:end].
    runs = []
    for end in range(1, n + 1):
        w, m, q = (one[end] - one[:end] for one in sums)
        runs.append(np.maximum(q - m * m / w, 0.0))
    best = np.array([run[0] for run in runs])
    starts = []
    for _ in range(count - 1):
        start, cost = np.zeros(n, np.int64), np.full(n, np.inf)
        for last in range(1, n):
            through = best[:last] + runs[last][1:]
            start[last] = 1 + int(np.argmin(through))
            cost[last] = through.min()
        starts.append(start)
        best = cost
    ends = [n]
    for start in reversed(starts):
        ends.append(int(start[ends[-1] - 1]))
    return ends[::-1]
