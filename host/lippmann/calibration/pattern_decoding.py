"""Decode photographs of the patterns to find the panel point that each camera pixel sees.

The phase of a pixel's light gives the coordinate in a period, and the Gray code gives
the period. A pixel is used if its light changes enough between black and white, is not
clipped, follows the phase pictures' cosine, and has at most one doubtful bit per axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lippmann.base import interrupts
from lippmann.base.progress_protocol import Progress
from lippmann.calibration.coded_patterns import AxisCode, Pattern, PatternSet, Singles
from lippmann.calibration.photograph_diagnostics import Samples, check_marks, check_samples, find_lit
from lippmann.calibration.photographs import Photograph, Position, read_photograph
from lippmann.display.description import Display
from lippmann.errors import input_error
from lippmann.optics.rays import Floats
from lippmann.optics.system import PanelFrame

#: Number of camera pixels on which photographs are checked.
SAMPLES, SEED = 8000, 1908


@dataclass(frozen=True)
class Decoded:
    """The panel points `panel_px` (N, 2) that the camera pixels `photo_px` (N, 2) see.

    `shape` is the photographs' (height, width). `modulation` is the median amplitude of
    the phase pictures, as a fraction of the range from black to white.
    """

    name: str
    shape: tuple[int, int]
    photo_px: Singles
    panel_px: Singles
    modulation: float

    def points_mm(self, display: Display) -> Floats:
        """Return the panel points (N, 2) in mm, in the panel's frame."""
        return np.stack(PanelFrame.of(display).panel_from_pixel(*self.panel_px.astype(np.float64).T), axis=1)


def decode_position(
    position: Position,
    patterns: PatternSet,
    pitch_px: float,
    shape: tuple[int, int] | None = None,
    progress: Progress = lambda *_: None,
) -> Decoded:
    """Decode a camera position's photographs; `pitch_px` is the lenslet pitch in panel pixels.

    Raises InputError for wrong patterns, size, order or exposure, for blur, a moved
    camera, or a panel partly out of view.
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
    span, lit = find_lit(position.of(white_pattern), white, black, white_photograph.clipped)
    middle = 0.5 * (white + black)
    inverse = np.float32(1.0) / np.maximum(span, np.float32(1e-6))
    at = np.flatnonzero(lit)
    some = np.sort(np.random.default_rng(SEED).choice(at, min(SAMPLES, len(at)), replace=False))
    samples = Samples(patterns, position, shape, np.unravel_index(some, shape), {})
    axes = [AxisCode(patterns, axis, shape) for axis in (0, 1)]
    for pattern in coded:
        share = np.asarray((read(pattern).light - middle) * inverse, np.float32)
        samples.shares[pattern] = share[samples.at]
        axes[pattern.axis].add(pattern, share)
    check_marks(position, marks, marks_again, first_marks, read(marks_again).light, lit)

    (columns, good_columns), (rows, good_rows) = (axis.points() for axis in axes)
    lit &= good_columns & good_rows
    modulation = check_samples(samples, pitch_px)
    row, column = np.nonzero(lit)
    if len(row) < 1000:
        what = f"only {len(row)} camera pixels see the patterns"
        raise input_error(position.name, what, "move the camera nearer, focus on the array, and darken the room")
    photo = np.stack([column + np.float32(0.5), row + np.float32(0.5)], axis=1).astype(np.float32)
    panel = np.stack([columns[lit], rows[lit]], axis=1).astype(np.float32)
    return Decoded(position.name, shape, photo, panel, modulation)
