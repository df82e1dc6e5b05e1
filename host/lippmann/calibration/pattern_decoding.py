"""The panel point that each pixel of a camera sees, from the photographs of the patterns, read one after the other.

The phase of a pixel's light over the steps gives the point within a period, its Gray code the period. A pixel counts
when its light changes enough between black and white, is not clipped, follows the phase pictures' cosine, and has at
most one doubtful bit of Gray code in each direction: next to an edge of the code one bit is half lit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lippmann.base import interrupts
from lippmann.base.progress import Progress
from lippmann.calibration.coded_patterns import AxisCode, Pattern, PatternSet
from lippmann.calibration.photograph_diagnostics import Samples, check_marks, check_samples
from lippmann.calibration.photographs import Light, Photograph, Position, read_photograph
from lippmann.display.description import Display
from lippmann.errors import input_error
from lippmann.optics.rays import Floats
from lippmann.optics.system import PanelFrame

#: Least light of white over black, as a share of the brightest twentieth's, of a pixel that counts.
LEAST_CONTRAST = 0.1
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
    that they see; `shape` is the photographs' (height, width). `modulation` is the median amplitude of the phase
    pictures, as a fraction of the black to white range.
    """

    name: str
    shape: tuple[int, int]
    photo_px: npt.NDArray[np.float32]
    panel_px: npt.NDArray[np.float32]
    modulation: float

    def points_mm(self, display: Display) -> Floats:
        """Return the points of a display's panel that the pixels see, (N, 2), in the panel's frame."""
        return np.stack(PanelFrame.of(display).panel_from_pixel(*self.panel_px.astype(np.float64).T), axis=1)


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

    def read(pattern: Pattern) -> Photograph:
        interrupts.check()
        photograph = read_photograph(position.of(pattern), shape)
        progress(pattern.place + 1, len(patterns.patterns))
        return photograph

    marks, white_pattern, black_pattern, *coded, marks_again = patterns.patterns
    first_marks = read(marks).light
    shape = first_marks.shape[0], first_marks.shape[1]
    white_photograph = read(white_pattern)
    white, black = white_photograph.light, read(black_pattern).light
    span, seen = _seen(position.of(white_pattern), white, black, white_photograph.clipped)
    middle = 0.5 * (white + black)
    inverse = np.float32(1.0) / np.maximum(span, np.float32(1e-6))
    at = np.flatnonzero(seen)
    some = np.sort(np.random.default_rng(SEED).choice(at, min(SAMPLES, len(at)), replace=False))
    samples = Samples(patterns, position, shape, np.unravel_index(some, shape), {})
    axes = [AxisCode(patterns, axis, shape) for axis in (0, 1)]
    for pattern in coded:
        share = np.asarray((read(pattern).light - middle) * inverse, np.float32)
        samples.shares[pattern] = share[samples.at]
        axes[pattern.axis].add(pattern, share)
    check_marks(position, marks, marks_again, first_marks, read(marks_again).light, seen)

    (columns, good_columns), (rows, good_rows) = (axis.points() for axis in axes)
    seen &= good_columns & good_rows
    modulation = check_samples(samples, pitch_px)
    row, column = np.nonzero(seen)
    if len(row) < 1000:
        what = f"only {len(row)} pixels of the photographs see the patterns"
        raise input_error(position.name, what, "come nearer, focus on the array, and darken the room")
    photo = np.stack([column + np.float32(0.5), row + np.float32(0.5)], axis=1).astype(np.float32)
    panel = np.stack([columns[seen], rows[seen]], axis=1).astype(np.float32)
    return Decoded(position.name, shape, photo, panel, modulation)


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
