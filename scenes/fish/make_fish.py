"""Make the fish scene: a fish above rippling, reflecting water, plant stems, and a cloudy sky.

Run `python scenes/fish/make_fish.py`: meshes, textures and `fish.xml` are written beside this file.
Lengths are in mm in the display's frame (see `scenekit`). The whole picture is seen from a little
above: the water's plane rises away from the viewer, by `WATER_SLOPE`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scenekit import (
    Array,
    Mesh,
    SceneFile,
    curve,
    grid_mesh,
    mix,
    noise,
    save_texture,
    smoothstep,
    texel_grid,
    unit,
)

HERE = Path(__file__).resolve().parent
SEED = 1908  # the year of Lippmann's integral photography

# --- layout ---------------------------------------------------------------------------------------

WATER_AT_DISPLAY = -27.5  # height of the water in the plane of the display
WATER_SLOPE = -0.19  # rise of the water for each mm towards the viewer
LIP_START, LIP_BEND = (
    40.0,
    0.0028,
)  # nearer than this the water bends down, to fill the foot of the window (mm, 1/mm)
WATER_FRONT, SKY_BACK = 75.0, -165.0  # z of the near edge of the water, and of the sky
HALF_WIDTH = 300.0

# Kinds of stem and leaf, and their colours (sRGB): one column each of the plants' texture
PLANT_COLUMNS = {
    "reed": (0.50, 0.68, 0.22),
    "olive": (0.52, 0.54, 0.18),
    "red": (0.66, 0.32, 0.22),
    "teal": (0.20, 0.52, 0.42),
    "pale": (0.72, 0.74, 0.45),
    "brown": (0.42, 0.24, 0.12),
    "green leaf": (0.36, 0.66, 0.20),
    "olive leaf": (0.55, 0.62, 0.18),
    "red leaf": (0.72, 0.36, 0.22),
    "teal leaf": (0.16, 0.56, 0.42),
    "petal": (1.0, 0.62, 0.78),
    "pad": (0.25, 0.55, 0.25),
}


def water_level(z: float | Array) -> float | Array:
    """Height of the calm water at depth `z`."""
    return WATER_AT_DISPLAY + WATER_SLOPE * z - LIP_BEND * np.maximum(z - LIP_START, 0.0) ** 2


def water_slope(z: Array) -> Array:
    """Derivative of `water_level`."""
    return WATER_SLOPE - 2.0 * LIP_BEND * np.maximum(z - LIP_START, 0.0)


# --- the fish's body ------------------------------------------------------------------------------

#: Its meshes; every shape of the fish has an id that begins with "fish-".
FISH_MESHES = ("body", "fins")
BODY_LENGTH, TAIL_LENGTH = 60.0, 19.0
NOSE = np.array([-17.5, 1.5, 35.0])
# The part of the body that carries scales, as fractions of its length
SCALE_FROM, SCALE_TO = 0.29, 1.0

# Half height, half width and rise of the axis, in mm, at stations along the body (fractions of it)
STATIONS = (0.0, 0.015, 0.05, 0.12, 0.22, 0.36, 0.50, 0.65, 0.80, 0.92, 1.0)
HALF_HEIGHT = (0.0, 1.7, 3.9, 7.1, 10.4, 13.0, 12.4, 9.4, 5.6, 3.7, 3.6)
HALF_WIDTH_OF_BODY = (0.0, 1.3, 3.0, 5.2, 7.0, 8.0, 7.4, 5.3, 2.9, 1.6, 1.2)
AXIS_RISE = (-1.6, -1.5, -1.35, -0.9, -0.35, 0.1, 0.25, 0.35, 0.4, 0.4, 0.4)


def profile(values: tuple[float, ...], t: Array) -> Array:
    """Value at fraction `t` of the body of a profile given at `STATIONS`."""
    return curve(list(zip(STATIONS, values, strict=True)), t)


def spine(s: Array) -> tuple[Array, Array, Array, Array]:
    """Point of the bent spine `s` mm from the nose; its tailward, up and left-hand directions."""
    fine = np.linspace(0.0, BODY_LENGTH + 1.5 * TAIL_LENGTH, 801)
    heading = np.radians(curve([(0.0, 70.0), (20.0, 66.0), (45.0, 52.0), (62.0, 35.0), (90.0, 12.0)], fine))
    pitch = np.radians(curve([(0.0, -4.0), (40.0, -5.0), (70.0, 4.0), (90.0, 8.0)], fine))
    tailward = np.stack([np.cos(heading) * np.cos(pitch), np.sin(pitch), -np.sin(heading) * np.cos(pitch)], axis=-1)
    step = fine[1] - fine[0]
    path = NOSE + np.concatenate([np.zeros((1, 3)), np.cumsum((tailward[1:] + tailward[:-1]) * step / 2.0, axis=0)])
    s = np.asarray(s, dtype=np.float64)

    def at(table: Array) -> Array:
        return np.stack([np.interp(s, fine, table[:, k]) for k in range(3)], axis=-1)

    along = unit(at(tailward))
    up = unit(np.array([0.0, 1.0, 0.0]) - along[..., 1:2] * along)
    return at(path), along, up, np.cross(along, up)


def body_point(t: Array, angle: Array) -> Array:
    """Point of the skin at fraction `t` of the length, `angle` from the left flank to the back."""
    point, _, up, side = spine(t * BODY_LENGTH)
    height, width = profile(HALF_HEIGHT, t), profile(HALF_WIDTH_OF_BODY, t)
    # A cross-section a little fuller than an ellipse at the flanks and keener at back and belly
    across = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 1.1 * width
    rise = profile(AXIS_RISE, t) + np.sin(angle) * height
    return point + up * rise[..., None] + side * across[..., None]


def body_frame(t: float, angle: float) -> tuple[Array, Array, Array]:
    """Point, outward normal and tailward tangent of the skin."""
    h = 1e-3

    def at(dt: float, da: float) -> Array:
        return body_point(np.array(t + dt), np.array(angle + da))

    tailward = unit(at(h, 0.0) - at(-h, 0.0))
    around = at(0.0, h) - at(0.0, -h)
    return at(0.0, 0.0), unit(np.cross(tailward, around)), tailward


# --- colours of the fish --------------------------------------------------------------------------

PALETTE = {
    "crimson": (0.82, 0.16, 0.12),
    "orange": (0.98, 0.45, 0.08),
    "gold": (1.00, 0.74, 0.22),
    "cream": (1.00, 0.95, 0.82),
    "teal": (0.05, 0.58, 0.62),
    "indigo": (0.17, 0.16, 0.48),
}


def paint(t: float, angle: float) -> str:
    """Name the colour of a scale: edged bands on a body that goes from dark back to pale belly."""
    back = np.sin(angle)
    wave = 0.025 * np.sin(3.0 * angle) + 0.05 * back
    for centre, half in ((0.335, 0.045), (0.60, 0.04), (0.845, 0.032)):
        off = abs(t - centre - wave)
        if off < half:
            return "cream"
        if off < half + 0.034:
            return "teal" if back > -0.35 else "indigo"
    if back > 0.86:
        return "indigo"
    if back > 0.5:
        return "crimson"
    if back > -0.25:
        return "orange"
    return "gold" if back > -0.8 else "cream"


def skin_texture(rng: np.random.Generator) -> Array:
    """Skin of the body: u around (0 left flank, 0.25 back, 0.75 belly), v from nose to tail."""
    size = 512
    u, v = texel_grid(size, size)
    back = np.sin(2.0 * np.pi * u)
    mottle = noise(rng, (size, size), 1.4, 6.0)
    wobble = 0.08 * noise(rng, (size, size), 2.2, 2.0)
    # Head: crimson crown, orange cheek, pale throat
    head = mix(PALETTE["gold"], PALETTE["orange"], smoothstep(-0.75, -0.1, back + wobble))
    head = mix(head, PALETTE["crimson"], smoothstep(0.45, 0.85, back + wobble))
    head = mix(head, PALETTE["cream"], smoothstep(-0.7, -0.98, back + wobble))
    head *= (1.0 + 0.05 * mottle)[..., None]
    # Blue freckles and lines that run back from the eye
    elevation = np.arcsin(back)
    flank = np.abs(elevation)
    for offset, slant in ((-0.42, -0.6), (-0.12, 0.1), (0.2, 0.8)):
        line = np.abs(elevation - offset - slant * (v - 0.13) * 4.0 + 0.05 * np.sin(60.0 * v))
        inside = smoothstep(0.075, 0.045, line) * smoothstep(0.10, 0.13, v) * smoothstep(0.26, 0.235, v)
        head = mix(head, PALETTE["teal"], inside)
    # Gill cover: a dark arc with a light rim
    arc = 0.262 - 0.035 * (flank / 1.2) ** 2
    head = mix(head, (0.25, 0.05, 0.12), 0.9 * smoothstep(0.012, 0.002, np.abs(v - arc)) * (flank < 1.15))
    head = mix(
        head,
        PALETTE["gold"],
        0.8 * smoothstep(0.008, 0.002, np.abs(v - arc + 0.016)) * (flank < 1.1),
    )
    # Mouth: a dark slit between pale lips
    slit = -0.28 - 1.6 * v
    lips = smoothstep(0.55, 0.25, np.abs(elevation - slit)) * smoothstep(0.075, 0.05, v)
    head = mix(head, (1.0, 0.62, 0.45), lips)
    head = mix(
        head,
        (0.25, 0.04, 0.07),
        smoothstep(0.14, 0.05, np.abs(elevation - slit)) * smoothstep(0.085, 0.07, v),
    )
    # Under the scales: dark, so that they stand out
    return mix(head, np.array([0.34, 0.12, 0.16]) + 0.02 * mottle[..., None], smoothstep(0.275, 0.29, v))


def scale_texture(colour: tuple[float, float, float], rng: np.random.Generator) -> Array:
    """One scale in polar coordinates: u the direction (0 tailward), v the angle from its middle."""
    u, v = texel_grid(96, 192)
    radius = v * 180.0 / 75.0
    along = radius * np.cos(2.0 * np.pi * u)
    base = np.array(colour)
    rays = np.cos(2.0 * np.pi * 22.0 * u) * smoothstep(0.15, 0.6, radius)
    grain = noise(rng, u.shape, 1.0, 4.0)
    shade = 0.80 + 0.30 * smoothstep(-0.8, 0.7, along) + 0.05 * rays + 0.025 * grain
    picture = base * shade[..., None]
    picture = mix(
        picture,
        np.sqrt(base) * 0.5 + 0.5,
        0.75 * smoothstep(0.13, 0.04, np.abs(radius - 0.62)) * (along > 0.1),
    )
    return mix(picture, base * 0.45, smoothstep(0.74, 0.95, radius))


def eye_texture(rng: np.random.Generator) -> Array:
    """The eye in polar coordinates: u the direction (0 up), v the angle from the optical axis."""
    u, v = texel_grid(256, 512)
    theta, phi = 180.0 * v, 2.0 * np.pi * u
    streak = noise(rng, (1, 512), 0.7, 3.0)[0] + 0.4 * noise(rng, (256, 512), 1.2, 3.0)
    iris = mix((0.95, 0.55, 0.05), (1.0, 0.92, 0.45), smoothstep(34.0, 26.0, theta + 3.0 * streak))
    iris = mix(iris, (0.62, 0.20, 0.04), smoothstep(38.0, 47.0, theta + 2.0 * streak))
    picture = mix(iris, (0.02, 0.02, 0.06), smoothstep(25.5, 24.0, theta))
    picture = mix(picture, (0.05, 0.08, 0.25), smoothstep(46.0, 48.0, theta))
    picture = mix(picture, (0.12, 0.70, 0.72), smoothstep(55.0, 57.0, theta))
    picture = mix(picture, (0.80, 0.25, 0.10), smoothstep(68.0, 74.0, theta))
    # A painted highlight above the pupil, and a faint one below it
    x, y = theta * np.cos(phi), theta * np.sin(phi)
    picture = mix(picture, (1.0, 1.0, 1.0), smoothstep(7.0, 5.5, np.hypot(x - 15.0, y - 7.0)))
    return mix(picture, (0.55, 0.65, 0.80), 0.7 * smoothstep(3.6, 2.6, np.hypot(x + 14.0, y + 8.0)))


def fin_texture(rng: np.random.Generator) -> Array:
    """Fin membrane with rays and a dark, bright-edged margin: u along the root, v to the tip."""
    u, v = texel_grid(256, 512)
    wobble = 0.05 * noise(rng, (256, 512), 2.0, 2.0)
    picture = mix(PALETTE["crimson"], PALETTE["orange"], smoothstep(0.0, 0.3, v + wobble))
    picture = mix(picture, PALETTE["gold"], smoothstep(0.25, 0.55, v + wobble))
    picture = mix(picture, PALETTE["teal"], smoothstep(0.58, 0.68, v + wobble))
    picture = mix(picture, PALETTE["indigo"], smoothstep(0.80, 0.86, v + wobble))
    picture = mix(picture, (0.85, 0.97, 1.0), smoothstep(0.93, 0.96, v))
    for row in (0.22, 0.42):
        spots = np.hypot((u * 16.0 + 8.0 * row) % 1.0 - 0.5, (v - row) * 9.0)
        picture = mix(picture, PALETTE["crimson"], 0.8 * smoothstep(0.34, 0.24, spots))
    rays = 0.5 + 0.5 * np.cos(2.0 * np.pi * 16.0 * u)
    return picture * (0.72 + 0.36 * rays**0.6)[..., None]


# --- the fish's meshes ----------------------------------------------------------------------------


def body_mesh() -> Mesh:
    """Skin of the body, closed around, from nose to the root of the tail."""
    t = np.linspace(0.0, 1.0, 97) ** 1.5
    u = np.linspace(1.0, 0.0, 65)
    tt, uu = np.meshgrid(t, u, indexing="ij")
    return grid_mesh(body_point(tt, 2.0 * np.pi * uu), np.stack([uu, tt], -1), around=True)


def tail_fin() -> Mesh:
    """Forked tail fin, waving across."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 65), np.linspace(0.0, 1.0, 25), indexing="ij")
    fan = 2.0 * u - 1.0
    reach = (
        TAIL_LENGTH * (0.50 + 0.62 * np.abs(fan) ** 1.3 - 0.12 * fan**4) * (1.0 + 0.025 * np.cos(2 * np.pi * 16 * u))
    )
    angle = np.radians(52.0) * fan
    along = 0.94 * BODY_LENGTH + v * reach * np.cos(angle) * 1.1
    rise = 0.4 + fan * 3.2 + v * reach * np.sin(angle) * 1.12
    point, _, up, side = spine(along)
    sway = 0.9 * v * np.sin(5.0 * fan + 2.0) + 0.12 * v * np.cos(2.0 * np.pi * 16.0 * u)
    return grid_mesh(point + up * rise[..., None] + side * sway[..., None], np.stack([u, v], -1))


def median_fin(start: float, stop: float, height: list[tuple[float, float]], lean: float, sign: float) -> Mesh:
    """Fin on the back (`sign` 1) or the belly (-1), from fraction `start` to `stop` of the body."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 97), np.linspace(0.0, 1.0, 13), indexing="ij")
    t = start + (stop - start) * u
    tall = curve(height, u) * (1.0 - 0.07 * np.abs(np.sin(np.pi * 11.0 * u)))
    rise = profile(AXIS_RISE, t) + sign * (profile(HALF_HEIGHT, t) * 0.93 + v * tall)
    point, _, up, side = spine(t * BODY_LENGTH + lean * v * tall)
    sway = v**1.5 * (1.3 * np.sin(9.0 * u + 0.6)) + 0.1 * v * np.cos(2.0 * np.pi * 16.0 * u)
    return grid_mesh(point + up * rise[..., None] + side * sway[..., None], np.stack([u, v], -1))


def paired_fin(t: float, angle: float, length: float, spread: float, sweep: tuple[float, float, float]) -> Mesh:
    """Fan-shaped fin on the skin; `sweep` is its direction in (tailward, up, outward) parts."""
    root, outward, tailward = body_frame(t, angle)
    _, _, up, _ = spine(np.array(t * BODY_LENGTH))
    direction = unit(sweep[0] * tailward + sweep[1] * up + sweep[2] * outward)
    across = unit(np.cross(np.cross(direction, up + 0.3 * outward), direction))
    bulge = np.cross(direction, across)
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 49), np.linspace(0.0, 1.0, 17), indexing="ij")
    fan = (2.0 * u - 1.0) * np.radians(spread)
    reach = length * v * (0.80 + 0.2 * np.cos(1.6 * fan)) * (1.0 + 0.03 * np.cos(2.0 * np.pi * 16.0 * u))
    point = root - 0.6 * outward + direction * (reach * np.cos(fan))[..., None]
    point = point + across * (reach * np.sin(fan) + 1.5 * fan)[..., None]
    cup = 0.10 * length * v**2 * np.cos(2.0 * fan) + 0.12 * v * np.cos(2.0 * np.pi * 16.0 * u)
    return grid_mesh(point + bulge * cup[..., None], np.stack([u, v], -1))


def fins_mesh() -> Mesh:
    """All fins of the fish in one mesh."""
    dorsal = [
        (0.0, 1.0),
        (0.1, 6.5),
        (0.25, 10.0),
        (0.5, 9.2),
        (0.75, 8.4),
        (0.92, 7.0),
        (1.0, 3.0),
    ]
    anal = [(0.0, 1.0), (0.2, 6.0), (0.5, 7.0), (0.85, 5.5), (1.0, 2.5)]
    return Mesh.join(
        [
            tail_fin(),
            median_fin(0.26, 0.84, dorsal, 0.55, 1.0),
            median_fin(0.62, 0.88, anal, 0.7, -1.0),
            paired_fin(0.31, -0.35, 15.0, 34.0, (0.80, -0.28, 0.50)),
            paired_fin(0.31, np.pi + 0.35, 15.0, 34.0, (0.45, 0.05, 0.95)),
            paired_fin(0.40, -1.15, 11.0, 24.0, (0.75, -0.75, 0.1)),
            paired_fin(0.40, np.pi + 1.15, 11.0, 24.0, (0.75, -0.75, 0.1)),
        ]
    )


def add_scales(scene: SceneFile, rng: np.random.Generator) -> int:
    """Cover the body with overlapping scale spheres in staggered rows; return their number."""
    pitch, count = 3.05, 0
    rows = round((SCALE_TO - SCALE_FROM) * BODY_LENGTH / 2.3)
    for row in range(rows):
        t = SCALE_FROM + (SCALE_TO - SCALE_FROM) * (row + 0.5) / rows
        ring = body_point(np.full(257, t), np.linspace(0.0, 2.0 * np.pi, 257))
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=-1))])
        size = 0.72 + 0.28 * smoothstep(12.0, 40.0, arc[-1])
        number = max(6, round(arc[-1] / (pitch * size)))
        for k in range(number):
            place = (k + 0.5 * (row % 2)) / number * arc[-1]
            angle = float(np.interp(place, arc, np.linspace(0.0, 2.0 * np.pi, 257)))
            point, outward, tailward = body_frame(t, angle)
            radius = 2.45 * size * (1.0 + 0.03 * rng.standard_normal())
            # Lift the tailward edge a little, as roof tiles are
            outward = unit(outward + 0.22 * tailward)
            tailward = unit(tailward - (tailward @ outward) * outward)
            axes = np.stack([tailward, np.cross(outward, tailward), outward])
            centre = point - 1.35 * size * outward
            scene.sphere(centre, radius, f"scale_{paint(t, angle)}", axes, name=f"fish-scale-{count}")
            count += 1
    return count


def add_eyes(scene: SceneFile) -> int:
    """Add both eyes, looking outward and a little ahead, with the top of the iris up."""
    for side, angle in (("left", 0.36), ("right", np.pi - 0.36)):
        point, outward, tailward = body_frame(0.135, angle)
        gaze = unit(outward - 0.25 * tailward)
        up = unit(np.array([0.0, 1.0, 0.0]) - gaze[1] * gaze)
        axes = np.stack([up, np.cross(gaze, up), gaze])
        scene.sphere(point - 0.9 * outward, 3.3, "eye", axes, name=f"fish-eye-{side}")
    return 2


# --- plants ---------------------------------------------------------------------------------------


def plant_texture(rng: np.random.Generator) -> Array:
    """Atlas of stems and leaves, one column for each of `PLANT_COLUMNS`; v from root to tip."""
    width, height, strips = 48, 384, []
    for name, hue in PLANT_COLUMNS.items():
        u, v = texel_grid(height, width)
        grain = noise(rng, (height, width), 1.3, 3.0)
        base = np.array(hue) * (1.0 + 0.07 * grain)[..., None]
        if name.endswith("leaf") or name == "pad":
            veins = np.abs(((v * 14.0 - 3.0 * np.abs(u - 0.5)) % 1.0) - 0.5)
            base = base * (0.82 + 0.35 * smoothstep(0.5, 0.1, np.abs(u - 0.5)))[..., None]
            base = mix(base, (0.86, 0.90, 0.60), 0.45 * smoothstep(0.12, 0.04, veins))
            base = mix(base, (0.90, 0.94, 0.66), 0.8 * smoothstep(0.07, 0.03, np.abs(u - 0.5)))
        elif name == "petal":
            base = mix(base, (1.0, 0.92, 0.90), smoothstep(0.75, 0.0, v))
            base = base * (0.94 + 0.08 * np.cos(2.0 * np.pi * 7.0 * u))[..., None]
        else:
            fibres = noise(rng, (1, width), 0.8, 2.0) + 0.5 * grain
            base = base * (1.0 + 0.10 * fibres)[..., None]
            knots = np.abs((v * 9.0 + 0.06 * np.sin(2.0 * np.pi * u)) % 1.0 - 0.5)
            if name != "brown":
                base = mix(base, base * 0.45, 0.9 * smoothstep(0.05, 0.02, knots))
                base = mix(base, (0.88, 0.88, 0.62), 0.55 * smoothstep(0.04, 0.02, np.abs(knots - 0.09)))
        strips.append(base)
    return np.concatenate(strips, axis=1)


def column_uv(name: str, u: Array, v: Array) -> Array:
    """Texture coordinates inside one column of the atlas, half a texel off its edges."""
    inset = 0.6 / 48.0
    return np.stack(
        [
            (list(PLANT_COLUMNS).index(name) + inset + (1.0 - 2.0 * inset) * u) / len(PLANT_COLUMNS),
            v,
        ],
        -1,
    )


def tube(path: Array, radius: Array, kind: str) -> Mesh:
    """Round stem along `(n, 3)` points; its texture goes round there and back, without a seam."""
    along = unit(np.gradient(path, axis=0))
    right = unit(np.cross(along, [0.0, 0.0, 1.0]))
    front = np.cross(right, along)
    turn = np.linspace(2.0 * np.pi, 0.0, 17)
    ring = np.cos(turn)[None, :, None] * right[:, None, :] + np.sin(turn)[None, :, None] * front[:, None, :]
    u = np.broadcast_to(np.abs(((turn / np.pi) + 0.5) % 2.0 - 1.0), ring.shape[:2])
    v = np.broadcast_to(np.linspace(0.0, 1.0, len(path))[:, None], ring.shape[:2])
    return grid_mesh(path[:, None, :] + ring * radius[:, None, None], column_uv(kind, u, v), normal=ring)


def leaf(root: Array, direction: Array, length: float, width: float, droop: float, kind: str) -> Mesh:
    """Lanceolate leaf that starts along `direction` and bends down by `droop` times its length."""
    v, u = np.meshgrid(np.linspace(0.0, 1.0, 13), np.linspace(0.0, 1.0, 5), indexing="ij")
    direction = unit(direction)
    across = unit(np.cross(direction, [0.0, 0.35, 1.0]))
    if abs(direction[1]) < 0.95:
        across = unit(0.6 * np.cross(direction, [0.0, 0.0, 1.0]) + 0.8 * np.cross(direction, [0.0, 1.0, 0.0]))
    wide = width * np.sin(np.pi * (0.04 + 0.96 * v) ** 0.75) ** 0.9 * (2.0 * u - 1.0) / 2.0
    point = root + direction * (length * v)[..., None] + across * wide[..., None]
    point[..., 1] -= droop * length * v**2 - 0.25 * np.abs(wide)
    return grid_mesh(point, column_uv(kind, u, v))


def stem_path(x: float, z: float, top: float, lean: float, bend: float) -> Array:
    """Points of a stem from just under the water to height `top`."""
    v = np.linspace(0.0, 1.0, 41)
    foot = water_level(z) - 4.0
    return np.stack(
        [x + lean * v**1.6 + bend * np.sin(2.2 * np.pi * v), foot + (top - foot) * v, z + 2.0 * v],
        -1,
    )


def add_leaves(parts: list[Mesh], path: Array, rng: np.random.Generator, count: int, size: float, kind: str) -> None:
    """Set `count` leaves on a stem, alternately left and right."""
    for k in range(count):
        at = path[int(np.interp(k, [0, max(count - 1, 1)], [11, len(path) - 4]))]
        side = 1.0 if k % 2 else -1.0
        direction = np.array([side * (0.8 + 0.2 * rng.random()), 0.55 + 0.3 * rng.random(), 0.5 * rng.random() - 0.1])
        long = size * (1.0 - 0.35 * k / count) * (0.9 + 0.2 * rng.random())
        parts.append(leaf(at, direction, long, 0.30 * long, 0.45, kind))


def plants_mesh(rng: np.random.Generator) -> Mesh:
    """All stems, leaves, flowers and lily pads."""
    parts: list[Mesh] = []

    def stem(x: float, z: float, top: float, lean: float, bend: float, radius: float, kind: str) -> Array:
        path = stem_path(x, z, top, lean, bend)
        parts.append(tube(path, np.linspace(radius, 0.55 * radius, len(path)), kind))
        return path

    # 20 mm behind the display: a cattail with blades
    path = stem(39.0, -20.0, 41.0, -2.0, 1.0, 1.15, "reed")
    head = path[26:38] * [1.0, 1.0, 1.0]
    parts.append(tube(head, 2.5 * np.sin(np.pi * np.linspace(0.06, 0.94, len(head))) ** 0.35, "brown"))
    for dx, tilt, long in ((1.5, 0.22, 50.0), (-1.5, -0.20, 42.0), (2.5, 0.5, 34.0)):
        root = np.array([39.0 + dx, water_level(-20.0) - 2.0, -20.0])
        parts.append(leaf(root, np.array([tilt, 1.0, 0.05]), long, 3.4, 0.10, "green leaf"))
    # 45 mm: a lotus
    path = stem(-38.0, -45.0, 31.0, -3.0, 1.6, 1.3, "red")
    add_leaves(parts, path[:32], rng, 4, 17.0, "red leaf")
    for ring, (count, rise, long) in enumerate(((9, 0.35, 12.0), (8, 0.9, 12.5), (6, 2.2, 11.0))):
        for k in range(count):
            turn = 2.0 * np.pi * (k + 0.5 * ring) / count
            direction = np.array([np.cos(turn), rise, np.sin(turn)])
            parts.append(leaf(path[-1] + [0.0, 0.4 * ring, 0.0], direction, long, 5.2, -0.35, "petal"))
    # 70 mm
    path = stem(17.0, -70.0, 48.0, 6.0, -2.0, 1.5, "teal")
    add_leaves(parts, path, rng, 9, 21.0, "teal leaf")
    # 100 mm
    path = stem(-13.0, -100.0, 52.0, -5.0, 2.2, 1.6, "olive")
    add_leaves(parts, path, rng, 9, 23.0, "olive leaf")
    # 115 mm: a few slender reeds
    for x, top, lean in ((50.0, 44.0, 5.0), (-57.0, 50.0, 6.0), (56.0, 34.0, 7.0)):
        path = stem(x, -115.0, top, lean, 1.2, 1.2, "pale")
        add_leaves(parts, path, rng, 5, 18.0, "green leaf")
    # Lily pads on the water
    pads = (
        (-47.0, -18.0, 9.0, 0.4),
        (-33.0, -62.0, 8.0, 2.0),
        (33.0, -88.0, 9.0, 4.0),
        (49.0, 12.0, 7.5, 2.6),
        (3.0, -118.0, 9.0, 1.0),
    )
    for x, z, radius, turn in pads:
        v, u = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 1.0, 33), indexing="ij")
        angle = turn + 0.25 + (2.0 * np.pi - 0.5) * u
        px, pz = x + radius * v * np.cos(angle), z + radius * v * np.sin(angle)
        py = water_level(pz) + 0.3 + 0.15 * (1.0 - v) + 0.1 * v * np.sin(5.0 * angle)
        parts.append(grid_mesh(np.stack([px, py, pz], -1), column_uv("pad", u * 5.0 % 1.0 * 0.9 + 0.05, v)))
    return Mesh.join(parts)


# --- water and sky --------------------------------------------------------------------------------


def water_mesh(rng: np.random.Generator) -> Mesh:
    """Rippled surface with exact normals: wind waves, rings round the stems and under the fish."""
    near, far = np.arange(-128.0, 129.0, 2.0), np.linspace(130.0, HALF_WIDTH, 20)
    x = np.concatenate([-far[::-1], near, far])
    z = np.arange(SKY_BACK - 3.0, WATER_FRONT + 1.0, 1.75)
    z[-1] = WATER_FRONT
    zz, xx = np.meshgrid(z, x, indexing="ij")
    height, slope_x, slope_z = water_level(zz), np.zeros_like(zz), water_slope(zz)
    for length in np.geomspace(9.0, 46.0, 12):
        heading = np.pi / 2.0 + 0.75 * rng.standard_normal()
        kx, kz = 2.0 * np.pi / length * np.array([np.cos(heading), np.sin(heading)])
        steep = 0.017
        phase = kx * xx + kz * zz + 2.0 * np.pi * rng.random()
        height = height + steep * length / (2.0 * np.pi) * np.cos(phase)
        slope_x, slope_z = (
            slope_x - steep * length / (2.0 * np.pi) * kx * np.sin(phase),
            (slope_z - steep * length / (2.0 * np.pi) * kz * np.sin(phase)),
        )
    rings = (
        (39.0, -20.0, 0.05),
        (-38.0, -45.0, 0.05),
        (17.0, -70.0, 0.05),
        (-13.0, -100.0, 0.05),
        (3.0, 16.0, 0.085),
    )
    for cx, cz, steep in rings:
        k, reach = 2.0 * np.pi / 7.0, 20.0
        r = np.hypot(xx - cx, zz - cz) + 1e-6
        fade = np.exp(-r / reach) * (1.0 - np.exp(-((r / 4.0) ** 2)))
        height = height + steep / k * fade * np.cos(k * r)
        slope = -steep * fade * np.sin(k * r) - steep / k / reach * fade * np.cos(k * r)
        slope_x, slope_z = slope_x + slope * (xx - cx) / r, slope_z + slope * (zz - cz) / r
    normal = unit(np.stack([-slope_x, np.ones_like(slope_x), -slope_z], -1))
    mesh = grid_mesh(np.stack([xx, height, zz], -1), np.zeros((*xx.shape, 2)), normal)
    mesh.face = mesh.face[:, ::-1].copy()
    return mesh


def skirt_mesh(water: Mesh) -> Mesh:
    """The cut face under the near edge of `water`, seen only from below the display's middle."""
    edge = water.position[water.position[:, 2] == WATER_FRONT]
    edge = edge[np.argsort(-edge[:, 0])]
    foot = np.where([False, True, False], -150.0, edge)
    position = np.stack([edge, foot])
    normal = np.broadcast_to([0.0, 0.0, 1.0], position.shape)
    return grid_mesh(position, np.zeros((*position.shape[:2], 2)), normal)


SKY_TOP, SKY_FOOT = 330.0, -60.0


def sky_mesh() -> Mesh:
    """Backdrop behind everything: upright, bending forward far above and at the sides."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 65), np.linspace(0.0, 1.0, 65), indexing="ij")
    x = HALF_WIDTH * (2.0 * u - 1.0)
    y = SKY_TOP + (SKY_FOOT - SKY_TOP) * v
    z = SKY_BACK + 90.0 * smoothstep(120.0, 420.0, y) + 70.0 * smoothstep(130.0, 420.0, np.abs(x))
    return grid_mesh(np.stack([x, y, z], -1), np.stack([u, v], -1))


def sky_texture(rng: np.random.Generator) -> Array:
    """Evening sky, first row on top: peach at the horizon, blue above, cumulus and thin cloud."""
    height, width = 640, 1000
    _, v = texel_grid(height, width)
    y = SKY_TOP + (SKY_FOOT - SKY_TOP) * v
    sky = mix((1.00, 0.83, 0.66), (0.78, 0.84, 0.93), smoothstep(-8.0, 28.0, y))
    sky = mix(sky, (0.42, 0.66, 0.92), smoothstep(12.0, 75.0, y))
    sky = mix(sky, (0.20, 0.44, 0.80), smoothstep(60.0, 190.0, y))
    # Thin cloud, drawn out sideways
    thin = noise(rng, (height, width // 4), 1.7, 6.0)
    thin = np.stack([np.interp(np.arange(width) / 4.0, np.arange(width // 4), row, period=width // 4) for row in thin])
    sky = mix(sky, (1.0, 0.93, 0.90), 0.45 * smoothstep(0.2, 2.2, thin))
    # Cumulus: denser in a belt, its light side up and to the left
    field = noise(rng, (height, width), 1.55, 9.0)
    belt = 0.75 * np.exp(-(((y - 42.0) / 32.0) ** 2)) - 0.35
    cover = smoothstep(0.25, 0.85, field + belt)
    lit = sum(field - np.roll(field, (3 * k, 2 * k), axis=(0, 1)) for k in (1, 2, 4))
    cloud = mix((0.74, 0.75, 0.86), (1.0, 0.98, 0.96), smoothstep(-1.1, 0.9, lit))
    cloud = mix(cloud, (1.0, 0.82, 0.74), 0.6 * smoothstep(45.0, 5.0, y))
    return mix(sky, cloud, 0.95 * cover)


# --- the scene ------------------------------------------------------------------------------------


def main() -> None:
    """Write textures, meshes and the scene."""
    rng = np.random.default_rng(SEED)
    scene = SceneFile("Fish above rippling water: made by make_fish.py, millimetres in the display's frame")
    textures = {
        "skin": skin_texture(rng),
        "eye": eye_texture(rng),
        "fins": fin_texture(rng),
        "plants": plant_texture(rng),
        "sky": sky_texture(rng),
        **{f"scale_{name}": scale_texture(colour, rng) for name, colour in PALETTE.items()},
    }
    for name, picture in textures.items():
        save_texture(HERE / f"{name}.png", picture)
        scene.diffuse(name, f"{name}.png", two_sided=name in ("fins", "plants", "sky", "skin"))
    scene.diffuse("deep", (0.05, 0.16, 0.22), two_sided=True)
    scene.mirror("water", (0.60, 0.76, 0.84))

    # Five lights: high, or far to the sides, so that shadows fall on the water or outside the
    # window, and not on the sky
    scene.point_light((-450.0, 1200.0, 950.0), (1.18, 1.14, 1.06))
    scene.point_light((500.0, 1150.0, 800.0), (0.96, 0.96, 0.95))
    scene.point_light((0.0, 1150.0, 850.0), (0.96, 0.96, 0.97))
    scene.point_light((-1350.0, -75.0, 420.0), (0.78, 0.74, 0.67))
    scene.point_light((1350.0, -75.0, 420.0), (0.61, 0.66, 0.75))

    water = water_mesh(rng)
    meshes = {
        "body": (body_mesh(), "skin"),
        "fins": (fins_mesh(), "fins"),
        "plants": (plants_mesh(rng), "plants"),
        "water": (water, "water"),
        "skirt": (skirt_mesh(water), "deep"),
        "sky": (sky_mesh(), "sky"),
    }
    for name, (mesh, material) in meshes.items():
        mesh.save(HERE / f"{name}.ply", with_uv=name != "water")
        scene.ply(f"{name}.ply", material, name=f"fish-{name}" if name in FISH_MESHES else None)
    spheres = add_scales(scene, rng) + add_eyes(scene)
    scene.save(HERE / "fish.xml")
    triangles = sum(len(mesh.face) for mesh, _ in meshes.values())
    print(f"fish.xml: {spheres} spheres, {triangles} triangles in {len(meshes)} meshes, {len(textures)} textures")


if __name__ == "__main__":
    main()
