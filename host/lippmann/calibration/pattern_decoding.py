"""The panel point that each pixel of a camera sees, from the photographs of the patterns, read one after the other.

The phase of a pixel's light over the steps gives the point within a period, its Gray code the period. A pixel counts
when its light changes enough between black and white, is not clipped, follows the phase pictures' cosine, and has at
most one doubtful bit of Gray code in each direction: next to an edge of the code one bit is half lit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.progress import Progress
from lippmann.calibration.coded_patterns import Pattern, PatternSet
from lippmann.calibration.diagnostics import Samples, check_marks, check_samples
from lippmann.calibration.photographs import Light, Position, read_photograph
from lippmann.errors import input_error

#: Least light of white over black, as a share of the brightest twentieth's, of a pixel that counts.
LEAST_CONTRAST = 0.1
#: Least amplitude of the cosine, as a share of the black to white range's, of a pixel that counts.
LEAST_MODULATION = 0.2
#: A bit is doubtful when its light is this close to the middle between black and white, as a share of their range.
DOUBTFUL = 0.12
#: A photograph of white is too bright when this share of the panel is clipped, ...
MOST_CLIPPED = 0.2
#: ... and too dark when the brightest twentieth of its pixels has less light than this, white being 1.
LEAST_LIGHT = 0.02
#: Number of pixels whose values in all photographs are kept, to judge the photographs.
SAMPLES = 8000
SEED = 1908


@dataclass(frozen=True)
class Decoded:
    """What the camera's pixels see from one position.

    `photo_px` (N, 2) float32 are the pixels' centres, `panel_px` (N, 2) float32 the points (column, row) of the panel
    that they see; `shape` is the photographs' (height, width), `white` the photograph of white.
    """

    name: str
    shape: tuple[int, int]
    photo_px: npt.NDArray[np.float32]
    panel_px: npt.NDArray[np.float32]
    white: Light
    #: Median amplitude of the phase pictures, as a share of the black to white range's.
    modulation: float
    #: Shift of the camera between the first photograph and the last, pixels.
    moved_px: float


def decode_position(
    position: Position,
    patterns: PatternSet,
    pitch_px: float,
    shape: tuple[int, int] | None = None,
    progress: Progress = lambda done, total: None,
) -> Decoded:
    """Decode the photographs of one position; `pitch_px` is the lenslets' pitch in pixels of the panel.

    Raises InputError, with the photograph and a remedy, for photographs of different sizes or in another order, too
    bright, too dark, blurred, of a moved camera, of a panel partly out of view, or of other patterns.
    """
    marks, white_pattern, black_pattern, *coded, marks_again = patterns.patterns
    total, done = len(patterns.patterns), 0

    def light_of(pattern: Pattern) -> Light:
        nonlocal done, shape
        interrupts.check()
        light, at_limit = read_photograph(position.of(pattern), shape)
        shape = light.shape[0], light.shape[1]
        if pattern is white_pattern:
            clipped[:] = [at_limit]
        done += 1
        progress(done, total)
        return light

    clipped: list[npt.NDArray[np.bool_]] = []
    first_marks = light_of(marks)
    white, black = light_of(white_pattern), light_of(black_pattern)
    span, seen = _seen(position.of(white_pattern), white, black, clipped[0])

    middle = 0.5 * (white + black)
    inverse = np.float32(1.0) / np.maximum(span, np.float32(1e-6))
    code = [np.zeros(span.shape, np.uint16) for _ in (0, 1)]
    doubtful = [np.zeros(span.shape, np.uint8) for _ in (0, 1)]
    waves = [np.zeros((2, *span.shape), np.float32) for _ in (0, 1)]
    samples = Samples(patterns, position, *_chosen(seen), white, black)
    for pattern in coded:
        light = light_of(pattern)
        samples.add(pattern, light)
        share = (light - middle) * inverse
        if pattern.kind == "gray":
            code[pattern.axis] |= (share > 0.0).astype(np.uint16) << np.uint16(pattern.number)
            doubtful[pattern.axis] += abs(share) < DOUBTFUL
        else:
            angle = 2.0 * np.pi * pattern.number / patterns.steps
            waves[pattern.axis][0] += share * np.float32(np.cos(angle))
            waves[pattern.axis][1] += share * np.float32(np.sin(angle))
    moved = check_marks(position, marks, marks_again, first_marks, light_of(marks_again), seen)

    points, amplitudes = [], []
    for axis in (0, 1):
        real, imaginary = waves[axis]
        amplitude = np.hypot(real, imaginary) * np.float32(4.0 / patterns.steps)
        amplitudes.append(amplitude)
        seen &= (amplitude > LEAST_MODULATION) & (doubtful[axis] <= 1)
        points.append(patterns.point(np.arctan2(imaginary, real), patterns.half_of(code[axis])))
        seen &= (points[axis] >= 0.0) & (points[axis] <= patterns.sides_px[axis])
    modulation = check_samples(samples, pitch_px)
    row, column = np.nonzero(seen)
    if len(row) < 1000:
        what = f"only {len(row)} pixels of the photographs see the patterns"
        raise input_error(position.name, what, "come nearer, focus on the array, and darken the room")
    photo = np.stack([column + np.float32(0.5), row + np.float32(0.5)], axis=1).astype(np.float32)
    panel = np.stack([points[0][seen], points[1][seen]], axis=1).astype(np.float32)
    return Decoded(position.name, span.shape, photo, panel, white, modulation, moved)


def _seen(
    path: Path, white: Light, black: Light, clipped: npt.NDArray[np.bool_]
) -> tuple[Light, npt.NDArray[np.bool_]]:
    """Return the light of white over black, and the pixels where it is enough; refuse a wrong exposure."""
    span = white - black
    bright = float(np.percentile(span.ravel()[:: max(1, span.size // 200_000)], 95.0))
    if bright < LEAST_LIGHT:
        what = f"is too dark: white is {100.0 * bright:.1f} % brighter than black"
        raise input_error(str(path), what, "expose longer; all photographs alike, with a fixed exposure")
    seen = span > LEAST_CONTRAST * bright
    lost = float((clipped & seen).sum()) / max(1, int(seen.sum()))
    # Where black is clipped too, nothing is seen at all.
    whole = float(clipped.mean())
    if lost > MOST_CLIPPED or whole > 0.5:
        what = f"is too bright: {100.0 * max(lost, whole):.0f} % of the panel is clipped"
        raise input_error(str(path), what, "expose all photographs shorter, so that white stays below the limit")
    return span, seen & ~clipped


def _chosen(seen: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return rows and columns of some of the pixels that see the panel."""
    at = np.flatnonzero(seen)
    some = np.random.default_rng(SEED).choice(at, min(SAMPLES, len(at)), replace=False)
    rows, columns = np.unravel_index(np.sort(some), seen.shape)
    return rows, columns


def small(light: Light, longest: int = 640) -> Light:
    """Return a photograph scaled down to at most `longest` pixels, for pictures."""
    scale = min(1.0, longest / max(light.shape))
    size = max(1, round(light.shape[1] * scale)), max(1, round(light.shape[0] * scale))
    return np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), np.float32)
