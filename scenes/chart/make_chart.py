"""Make the chart scene: small bright spheres and test cards at known depths, and a smooth part.

Run `python scenes/chart/make_chart.py`: textures, `chart.xml` and `chart.toml` are written beside
this file. Lengths are in mm in the display's frame (see `scenekit`). `chart.toml` tells tests
where everything is.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scenekit import Array, SceneFile, mix, save_texture, texel_grid

HERE = Path(__file__).resolve().parent

# name: (centre, radius)
SPHERES: dict[str, tuple[tuple[float, float, float], float]] = {
    "sphere_back_60": ((-12.0, 2.0, -60.0), 2.5),
    "sphere_back_20": ((-40.0, 4.0, -20.0), 2.0),
    "sphere_front_20": ((42.0, 2.0, 20.0), 2.0),
    "sphere_front_60": ((6.0, -6.0, 60.0), 2.0),
}
# name: (centre, size)
CARDS: dict[str, tuple[tuple[float, float, float], tuple[float, float]]] = {
    "line_pairs": ((-32.0, -24.0, -40.0), (36.0, 36.0)),
    "star": ((12.0, -30.0, -1.0), (28.0, 28.0)),
    "checker": ((39.0, -17.0, 25.0), (14.0, 14.0)),
}
LINE_PAIR_PERIODS = (4.0, 3.0, 2.0, 1.5, 1.0, 0.75)
"""Periods in mm of the rows of the card `line_pairs`, from top to bottom.

The left half has upright lines, the right half level ones.
"""
STAR_SPOKES = 24
CHECKER_SQUARE = 2.0

SMOOTH = ((0.0, 60.0, -30.0), (300.0, 100.0))
"""The smooth part, (centre, size): its lower edge is at y = 10, everything else is below it."""
ROOM_HALF, ROOM_BACK, ROOM_FRONT = 220.0, -130.0, 78.0

INK, PAPER = 0.10, 0.86
"""Encoded (sRGB) values of the black and white of the cards."""


def card_picture(white: Array, size: tuple[float, float], border: float = 0.8) -> Array:
    """Turn coverage by white into an sRGB picture with a dark border of `border` mm.

    Its first row belongs at the bottom of the card, where v = 0.
    """
    u, v = texel_grid(*white.shape)
    inset = np.minimum(np.minimum(u, 1.0 - u) * size[0], np.minimum(v, 1.0 - v) * size[1])
    white = np.where(inset < border, 0.0, white)
    # Coverage is linear light: encode after mixing
    linear = INK**2.2 + (PAPER**2.2 - INK**2.2) * white
    return np.repeat((linear ** (1.0 / 2.2))[::-1, :, None], 3, axis=-1)


def coverage(pattern: Array, factor: int = 4) -> Array:
    """Average a 0-1 pattern over `factor` x `factor` blocks: edges without jaggies."""
    height, width = pattern.shape
    return pattern.reshape(height // factor, factor, width // factor, factor).mean(axis=(1, 3))


def line_pairs(size: tuple[float, float], texels: int = 768) -> Array:
    """Rows of line pairs, one row for each of `LINE_PAIR_PERIODS`."""
    u, v = texel_grid(4 * texels, 4 * texels)
    x, margin = (u - 0.5) * size[0], 1.6
    inner = (size[1] - 2.0 * margin) / len(LINE_PAIR_PERIODS)
    place = (v * size[1] - margin) / inner
    row = np.clip(np.floor(place), 0, len(LINE_PAIR_PERIODS) - 1).astype(int)
    period = np.array(LINE_PAIR_PERIODS)[row]
    level = (place - row - 0.5) * inner
    phase = np.where(x < 0.0, x / period, level / period + 0.25)
    pattern = (np.mod(phase, 1.0) >= 0.5).astype(np.float64)
    half = size[0] / 2.0
    blank = (np.abs(level) > 0.42 * inner) | (np.abs(x) > half - margin) | (np.abs(x) < 0.5)
    return coverage(np.where(blank, 1.0, pattern))


def siemens_star(size: tuple[float, float], texels: int = 768) -> Array:
    """Siemens star with `STAR_SPOKES` dark spokes."""
    u, v = texel_grid(4 * texels, 4 * texels)
    x, y = (u - 0.5) * size[0], (0.5 - v) * size[1]
    spokes = np.cos(STAR_SPOKES * np.arctan2(y, x)) < 0.0
    radius = np.hypot(x, y)
    return coverage(np.where((radius > 0.44 * size[0]) | (radius < 0.4), 1.0, spokes.astype(np.float64)))


def checker(size: tuple[float, float], texels: int = 256) -> Array:
    """Checker of squares of `CHECKER_SQUARE` mm."""
    u, v = texel_grid(4 * texels, 4 * texels)
    squares = np.floor(u * size[0] / CHECKER_SQUARE) + np.floor(v * size[1] / CHECKER_SQUARE)
    return coverage(np.mod(squares, 2.0))


def smooth_picture() -> Array:
    """A colour gradient without edges: slow waves of hue in the middle of the scale."""
    u, v = texel_grid(256, 768)
    warm = 0.5 + 0.5 * np.cos(2.0 * np.pi * (1.1 * u - 0.25 * v))
    fresh = 0.5 + 0.5 * np.sin(2.0 * np.pi * (0.8 * u + 0.45 * v) + 0.7)
    picture = mix((0.42, 0.56, 0.74), (0.80, 0.58, 0.50), warm)
    return mix(picture, (0.52, 0.72, 0.56), 0.55 * fresh)


def wall_picture() -> Array:
    """The room's walls: a plain dark blue-grey that lightens slowly to the middle."""
    u, v = texel_grid(128, 128)
    return mix((0.26, 0.30, 0.38), (0.36, 0.40, 0.47), np.exp(-6.0 * ((u - 0.5) ** 2 + (v - 0.5) ** 2)))


def toml_list(values: tuple[float, ...]) -> str:
    """Format numbers as a TOML array."""
    return "[" + ", ".join(str(float(value)) for value in values) + "]"


def write_toml(path: Path) -> None:
    """Write the placement and the table of objects."""
    lines = [
        "# The test chart on its display: made by make_chart.py. Lengths in mm, angles in degrees.",
        "[placement]",
        "scale = 1.0",
        "rotation_deg = [0.0, 0.0, 0.0]",
        "offset_mm = [0.0, 0.0, 0.0]",
        "near_mm = 70.0 # in front of everything: primary rays start in this plane",
        f"far_mm = {ROOM_BACK:.1f} # the room's back wall",
    ]
    for name, (centre, radius) in SPHERES.items():
        lines += [
            "",
            "[[object]]",
            f'name = "{name}"',
            'kind = "sphere"',
            f"centre_mm = {toml_list(centre)}",
        ]
        lines += [f"radius_mm = {radius:.1f}"]
    notes = {
        "line_pairs": [f"periods_mm = {toml_list(LINE_PAIR_PERIODS)} # rows from top to bottom"],
        "star": [f"spokes = {STAR_SPOKES}"],
        "checker": [f"square_mm = {CHECKER_SQUARE:.1f}"],
    }
    for name, (centre, size) in {**CARDS, "smooth": SMOOTH}.items():
        lines += [
            "",
            "[[object]]",
            f'name = "{name}"',
            f'kind = "{"smooth" if name == "smooth" else "card"}"',
        ]
        lines += [
            f"centre_mm = {toml_list(centre)}",
            f"size_mm = {toml_list(size)}",
            *notes.get(name, []),
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Write textures, the scene and its table."""
    scene = SceneFile("Test chart at known depths: made by make_chart.py, millimetres in the display's frame")
    pictures = {
        "line_pairs": card_picture(line_pairs(CARDS["line_pairs"][1]), CARDS["line_pairs"][1]),
        "star": card_picture(siemens_star(CARDS["star"][1]), CARDS["star"][1]),
        "checker": card_picture(checker(CARDS["checker"][1]), CARDS["checker"][1], border=0.0),
        "smooth": smooth_picture(),
        "wall": wall_picture(),
    }
    for name, picture in pictures.items():
        save_texture(HERE / f"{name}.png", picture)
        scene.diffuse(name, f"{name}.png", two_sided=name == "wall")
    scene.diffuse("bright", (0.92, 0.92, 0.90))

    # Far lights beside the viewer, a little below: smooth light; every shadow falls close behind
    # what casts it, clear of the smooth part and of the other cards, and that of the smooth part
    # stays hidden behind it
    for x in (-400.0, -200.0, 0.0, 200.0, 400.0):
        scene.point_light((x, -60.0, 2000.0), np.full(3, 0.64))

    for centre, radius in SPHERES.values():
        scene.sphere(centre, radius, "bright")
    for name, (centre, size) in {**CARDS, "smooth": SMOOTH}.items():
        scene.rectangle(centre, size, name)
    # The room is open only towards the viewer, where the lights are
    width, depth = 2.0 * ROOM_HALF, ROOM_FRONT - ROOM_BACK
    middle = (ROOM_FRONT + ROOM_BACK) / 2.0
    scene.rectangle((0.0, 0.0, ROOM_BACK), (width, width), "wall")
    scene.rectangle((-ROOM_HALF, 0.0, middle), (depth, width), "wall", rotate=("y", 90.0))
    scene.rectangle((ROOM_HALF, 0.0, middle), (depth, width), "wall", rotate=("y", -90.0))
    scene.rectangle((0.0, -ROOM_HALF, middle), (width, depth), "wall", rotate=("x", -90.0))
    scene.rectangle((0.0, ROOM_HALF, middle), (width, depth), "wall", rotate=("x", 90.0))
    scene.save(HERE / "chart.xml")
    write_toml(HERE / "chart.toml")
    print(f"chart.xml: {len(SPHERES)} spheres, {len(CARDS)} cards, the smooth part, 5 walls")


if __name__ == "__main__":
    main()
