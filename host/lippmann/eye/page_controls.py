"""The page's sliders, and their ranges for a display."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass

from lippmann.display.description import Display
from lippmann.eye.page_template import filled
from lippmann.optics.display_properties import DisplayProperties
from lippmann.optics.zones import middle_eye, viewing_distance

#: Range of the eye's distance, in viewing distances.
DISTANCES = (0.25, 4.0)
#: Widest pupil, mm: as wide as a camera's lens, which shows focus best.
PUPIL_MM = 20.0
#: Largest rotation of the array, degrees, and largest relative change of its pitch.
TURN_DEG, STRETCH = 5.0, 0.05
#: Step of the stretch.
FINE = 1e-4


@dataclass(frozen=True)
class Slider:
    """A slider from `low` to `high` by `step`, initially at `value`."""

    id: str
    label: str
    unit: str
    low: float
    high: float
    step: float
    value: float = 0.0

    def html(self) -> str:
        """Return the slider with its label and the display of its value."""
        numbers = {key: f"{getattr(self, key):.12g}" for key in ("low", "high", "step", "value")}
        return filled("slider.html", id=self.id, label=html.escape(self.label), unit=self.unit, **numbers)


def eye_reach_mm(display: Display, derived: DisplayProperties) -> float:
    """Return the eye's largest offset, where even the panel's far edge shows the neighbours' elemental images."""
    distance = viewing_distance(display)
    zone = distance * (1.0 + display.convergence) * display.array.coarsest_mm / derived.aperture_distance_mm
    aside = max(abs(x) for x in middle_eye(display, distance)[:2])
    return _neat(aside + 0.5 * (zone + max(display.panel.width_mm, display.panel.height_mm)))


def focus_reach_mm(display: Display, derived: DisplayProperties) -> float:
    """Return the largest focus depth: twice the depth range, but less than the shortest viewing distance."""
    return _neat(min(2.0 * derived.depth_range_mm[1], 0.9 * DISTANCES[0] * viewing_distance(display)))


def sliders(display: Display, derived: DisplayProperties) -> dict[str, list[Slider]]:
    """Return the sliders by group."""
    array = display.array
    reach, focus = eye_reach_mm(display, derived), focus_reach_mm(display, derived)
    x, y, distance = middle_eye(display, viewing_distance(display))
    near, far = (share * distance for share in DISTANCES)
    shift, lift = _neat(0.5 * array.coarsest_mm), _neat(0.5 * array.focal_length_mm)
    # A lenslet must cover at least a pixel, and its radius must span its cell.
    narrow = 1.0 - _whole(1.0 - max(1.0 - STRETCH, display.panel.coarsest_mm / array.finest_mm), FINE)
    wide = 1.0 + _whole(min(1.0 + STRETCH, array.radius_mm / array.half_diagonal_mm) - 1.0, FINE)
    return {
        "Eye": [
            Slider("eye-x", "Right", "mm", -reach, reach, _step(reach), x),
            Slider("eye-y", "Up", "mm", -reach, reach, _step(reach), y),
            Slider("eye-z", "Distance", "mm", near, far, 1.0, distance),
        ],
        "Pupil and focus": [
            Slider("pupil", "Pupil", "mm", 0.0, PUPIL_MM, 0.1),
            Slider("focus", "Focus", "mm", -focus, focus, _step(focus)),
        ],
        "The array as built": [
            Slider("rotation", "Turned", "°", -TURN_DEG, TURN_DEG, 0.01),
            Slider("pitch-scale", "Stretched", "×", narrow, wide, FINE, 1.0),
            Slider("offset-x", "Moved right", "mm", -shift, shift, _step(shift)),
            Slider("offset-y", "Moved up", "mm", -shift, shift, _step(shift)),
            Slider("gap", "Lifted", "mm", 0.0 - _whole(min(display.gap_mm, lift), _step(lift)), lift, _step(lift)),
        ],
    }


def controls_html(display: Display, derived: DisplayProperties) -> str:
    """Return the groups of sliders."""
    return "".join(
        f"<fieldset>\n<legend>{html.escape(group)}</legend>\n{''.join(one.html() for one in members)}</fieldset>\n"
        for group, members in sliders(display, derived).items()
    )


def _neat(value: float) -> float:
    """Round up to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit - 1e-9) * unit


def _step(reach: float) -> float:
    """Return a power of ten that divides 0 to `reach` into a hundred to a thousand steps."""
    return 10.0 ** (math.floor(math.log10(reach)) - 2)


def _whole(value: float, step: float) -> float:
    """Round down to a multiple of the step: browsers count steps from the low end, and 0 must be one."""
    return math.floor(value / step + 1e-9) * step
