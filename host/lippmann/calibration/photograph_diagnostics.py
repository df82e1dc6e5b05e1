"""Check order, exposure, blur, movement and view of photographs, on sample pixels."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from lippmann.calibration.coded_patterns import AxisCode, Pattern, PatternSet
from lippmann.calibration.photographs import Light, Position
from lippmann.errors import input_error
from lippmann.optics.rays import Bools

#: Maximum residual of a phase photograph from the fitted cosine, in amplitudes.
MAX_RESIDUAL = 0.35
#: Minimum fraction of sample points that fit a homography.
MIN_ON_PLANE = 0.6


@dataclass(frozen=True)
class Samples:
    """Light of the pixels `at` (rows, columns) of each photograph, from -1/2 (black) to 1/2 (white)."""

    patterns: PatternSet
    position: Position
    shape: tuple[int, int]
    at: tuple[npt.NDArray[np.intp], ...]
    shares: dict[Pattern, Light]


class Fit(NamedTuple):
    """Measures of how well photographs agree."""

    #: Median amplitude of the phase photographs; 1 spans black to white.
    modulation: float
    #: Residual of each phase photograph from the fitted cosine, in amplitudes.
    residuals: dict[Pattern, float]
    #: Fraction of pixels whose Gray code and phase contradict each other.
    disagree: float
    #: Fraction of the panel points that fit the homography `panel_from_photo`.
    on_plane: float
    panel_from_photo: cv2.typing.MatLike

    @property
    def bad(self) -> float:
        """Total disagreement, higher if two photographs are exchanged."""
        return float(np.mean(list(self.residuals.values()))) + self.disagree + (1.0 - self.on_plane)


def fit(samples: Samples, pitch_px: float) -> Fit:
    """Decode the samples, and measure how well the photographs agree."""
    patterns, points, modulations, disagree = samples.patterns, [], [], []
    residuals: dict[Pattern, float] = {}
    for axis in (0, 1):
        code = AxisCode(patterns, axis, samples.at[0].shape)
        phases = {one: light for one, light in samples.shares.items() if (one.kind, one.axis) == ("phase", axis)}
        for one, light in samples.shares.items():
            if one.axis == axis:
                code.add(one, light)
        mean, strong = np.mean([*phases.values()], axis=0), code.amplitude > 0.5 * np.median(code.amplitude)
        for one, light in phases.items():
            expected = mean + 2.0 / patterns.steps * (code.wave / patterns.turn(one)).real
            # The median ignores pixels that see dust or a reflection.
            off = abs(light - expected) / np.maximum(0.5 * code.amplitude, 1e-6)
            residuals[one] = 1.4826 * float(np.median(off[strong]))
        modulations.append(float(np.median(code.amplitude)))
        points.append(code.points()[0])
        middle = (patterns.half_of(code.code) + 0.5) * patterns.half_px
        disagree.append(float((abs(points[-1] - middle)[strong] > 0.75 * patterns.half_px).mean()))
    panel = np.stack(points, axis=1).astype(np.float32)
    photo = np.stack(samples.at[::-1], axis=1).astype(np.float32) + np.float32(0.5)
    # The lenslets' parallax moves points by less than 1.5 pitches from the homography.
    plane, mask = cv2.findHomography(photo, panel, cv2.RANSAC, 1.5 * pitch_px, maxIters=500)
    share = float(np.mean(mask)) if np.size(plane) == 9 else 0.0
    return Fit(min(modulations), residuals, max(disagree), share, plane)


def find_lit(path: Path, white: Light, black: Light, clipped: Bools) -> tuple[Light, Bools]:
    """Return white minus black, and which pixels see the panel; refuse dark or clipped photographs."""
    span = white - black
    bright = float(np.percentile(span.ravel()[:: max(1, span.size // 200_000)], 95.0))
    if bright < 0.02:
        what = f"is too dark: white is only {100.0 * bright:.1f} % brighter than black"
        raise input_error(path, what, "expose all photographs longer, with one fixed exposure")
    # Ignore camera pixels with less than 10 % of the contrast of bright pixels.
    lit = span > 0.1 * bright
    clipped_share = float((clipped & lit).sum()) / max(1, int(lit.sum()))
    # `lit` lacks pixels that are clipped even in black; `overall` counts them too.
    overall = float(clipped.mean())
    if clipped_share > 0.2 or overall > 0.5:
        what = f"is overexposed: {100.0 * max(clipped_share, overall):.0f} % of the panel or photograph is clipped"
        raise input_error(path, what, "expose all photographs shorter, so that white does not clip")
    return span, lit & ~clipped


def check_samples(samples: Samples, pitch_px: float) -> float:
    """Raise InputError for photographs that disagree; return the relative phase amplitude."""
    position, patterns = samples.position, samples.patterns
    match = fit(samples, pitch_px)
    residuals = match.residuals
    worst = max(residuals, key=lambda one: residuals[one])
    if match.modulation < 0.25:
        path = position.of(next(one for one in patterns.patterns if one.kind == "phase"))
        contrast = f"have only {100.0 * match.modulation:.0f} % of their contrast"
        what = f"is blurred: stripes of {patterns.period_px} panel pixels {contrast}"
        raise input_error(path, what, "focus on the array, stop the lens down, and avoid reflections")
    _check_light(samples)
    if residuals[worst] > MAX_RESIDUAL or match.disagree > 0.2 or match.on_plane < MIN_ON_PLANE:
        pair = _find_exchange(samples, match, pitch_px)
        if pair is not None:
            first, second = (position.of(one).name for one in pair)
            what = f"{first} and {second} seem to have exchanged names"
            raise input_error(position.name, what, "give each photograph the name of its pattern")
        if residuals[worst] > MAX_RESIDUAL:
            what = "does not fit the other phase photographs"
            remedy = "fix camera and exposure, and take all photographs of this position again"
            raise input_error(position.of(worst), what, remedy)
        what = "the photographs do not show these patterns: adjacent camera pixels see distant panel points"
        remedy = "show the patterns drawn for this display; give each photograph the name of its pattern"
        raise input_error(position.name, what, remedy)
    _check_view(samples, match)
    return match.modulation


def _check_light(samples: Samples) -> None:
    patterns = samples.patterns
    for pattern, share in samples.shares.items():
        along = np.arange(patterns.sides_px[pattern.axis]) + 0.5
        expected = float(patterns.level(pattern, along).mean())
        got = float(np.clip(share, -1.0, 1.0).mean()) + 0.5
        if abs(got - expected) > 0.2 * (1.0 if pattern.kind == "phase" else 1.5):
            name, more = samples.position.of(pattern), "brighter" if got > expected else "darker"
            what = f"is {more} than its pattern ({100.0 * got:.0f} % of white instead of {100.0 * expected:.0f} %)"
            remedy = "use one exposure for all photographs, and give each photograph the name of its pattern"
            raise input_error(name, what, remedy)


def _find_exchange(samples: Samples, match: Fit, pitch_px: float) -> tuple[Pattern, Pattern] | None:
    step = max(1, len(samples.at[0]) // 800)
    shares = {one: share[::step] for one, share in samples.shares.items()}
    at = tuple(one[::step] for one in samples.at)
    best, pair = 0.5 * match.bad, None  # an exchange must halve the disagreement
    for one, other in itertools.combinations(shares, 2):
        if one.kind != other.kind:
            continue
        exchanged = {**shares, one: shares[other], other: shares[one]}
        again = fit(replace(samples, at=at, shares=exchanged), pitch_px)
        if again.bad < best and again.on_plane >= MIN_ON_PLANE:
            best, pair = again.bad, (one, other)
    return pair


def _check_view(samples: Samples, match: Fit) -> None:
    patterns, panel_from_photo = samples.patterns, match.panel_from_photo
    if np.size(panel_from_photo) != 9:
        return
    path = samples.position.of(patterns.patterns[0])
    if np.linalg.det(panel_from_photo[:2, :2]) < 0.0:
        raise input_error(path, "is mirrored", "do not mirror the camera's photographs")
    height, width = samples.shape
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64) * patterns.sides_px
    photo = cv2.perspectiveTransform(corners[None], np.linalg.inv(panel_from_photo))[0]
    margin = 0.005 * max(height, width)
    outside = {
        "left": photo[:, 0] < -margin,
        "right": photo[:, 0] > width + margin,
        "top": photo[:, 1] < -margin,
        "bottom": photo[:, 1] > height + margin,
    }
    sides = [side for side, beyond in outside.items() if beyond.any()]
    if sides:
        what = f"the panel extends beyond the photograph at the {' and '.join(sides)}"
        raise input_error(path, what, "move or turn the camera, so that the whole panel is in view")


def check_marks(position: Position, first: Pattern, last: Pattern, before: Light, after: Light, lit: Bools) -> None:
    """Raise InputError if the camera moved or the light changed between first and last photograph."""
    rows, columns = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
    if len(rows) < 8 or len(columns) < 8:
        return
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    # Blur the photographs by 1.5 pixels before the comparison.
    before, after = (
        np.asarray(cv2.GaussianBlur(np.ascontiguousarray(one[part]), (0, 0), 1.5), np.float32)
        for one in (before, after)
    )
    scale = float(after.mean()) / max(1e-9, float(before.mean()))
    if not 0.8 < scale < 1.25:
        what = f"has {100.0 * scale:.0f} % of the light of {position.of(first).name}"
        raise input_error(position.of(last), what, "fix the camera's exposure, and the room's light")
    # Estimate the shift from the gradients by least squares.
    down, right = np.gradient(before)
    slopes = np.stack([right.ravel(), down.ravel()], axis=1)
    moved = float(np.hypot(*np.linalg.lstsq(slopes, (before - after).ravel(), rcond=None)[0]))
    if moved > 0.4:
        what = f"the camera moved by {moved:.1f} pixels after {position.of(first).name}"
        raise input_error(position.of(last), what, "fix the camera on a tripod, and photograph this position again")
