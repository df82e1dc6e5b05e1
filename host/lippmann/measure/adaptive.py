"""What samples could save that go where the noise is: by each pixel's, and each tile's, own noise, known or estimated.

A picture of n samples has the noise v / n, with the variance v of a pixel's samples. The fewest samples for a mean
noise are those with n in proportion to the root of v (Lagrange), but each pixel needs a few before its noise is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lippmann.display import Display, load_display
from lippmann.images import encode
from lippmann.measure.pictures import middle
from lippmann.rendering.renderer import Settings, render_integral
from lippmann.rendering.samples import TILE_PX
from lippmann.rendering.scene import Scene, load_scene

#: Display and side of its middle that is rendered, px; scenes.
DISPLAY, SIDE_PX, SCENES = "paper-square", 480, ("fish", "chart", "knot")
#: Samples of a pilot picture, the fewest that are jittered; pictures from which the true variance is known.
PILOT, PICTURES = 2, 32
#: Samples a pixel of the even picture whose noise is to be met.
SAMPLES = (4, 8, 16)
Field = npt.NDArray[np.float64]


def measure(scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Yield `scene`, `samples`, and by how much fewer samples, on average, meet the same noise: factors.

    `pixel`: each pixel's variance is known; `tile`: each tile's is; `found`: each pixel's is estimated from two pilots,
    averaged over its neighbours, with all pilots counted.
    """
    display = middle(load_display(scenes / f"displays/{DISPLAY}.toml"), SIDE_PX)
    for name in SCENES:
        scene = load_scene(scenes / f"{name}/{name}.xml")
        pictures = np.stack([_encoded(scene, display, seed + k) for k in range(PICTURES)])
        true = PILOT * pictures.var(axis=0, ddof=1).sum(axis=-1)
        known = {"pixel": true, "tile": _of_tiles(true)}
        pilots = PILOT * 0.5 * ((pictures[0] - pictures[1]) ** 2).sum(axis=-1)
        for samples in SAMPLES:
            factors = {way: samples / samples_needed(true, guess, samples, PILOT) for way, guess in known.items()}
            factors["found"] = samples / samples_needed(true, _smoothed(pilots), samples, 2 * PILOT)
            yield {"scene": name, "samples": samples, **factors}


def samples_needed(true: Field, guess: Field, samples: float, least: float) -> float:
    """Return the mean number of samples that meets the noise of `samples` everywhere.

    They are in proportion to the root of a guess of the variance, and `least` at least.
    """
    wanted, root = true.mean() / samples, np.sqrt(guess)

    def numbers(factor: float) -> Field:
        return np.maximum(least, factor * root)

    if (true / least).mean() <= wanted:
        return least
    low, high = 0.0, 1.0
    while (true / numbers(high)).mean() > wanted:
        high *= 2.0
        if high > 1e12:  # some noise that the guess denies: nothing but more samples for all helps
            return samples
    for _ in range(60):
        factor = 0.5 * (low + high)
        low, high = (factor, high) if (true / numbers(factor)).mean() > wanted else (low, factor)
    return float(min(numbers(high).mean(), samples))


def _encoded(scene: Scene, display: Display, seed: int) -> Field:
    rendered = render_integral(scene, display, "exact", Settings(PILOT, seed=seed, shading="each"))
    return encode(rendered.radiance, "srgb").astype(np.float64)


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
