"""Simulate a camera's photographs of patterns on a display.

Rays are traced once from all camera pixels to the panel. The result is a sparse matrix
from panel pixels to camera pixels. Matrix times pattern light gives a photograph.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import sparse

from lippmann.base import interrupts
from lippmann.base.files import make_folder, replacing
from lippmann.base.tones import decode
from lippmann.calibration.simulated_camera import Camera, CameraValues, Light, Sensor
from lippmann.display.description import Display, Panel
from lippmann.display.subpixels import layout_of
from lippmann.errors import input_error
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.rays import Bools, Floats, Hits, Indices, gets_through
from lippmann.optics.trace import trace_to_panel

#: Maximum number of rays traced at once.
CHUNK_RAYS = 1 << 20
COLOURS = 3
#: Function that traces rays with origins (N, 3) and unit directions (N, 3) to the panel.
Tracer = Callable[[Floats, Floats], Hits]
#: Samples of a band of camera rows: first camera pixel, pixel after the last, and each
#: sample's camera pixel, panel coordinates (N, 2), and whether it sees the panel.
Band = tuple[int, int, Indices, Floats, Bools]


@dataclass(frozen=True)
class Projection:
    """Matrices that map light of panel pixels (columns) to light of camera pixels (rows)."""

    matrices: tuple[sparse.csr_matrix, ...]  # One matrix, or one per colour.
    brightness: Floats  # The camera's relative illumination (height, width).

    def photograph(self, light: Light) -> Light:
        """Return the camera's light for a panel's light, each (height, width) or (height, width, 3)."""
        grey = light.ndim == 2 and len(self.matrices) == 1
        planes = [light]
        if not grey:
            planes = [light[..., k] if light.ndim == 3 else light for k in range(COLOURS)]
        received = [self.matrices[k % len(self.matrices)] @ plane.ravel() for k, plane in enumerate(planes)]
        pictures = [self.brightness * one.reshape(self.brightness.shape) for one in received]
        return np.asarray(pictures[0] if grey else np.stack(pictures, axis=2), np.float32)


def collect_projection(display: Display, camera: Camera, bands: Iterator[Band]) -> Projection:
    """Build the projection from bands of samples; samples that miss the panel are dark."""
    panel, layout = display.panel, layout_of(display.panel.subpixels)
    parts: list[list[sparse.csr_matrix]] = [[] for _ in range(1 if layout is None else COLOURS)]
    for first, last, pixel, place, sees in bands:
        rows, count = pixel - first, last - first
        share = (1.0 / np.maximum(np.bincount(rows, minlength=count), 1)).astype(np.float32)[rows] * sees
        column = np.clip(np.floor(place[:, 0]), 0, panel.width_px - 1).astype(np.int64)
        row = np.clip(np.floor(place[:, 1]), 0, panel.height_px - 1).astype(np.int64)
        weights = [share] if layout is None else [np.zeros_like(share) for _ in range(COLOURS)]
        if layout is not None:
            for k, gain, inside in layout.emitters(NumpyBackend(), place[:, 0], place[:, 1]):
                # Ignore a white sub-pixel, which shows the part that all colours share.
                if k < COLOURS:
                    weights[k] += np.where(inside, gain * share, 0.0)
        for part, weight in zip(parts, weights, strict=True):
            lit = weight > 0.0
            at = rows[lit], (row * panel.width_px + column)[lit]
            shape = count, panel.width_px * panel.height_px
            part.append(sparse.coo_matrix((weight[lit].astype(np.float32), at), shape=shape).tocsr())
    return Projection(tuple(sparse.vstack(part, format="csr") for part in parts), camera.brightness())


def trace_projection(
    display: Display, camera: Camera, samples: int = 3, seed: int = 0, tracer: Tracer | None = None
) -> Projection:
    """Return the projection to a camera, with `samples` x `samples` rays per camera pixel.

    `tracer` traces the rays; the default tracer refracts them exactly at the lenslets.
    """
    rng = np.random.default_rng((seed, 0x51))
    trace = tracer or (lambda origin, direction: trace_to_panel(display, origin, direction, engine="fast"))
    rows_at_once = max(1, CHUNK_RAYS // (camera.width_px * samples * samples))

    def bands() -> Iterator[Band]:
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

    return collect_projection(display, camera, bands())


class Bench:
    """An undisturbed test bench of display and camera; subclasses add disturbances."""

    def project(self, display: Display, camera: Camera, samples: int, seed: int) -> Projection:
        """Return the projection from the display's panel to the camera."""
        return trace_projection(display, camera, samples, seed)

    def move(self, camera: Camera) -> Camera:
        """Return the camera that takes the second half of the photographs."""
        return camera

    def photograph(
        self, projection: Projection, light: Light, sensor: Sensor, gain: float, seed: int, rng: np.random.Generator
    ) -> CameraValues:
        """Return the camera values for a pattern's light."""
        return sensor.values(projection.photograph(light), gain, rng)


UNDISTURBED = Bench()


def photograph_folder(
    display: Display,
    camera: Camera,
    patterns: str | Path,
    output: str | Path,
    seed: int = 0,
    sensor: Sensor = Sensor(),  # noqa: B008 (frozen)
    bench: Bench = UNDISTURBED,
    samples: int = 3,
) -> list[Path]:
    """Simulate photographs of a folder of patterns on a display; return their paths in order.

    `patterns` contains PNG files of the panel's size, ordered by name. The photographs
    get the same names in `output`, which is created if missing. Each camera pixel has
    `samples` x `samples` rays. `seed` seeds rays, noise and disturbances.

    Raises InputError for missing patterns, a wrong size, or an unwritable folder.
    """
    output = Path(output)
    names = sorted(Path(patterns).glob("*.png"))
    if not names:
        raise input_error(patterns, "contains no PNG files", "write patterns with lippmann calibrate patterns")
    before = after = bench.project(display, camera, samples, seed)
    if bench.move(camera) != camera:
        after = bench.project(display, bench.move(camera), samples, seed)
    rng = np.random.default_rng((seed, 0xCA3))
    gain = sensor.gain(before.photograph(np.ones(display.panel.shape[:2], np.float32)))
    written = []
    make_folder(output)
    for number, name in enumerate(names):
        interrupts.check()
        projection = before if 2 * number < len(names) else after
        values = bench.photograph(projection, panel_light(name, display.panel), sensor, gain, seed, rng)
        written.append(output / name.name)
        with replacing(written[-1]) as partial:
            # Noise does not repeat, so Huffman coding alone gives the same size as Deflate.
            Image.fromarray(values).save(partial, "PNG", compress_level=1, compress_type=zlib.Z_HUFFMAN_ONLY)
    return written


def panel_light(path: Path, panel: Panel) -> Light:
    """Return the light (height, width) or (height, width, 3) of a panel that shows a PNG file."""
    with Image.open(path) as picture:
        if picture.size != panel.size_px:
            width, height = picture.size
            what = f"is {width} x {height} pixels, but the panel is {panel.width_px} x {panel.height_px}"
            raise input_error(path, what, "write patterns for this display")
        values = np.asarray(picture if picture.mode in ("L", "RGB") or "I" in picture.mode else picture.convert("RGB"))
    scale = 255.0 if values.dtype == np.uint8 else 65535.0
    if values.ndim == 3 and (values == values[..., :1]).all():
        values = values[..., 0]
    light = decode(values / np.float32(scale), panel.transfer)
    return np.asarray(panel.black + (1.0 - panel.black) * light, np.float32)
