"""Photographs of patterns on a display, as a camera takes them: a folder of pictures with the patterns' names.

What each pixel of the camera sees of the panel is a sparse matrix, with which each photograph is one multiplication.
All rays of the camera's pixels, spread over pixel and pupil, are traced once, against the light, as the observer does.
What goes wrong on a bench and stands in no model is added: a bowed array, dust, dead pixels, reflections, a moved
camera.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import ndimage, sparse

from lippmann.base import interrupts
from lippmann.base.files import make_folder, replacing
from lippmann.base.tones import decode
from lippmann.calibration.simulated_camera import Camera, Light, Point, Sensor
from lippmann.display.description import Display, Panel
from lippmann.display.subpixels import layout_of
from lippmann.errors import input_error
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.rays import Engine, Floats, Hits, Indices, Status, gets_through
from lippmann.optics.system import System
from lippmann.optics.trace import trace_to_panel

#: Rays traced at once.
CHUNK_RAYS = 1 << 20
#: Colours of a photograph.
COLOURS = 3
#: Traces origins (N, 3) and unit directions (N, 3) to the panel.
Tracer = Callable[[Floats, Floats], Hits]


@dataclass(frozen=True)
class Sight:
    """Shares of the light of panel pixels (columns) in camera pixels (rows), one matrix, or one for each colour.

    `brightness` (height, width) is what the camera's lens leaves of an even light.
    """

    matrices: tuple[Any, ...]
    brightness: Floats

    def photograph(self, light: Light) -> Light:
        """Return the picture of a panel's linear light; both are (height, width), or (height, width, 3) in colour."""
        grey = light.ndim == 2 and len(self.matrices) == 1
        planes = [light] if grey else [light[..., k] if light.ndim == 3 else light for k in range(COLOURS)]
        seen = [self.matrices[k % len(self.matrices)] @ plane.ravel() for k, plane in enumerate(planes)]
        pictures = [self.brightness * one.reshape(self.brightness.shape) for one in seen]
        return np.asarray(pictures[0] if grey else np.stack(pictures, axis=2), np.float32)


def gathered(display: Display, camera: Camera, seen: Iterator[tuple[int, int, Indices, Floats, Any]]) -> Sight:
    """Return the sight from samples, given in bands of whole rows of the picture.

    Each band is its first and last camera pixel, then of each sample the camera pixel, the panel's coordinates (N, 2),
    and whether it sees the panel. Samples that do not see it count as dark.
    """
    panel, layout = display.panel, layout_of(display.panel.subpixels)
    parts: list[list[Any]] = [[] for _ in range(1 if layout is None else COLOURS)]
    for first, last, pixel, place, sees in seen:
        rows, count = pixel - first, last - first
        share = (1.0 / np.maximum(np.bincount(rows, minlength=count), 1)).astype(np.float32)[rows] * sees
        column = np.clip(np.floor(place[:, 0]), 0, panel.width_px - 1).astype(np.int64)
        row = np.clip(np.floor(place[:, 1]), 0, panel.height_px - 1).astype(np.int64)
        weights = [share] if layout is None else [np.zeros_like(share) for _ in range(COLOURS)]
        if layout is not None:
            for k, gain, inside in layout.emitters(NumpyBackend(), place[:, 0], place[:, 1]):
                # A white sub-pixel, which shows what the colours have in common, is left dark.
                if k < COLOURS:
                    weights[k] += np.where(inside, gain * share, 0.0)
        for part, weight in zip(parts, weights, strict=True):
            lit = weight > 0.0
            at = rows[lit], (row * panel.width_px + column)[lit]
            shape = count, panel.width_px * panel.height_px
            part.append(sparse.coo_matrix((weight[lit].astype(np.float32), at), shape=shape).tocsr())
    return Sight(tuple(sparse.vstack(part, format="csr") for part in parts), camera.brightness())


def sight_of(display: Display, camera: Camera, samples: int = 3, seed: int = 0, tracer: Tracer | None = None) -> Sight:
    """Trace what a camera sees of a display.

    `samples` is the number of rays across a camera pixel, and down. `tracer` traces them; None: `traced`, the exact
    lenslets.
    """
    rng = np.random.default_rng((seed, 0x51))
    trace = tracer or traced(display)
    rows_at_once = max(1, CHUNK_RAYS // (camera.width_px * samples * samples))

    def bands() -> Iterator[tuple[int, int, Indices, Floats, Any]]:
        for first in range(0, camera.height_px, rows_at_once):
            interrupts.check()
            last = min(first + rows_at_once, camera.height_px)
            shape = (last - first, camera.width_px, samples, samples)
            row, column, a, b = (axis.ravel() for axis in np.indices(shape))
            u = column + (a + rng.random(len(a))) / samples
            v = first + row + (b + rng.random(len(b))) / samples
            if camera.blur_px > 0.0:
                u += camera.blur_px * rng.standard_normal(len(u))
                v += camera.blur_px * rng.standard_normal(len(v))
            radius, turn = np.sqrt(rng.random(len(a))), 2.0 * np.pi * rng.random(len(a))
            hits = trace(*camera.rays(u, v, (radius * np.cos(turn), radius * np.sin(turn))))
            pixel = (first + row) * camera.width_px + column
            yield first * camera.width_px, last * camera.width_px, pixel, hits.pixel, gets_through(hits.status)

    return gathered(display, camera, bands())


def traced(display: Display, engine: Engine = "fast") -> Tracer:
    """Return the tracer through a display's exact lenslets."""
    return lambda origin, direction: trace_to_panel(display, origin, direction, engine=engine)


#: Odd constants that spread lenslets' indices over 64 bits (Steele, Lea and Flood, "Fast splittable pseudorandom
#: number generators", 2014: the finaliser of SplitMix64).
SPREAD = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
#: Number and size (share of the picture's width) of the patches that a reflection is made of.
PATCHES, PATCH = 6, 0.2
#: Radius of the bright spot, as a share of the picture's width.
SPOT = 0.02


@dataclass(frozen=True)
class Disturbances:
    """Disturbances of a display on a bench, and of its photographs. The defaults are none.

    `bow_mm` is how much farther from the panel the array is at the panel's corners than in the middle; it grows with
    the square of the distance. `dead_pixels`, `hidden_lenslets` (dust) and `outliers` (camera pixels with arbitrary
    values in every photograph) are shares. `reflection` is the light of a lamp's reflection, and `bright_spot` that of
    its mirror image, as shares of the panel's white. `blur_px` is the deviation of a Gaussian blur in the photograph.
    `moved_mm` moves the camera before the second half of the photographs. `seed` chooses the pixels and lenslets of the
    display, which are the same for each position of the camera.
    """

    bow_mm: float = 0.0
    dead_pixels: float = 0.0
    hidden_lenslets: float = 0.0
    reflection: float = 0.0
    bright_spot: float = 0.0
    outliers: float = 0.0
    blur_px: float = 0.0
    moved_mm: Point = (0.0, 0.0, 0.0)
    seed: int = 0

    def after_move(self, camera: Camera) -> Camera:
        """Return the camera as it stands for the second half of the photographs."""
        x, y, z = np.add(camera.position_mm, self.moved_mm).tolist()
        aim = np.add(camera.look_at_mm, self.moved_mm).tolist()
        return replace(camera, position_mm=(x, y, z), look_at_mm=(aim[0], aim[1], aim[2]))


def disturbed(display: Display, disturbances: Disturbances, engine: Engine = "fast") -> Tracer:
    """Return the tracer through the array as it is: bowed, and some of its lenslets hidden."""
    deeper = display.misaligned(gap_mm=1.0)
    front = System.of(display).last_face_mm

    def trace(origin: Floats, direction: Floats) -> Hits:
        if disturbances.bow_mm != 0.0:
            # A raised lenslet: the ray comes from as much lower, and goes as much farther, on a straight line.
            t = (front - origin[:, 2]) / direction[:, 2]
            height = bow_height(display, disturbances.bow_mm, origin[:, :2] + t[:, None] * direction[:, :2])
            origin = origin - np.stack([0.0 * height, 0.0 * height, height], axis=1)
            hits = trace_to_panel(display, origin, direction, engine=engine)
            farther = trace_to_panel(deeper, origin, direction, engine=engine)
            hits = replace(hits, pixel=hits.pixel + height[:, None] * (farther.pixel - hits.pixel))
        else:
            hits = trace_to_panel(display, origin, direction, engine=engine)
        if disturbances.hidden_lenslets > 0.0:
            lost = hidden(hits.lenslet, disturbances.hidden_lenslets, disturbances.seed)
            hits = replace(hits, status=np.where(lost, np.uint8(Status.BLOCKED), hits.status))
        return hits

    return trace


def bow_height(display: Display, bow_mm: float, place_mm: Floats) -> Floats:
    """Return how far a bowed array is raised at places (N, 2), mm from the panel's centre."""
    reach = math.hypot(0.5 * display.panel.width_mm, 0.5 * display.panel.height_mm)
    return np.asarray(bow_mm * (place_mm**2).sum(axis=1) / reach**2)


def hidden(lenslet: Indices, share: float, seed: int) -> npt.NDArray[np.bool_]:
    """Tell which lenslets (N, 2) are hidden: this share of them, the same for the same seed."""
    with np.errstate(over="ignore"):
        i, j = lenslet.T.astype(np.uint64)
        word = (i * np.uint64(SPREAD[0])) ^ (j * np.uint64(SPREAD[1])) ^ np.uint64(seed * SPREAD[2] % 2**64)
        for shift, factor in zip((30, 27), SPREAD[1:], strict=True):
            word = (word ^ (word >> np.uint64(shift))) * np.uint64(factor)
        word ^= word >> np.uint64(31)
    return np.asarray(word.astype(np.float64) < share * 2.0**64)


def without_dead(light: Light, share: float, seed: int) -> Light:
    """Return a panel's light without its dead pixels, which stay black."""
    dead = np.random.default_rng((seed, 0xDEAD)).random(light.shape[:2]) < share
    return np.where(dead if light.ndim == 2 else dead[..., None], np.float32(0.0), light)


def reflected(shape: tuple[int, int], reflection: float, bright_spot: float, seed: int) -> Light:
    """Return the light that a lamp adds to each photograph, (height, width): smooth patches, and a spot."""
    rng = np.random.default_rng((seed, 0x1A3B))
    height, width = shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    added = np.zeros(shape, np.float32)

    def patch(radius: float) -> Light:
        x, y = rng.random() * width, rng.random() * height
        return np.asarray(np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / (radius * width) ** 2), np.float32)

    for _ in range(PATCHES):
        added += patch(PATCH) * np.float32(rng.random())
    added *= np.float32(reflection / max(float(added.max()), 1e-30))
    return added + np.float32(bright_spot) * patch(SPOT)


def blurred(picture: Light, deviation_px: float) -> Light:
    """Return a picture with a Gaussian blur."""
    sigma = (deviation_px, deviation_px, *[0.0] * (picture.ndim - 2))
    return np.asarray(ndimage.gaussian_filter(picture, sigma))


def with_outliers(
    values: npt.NDArray[np.unsignedinteger[Any]], share: float, seed: int, rng: np.random.Generator
) -> npt.NDArray[np.unsignedinteger[Any]]:
    """Return a photograph in which this share of the pixels, the same in all photographs, has arbitrary values."""
    chosen = np.random.default_rng((seed, 0x0DD)).random(values.shape[:2]) < share
    noise = rng.integers(0, np.iinfo(values.dtype).max, values.shape, values.dtype, endpoint=True)
    return np.where(chosen if values.ndim == 2 else chosen[..., None], noise, values)


#: Computes what a camera sees of a display.
Look = Callable[[Display, Camera], Sight]


def photograph_folder(
    display: Display,
    camera: Camera,
    patterns: str | Path,
    output: str | Path,
    seed: int = 0,
    sensor: Sensor = Sensor(),  # noqa: B008 (frozen)
    disturbances: Disturbances = Disturbances(),
    samples: int = 3,
    look: Look | None = None,
) -> list[Path]:
    """Photograph a folder of patterns on a display as built, and write the photographs under the patterns' names.

    Parameters
    ----------
    display
        The display as built; its panel shows the patterns.
    camera
        Where the camera stands and what it is. See `lippmann.calibration.simulated_camera.framed`.
    patterns
        Folder of PNG files of the panel's size, whose names begin with the order in which they are shown.
    output
        Folder for the photographs, which is made when missing, with its parents.
    seed
        Of the rays, the noise, reflections and outliers.
    sensor, disturbances
        Of the camera, and of the bench.
    samples
        Rays across each camera pixel, and down.
    look
        Computes what the camera sees: `simulated_solids.look_at_solids` by POV-Ray. `None` is our own tracer.

    Returns
    -------
    list of Path
        The photographs, in the patterns' order.

    Raises
    ------
    InputError
        When there are no patterns, one is not of the panel's size, or a photograph cannot be written.
    """
    names, output = pattern_files(patterns), Path(output)

    def see(camera: Camera) -> Sight:
        if look is not None:
            return look(display, camera)
        return sight_of(display, camera, samples, seed, disturbed(display, disturbances))

    before = after = see(camera)
    if any(disturbances.moved_mm):
        after = see(disturbances.after_move(camera))
    rng = np.random.default_rng((seed, 0xCA3))
    shape = camera.height_px, camera.width_px
    added = reflected(shape, disturbances.reflection, disturbances.bright_spot, seed)
    white = before.photograph(np.ones((display.panel.height_px, display.panel.width_px), np.float32))
    gain = sensor.gain(white)
    # The camera's light for the panel's white: that of the exposure.
    added *= sensor.exposure / max(gain, 1e-30)
    written = []
    make_folder(output)
    for number, name in enumerate(names):
        interrupts.check()
        light = without_dead(panel_light(name, display.panel), disturbances.dead_pixels, disturbances.seed)
        picture = (before if 2 * number < len(names) else after).photograph(light)
        picture = picture + (added if picture.ndim == 2 else added[..., None])
        if disturbances.blur_px > 0.0:
            picture = blurred(picture, disturbances.blur_px)
        values = sensor.values(picture, gain, rng)
        if disturbances.outliers > 0.0:
            values = with_outliers(values, disturbances.outliers, seed, rng)
        written.append(_save(output / name.name, values))
    return written


def pattern_files(patterns: str | Path) -> list[Path]:
    """Return the PNG files of a folder of patterns, in order; InputError when there are none."""
    found = sorted(Path(patterns).glob("*.png"))
    if not found:
        raise input_error(str(patterns), "holds no patterns", "write them: lippmann calibrate patterns")
    return found


def panel_light(path: Path, panel: Panel) -> Light:
    """Return the linear light of a panel that shows a PNG file's values, (height, width), or with 3 colours."""
    with Image.open(path) as picture:
        if picture.size != (panel.width_px, panel.height_px):
            size = f"{picture.size[0]} x {picture.size[1]}"
            what = f"is {size} pixels, the panel {panel.width_px} x {panel.height_px}"
            raise input_error(str(path), what, "write patterns for this display")
        values = np.asarray(picture if picture.mode in ("L", "RGB") or "I" in picture.mode else picture.convert("RGB"))
    scale = 255.0 if values.dtype == np.uint8 else 65535.0
    if values.ndim == 3 and (values == values[..., :1]).all():
        values = values[..., 0]
    light = decode(values / np.float32(scale), panel.transfer)
    return np.asarray(panel.black + (1.0 - panel.black) * light, np.float32)


def _save(path: Path, values: npt.NDArray[np.unsignedinteger[Any]]) -> Path:
    with replacing(path) as partial:
        # Noise has no runs to be found: Huffman's code alone is as small, and quicker.
        Image.fromarray(values).save(partial, "PNG", compress_level=1, compress_type=zlib.Z_HUFFMAN_ONLY)
    return path
