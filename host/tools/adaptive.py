"""What samples could save that go where the noise is: by each pixel's, and each tile's, own noise, known or estimated.

A pixel of n samples has the mean squared error v / n^p, with p of the whole picture: 1 for samples at random, more for
even ones. The fewest samples for a mean error are those with n in proportion to v^(1 / (1 + p)) (Lagrange), but each
pixel needs a few before its noise is known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from lippmann.base.tones import encode
from lippmann.conformance.engine_speeds import middle
from lippmann.display.description import Display, load_display
from lippmann.rendering.renderer import Settings, render_rays
from lippmann.rendering.samples import TILE_PX
from lippmann.rendering.sources import display_source
from lippmann.scenes.scene import Scene, load_scene

#: Display and side of its middle that is rendered, px; scenes.
DISPLAY, SIDE_PX, SCENES = "paper-square", 480, ("fish", "chart", "knot")
#: Samples of a pilot picture, the fewest that are spread; pilots from which the true error is known.
PILOT, PICTURES = 2, 16
#: Samples of a finer picture, which shows how fast the error falls, and of the reference.
FINE, REFERENCE = 16, 256
#: Samples a pixel of the even picture whose noise is to be met.
SAMPLES = (4, 8, 16)
Field = npt.NDArray[np.float64]


def measure(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield `scene`, `samples`, and by how much fewer samples, on average, meet the same noise: factors.

    `pixel`: each pixel's error is known; `tile`: each tile's is; `found`: each pixel's is estimated from two pilots,
    averaged over its neighbours, with all pilots counted. `power` is p.
    """
    display = middle(load_display(scenes / f"displays/{DISPLAY}.toml"), SIDE_PX)
    for name in SCENES:
        scene = load_scene(scenes / f"{name}/{name}.xml")
        exact = _encoded(scene, display, seed + PICTURES, REFERENCE)
        pictures = [_encoded(scene, display, seed + k, PILOT) for k in range(PICTURES)]
        of_pilots = np.mean([_apart(picture, exact) for picture in pictures], axis=0)
        of_fine = _apart(_encoded(scene, display, seed, FINE), exact)
        power = math.log(of_pilots.mean() / of_fine.mean()) / math.log(FINE / PILOT)
        true = of_pilots * PILOT**power
        known = {"pixel": true, "tile": _of_tiles(true)}
        pilots = _smoothed(_apart(pictures[0], pictures[1]))
        for samples in SAMPLES:
            factors = {
                way: samples / samples_needed(true, guess, samples, PILOT, power) for way, guess in known.items()
            }
            factors["found"] = samples / samples_needed(true, pilots, samples, 2 * PILOT, power)
            yield {"scene": name, "samples": samples, "power": power, **factors}


def samples_needed(true: Field, guess: Field, samples: float, least: float, power: float) -> float:
    """Return the mean number of samples that meets the mean error, true / n^power, of `samples` everywhere.

    They are shared out by a guess of the error, and each pixel has `least` at least.
    """
    wanted, share = true.mean() / samples**power, guess ** (1.0 / (1.0 + power))

    def numbers(factor: float) -> Field:
        return np.maximum(least, factor * share)

    def error(factor: float) -> float:
        return float((true / numbers(factor) ** power).mean())

    if error(0.0) <= wanted:
        return least
    low, high = 0.0, 1.0
    while error(high) > wanted:
        high *= 2.0
        if high > 1e12:  # some noise that the guess denies: nothing but more samples for all helps
            return samples
    for _ in range(60):
        factor = 0.5 * (low + high)
        low, high = (factor, high) if error(factor) > wanted else (low, factor)
    return float(min(numbers(high).mean(), samples))


def _encoded(scene: Scene, display: Display, seed: int, samples: int) -> Field:
    # Plain means, so that one law of noise holds for pilots and for pictures of many samples.
    source = replace(display_source(display, "exact", samples), owner=None)
    rendered = render_rays(scene, source, Settings(samples, seed=seed, shading="each"))
    return encode(rendered.radiance, "srgb").astype(np.float64)


def _apart(one: Field, other: Field) -> Field:
    """Return the squared difference of each pixel, of all colours together."""
    return np.asarray(((one - other) ** 2).sum(axis=-1))


def _of_tiles(values: Field) -> Field:
    """Return each pixel's mean over its tile."""
    rows, columns = (length // TILE_PX for length in values.shape)
    tiles = values.reshape(rows, TILE_PX, columns, TILE_PX).mean(axis=(1, 3))
    return np.kron(tiles, np.ones((TILE_PX, TILE_PX)))


def _smoothed(values: Field) -> Field:
    """Return each pixel's mean over itself and its eight neighbours."""
    from scipy.ndimage import uniform_filter

    # Its running sums round to less than 0.
    return np.asarray(np.maximum(uniform_filter(values, 3, mode="nearest"), 0.0))
