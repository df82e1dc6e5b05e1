"""Assembles the viewer page, one text with everything that the browser needs.

The files in page_files/ have placeholders `@@name@@`; shaders use `#include`.
"""

from __future__ import annotations

import base64
import dataclasses
import html
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files

from lippmann.base.animation import png_bytes
from lippmann.display.description import Display, Point3
from lippmann.display.subpixels import COLOURS, layout_of
from lippmann.errors import InputError, input_error
from lippmann.eye.observer import Light, check_size
from lippmann.optics.crosstalk_and_viewing_zone import middle_eye, viewing_distance
from lippmann.optics.display_properties import depth_reach_mm
from lippmann.optics.lattice import Lattice

HOLE = re.compile(r"@@(\w+)@@")
INCLUDE = re.compile(r'^#include "([\w.]+)"\n', re.M)


def read(name: str) -> str:
    """Return the text of a file in page_files/."""
    return files("lippmann.eye").joinpath("page_files", name).read_text(encoding="utf-8")


def fill_template(name: str, **values: str) -> str:
    """Return a template whose placeholders `@@name@@` are replaced by the values."""
    text = read(name)
    holes = set(HOLE.findall(text))
    if holes != set(values):
        raise ValueError(f"{name} has the placeholders {sorted(holes)}, not {sorted(values)}")
    return HOLE.sub(lambda hole: values[hole[1]], text)


def shader(name: str) -> str:
    """Return a shader's source with all its includes."""
    return INCLUDE.sub(lambda line: shader(line[1]), read(f"shaders/{name}"))


#: Range of the eye's distance, as multiples of the viewing distance.
DISTANCES = (0.25, 4.0)
#: Maximum pupil, mm; a wide pupil shows focus clearly.
PUPIL_MM = 20.0
#: Maximum rotation of the array, degrees.
TURN_DEG = 5.0
#: Maximum relative change of the array's pitch.
STRETCH = 0.05
#: Step of the slider for the pitch's relative change.
FINE = 1e-4


@dataclass(frozen=True)
class Slider:
    """A slider of the page, from `low` to `high` in steps of `step`, initially at `value`."""

    id: str
    label: str
    unit: str
    low: float
    high: float
    step: float
    value: float = 0.0

    def html(self) -> str:
        """Return the HTML of the slider, its label and its value."""
        numbers = {key: f"{getattr(self, key):.12g}" for key in ("low", "high", "step", "value")}
        return fill_template("slider.html", id=self.id, label=html.escape(self.label), unit=self.unit, **numbers)


def eye_reach_mm(display: Display) -> float:
    """Return the eye's maximum offset, mm, where even the panel's far edge shows crosstalk."""
    distance = viewing_distance(display)
    zone = distance * (1.0 + display.convergence) * display.array.coarsest_mm / display.aperture_distance_mm
    aside = max(abs(x) for x in middle_eye(display, distance)[:2])
    return _round_up(aside + 0.5 * (zone + max(display.panel.width_mm, display.panel.height_mm)))


def focus_reach_mm(display: Display) -> float:
    """Return the maximum focus depth, mm: twice the depth range's near end, limited by the nearest eye."""
    return _round_up(min(2.0 * depth_reach_mm(display)[1], 0.9 * DISTANCES[0] * viewing_distance(display)))


def sliders(display: Display) -> dict[str, list[Slider]]:
    """Return the page's sliders, keyed by group."""
    array = display.array
    reach, focus = eye_reach_mm(display), focus_reach_mm(display)
    x, y, distance = middle_eye(display, viewing_distance(display))
    near, far = (share * distance for share in DISTANCES)
    shift = _round_up(0.5 * array.coarsest_mm)
    lift = _round_up(0.5 * array.focal_length_mm)
    # A lenslet must cover a pixel, and its surface must reach its cell's corners.
    narrow = 1.0 - _round_down(1.0 - max(1.0 - STRETCH, display.panel.coarsest_mm / array.finest_mm), FINE)
    wide = 1.0 + _round_down(min(1.0 + STRETCH, array.radius_mm / array.half_diagonal_mm) - 1.0, FINE)
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
            Slider("rotation", "Rotation", "°", -TURN_DEG, TURN_DEG, 0.01),
            Slider("pitch-scale", "Pitch", "×", narrow, wide, FINE, 1.0),
            Slider("offset-x", "Shift right", "mm", -shift, shift, _step(shift)),
            Slider("offset-y", "Shift up", "mm", -shift, shift, _step(shift)),
            Slider("gap", "Gap", "mm", 0.0 - _round_down(min(display.gap_mm, lift), _step(lift)), lift, _step(lift)),
        ],
    }


def controls_html(display: Display) -> str:
    """Return the HTML of all sliders, group by group."""
    return "".join(
        f"<fieldset>\n<legend>{html.escape(group)}</legend>\n{''.join(one.html() for one in members)}</fieldset>\n"
        for group, members in sliders(display).items()
    )


def _round_up(value: float) -> float:
    """Round up to two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit - 1e-9) * unit


def _step(reach: float) -> float:
    """Return the power of ten that divides `reach` into 100 to 1000 steps."""
    return 10.0 ** (math.floor(math.log10(reach)) - 2)


def _round_down(value: float, step: float) -> float:
    """Round down to a multiple of the step, because browsers count steps from the low end."""
    return math.floor(value / step + 1e-9) * step


#: Scripts in the order of their dependencies.
SCRIPTS = (
    "system",
    "lattice",
    "renderer",
    "panel_tiles",
    "pace",
    "controls",
    "depth_view",
    "direct_view",
    "panel_view",
    "eye_control",
    "main",
)
SHADERS = ("full.vert", "glance.frag", "view.frag", "show.frag")
#: Maximum side of a panel tile, pixels; every WebGL 2 accepts such a texture.
TILE_PX = 2048
#: Maximum pixels of all frames; their textures take 1 GB.
MAX_PX = 1 << 28
FRAMES_PER_SECOND = 12.0
#: Focus range in units of the depth drawing, whose edge is at 110 units.
DRAWN = 100.0


@dataclass(frozen=True)
class Direct:
    """A direct render from an eye through the panel's window: linear radiance (height, width, 3)."""

    eye_mm: Point3
    radiance: Light


def page_html(
    display: Display,
    radiance: Light,
    title: str,
    directs: Sequence[Direct] = (),
    later: Sequence[Light] = (),
    frames_per_second: float = FRAMES_PER_SECOND,
) -> str:
    """Return the viewer page of an integral image, with direct renders beside the view.

    `radiance` is linear, (height, width, 3); the page stores 8-bit sRGB, clipped at 1.
    `later` has further frames of a film. Raises InputError for an image of another size
    than the panel's, or for a direct render of another aspect ratio.
    """
    panel, array = display.panel, display.array
    frames = [radiance, *later]
    for frame in frames:
        check_size(frame, display)
    if panel.width_px * panel.height_px * len(frames) > MAX_PX:
        times = f"{len(frames)} frames of " * bool(later)
        what = f"{times}{panel.width_px} x {panel.height_px} pixels are more than browsers can show ({MAX_PX})"
        remedy = "show fewer frames" if later else "show a smaller panel, or compute views: lippmann observe"
        raise input_error(f"display '{display.name}'", what, remedy)
    for direct in directs:
        check_direct(direct, display)
    square = len(set(panel.pitches_mm)) == 1
    aspect = f"{panel.width_px} / {panel.height_px}" if square else f"{panel.width_mm:.9g} / {panel.height_mm:.9g}"
    summary = (
        f"Display {display.name}: {panel.width_px} × {panel.height_px} pixels behind {array.grid} lenslets "
        f"of {' × '.join(f'{pitch:g}' for pitch in dict.fromkeys(array.pitches_mm))} mm"
    )
    described = dataclasses.asdict(display) | {"panel": panel.keys, "array": array.keys}
    del described["name"]
    pictures = []
    for direct in directs:
        png = "data:image/png;base64," + png_base64(direct.radiance)
        pictures.append({"eye_mm": direct.eye_mm, "png": png})
    focus = focus_reach_mm(display)
    scale = focus / DRAWN
    reach = depth_reach_mm(display)[1] / scale
    defines = (f"#define {key} {value}\n" for key, value in _defines(display).items())
    head = "#version 300 es\n" + "".join(defines)
    return fill_template(
        "page.html",
        title=html.escape(title),
        summary=html.escape(summary),
        style=read("style.css"),
        aspect=aspect,
        direct=fill_template("direct.html", aspect=aspect) if directs else "",
        controls=controls_html(display),
        depth=fill_template("depth.svg", mm_per_unit=f"{scale:.9g}", reach=f"{reach:.6g}", left_mm=f"−{focus:g}"),
        display=script_json(described),
        shaders=script_json({name: head + shader(name) for name in SHADERS}),
        directs=script_json(pictures),
        play=fill_template("play.html", rate=f"{frames_per_second:g}", frames=str(len(frames))) if later else "",
        panel="\n".join(tile for number, frame in enumerate(frames) for tile in _tiles(frame, number)),
        script="".join(read(f"scripts/{name}.js") for name in SCRIPTS),
    )


def check_direct(direct: Direct, display: Display) -> None:
    """Refuse a direct render of another aspect ratio than the panel's."""
    panel = display.panel
    height, width = direct.radiance.shape[:2]
    # Allow for the height's rounding to integer pixels.
    if abs(width * panel.height_mm / panel.width_mm - height) > 1.0 + 1e-9:
        raise InputError(
            f"the direct render has {width} x {height} pixels, another aspect ratio than the panel of '{display.name}' "
            f"({panel.width_px} x {panel.height_px}); render the whole panel"
        )


def _tiles(radiance: Light, frame: int) -> Iterator[str]:
    height, width = (-(-side // -(-side // TILE_PX)) for side in radiance.shape[:2])
    for top in range(0, radiance.shape[0], height):
        for start in range(0, radiance.shape[1], width):
            tile = png_base64(radiance[top : top + height, start : start + width])
            yield f'<script type="text/plain" class="panel-tile" data-frame="{frame}">{tile}</script>'


def png_base64(radiance: Light) -> str:
    """Encode linear light as an 8-bit sRGB PNG in base64."""
    return base64.b64encode(png_bytes(radiance)).decode("ascii")


def script_json(value: object) -> str:
    """Return JSON for a `<script>` element, with `<` escaped, because `<` could end the element."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")


def _defines(display: Display) -> dict[str, str]:
    """Return the shaders' macros for properties that no slider changes."""
    defines = {}
    if display.array.grid == "hex":
        defines["HEX"] = "1"
    if Lattice.of(display.array).stepped:
        defines["STEPPED"] = "1"
    if display.array.plano_side == "panel":
        defines["PLANO_TO_PANEL"] = "1"
    layout = layout_of(display.panel.subpixels)
    if display.panel.black or layout is not None:
        defines["EMITS"] = "1"
        defines["BLACK"] = f"{display.panel.black:.9e}"
    if layout is not None:
        boxes, gains = [], []
        for colour, *edges in layout.edges():
            boxes.append(f"vec4({', '.join(f'{edge:.9e}' for edge in edges)})")
            gain = (layout.gain(colour) * (colour == other) for other in COLOURS)
            gains.append(f"vec4({', '.join(f'{part:.9e}' for part in gain)})")
        defines["SUBPIXELS"] = str(len(boxes))
        defines["PERIOD"] = f"vec2({layout.columns}.0, {layout.rows}.0)"
        defines["WHITE"] = str(float(any(sub[0] == "white" for sub in layout.subpixels)))
        defines |= {"BOXES": f"vec4[]({', '.join(boxes)})", "GAINS": f"vec4[]({', '.join(gains)})"}
    return defines
