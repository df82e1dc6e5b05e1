"""Random stacks of layers for a display, from one seed, and the float64 drawing that this project's definitions give.

The drawing is written apart from `lippmann.layers` and `lippmann.fixed`: it judges golden and the integer twin.
"""

import math

import numpy as np
from lippmann.errors import InputError
from lippmann.fixed.scene_configuration import scene_words
from lippmann.layers.stack import MAX_LAYERS, Layer, LayerStack


def random_palette(rng):
    """A palette of any colours: opaque, transparent and everything between, black and white among them."""
    palette = rng.integers(0, 256, (256, 4), dtype=np.uint8)
    palette[:, 3] = np.where(rng.random(256) < 0.6, rng.choice([0, 255, 127, 128], 256), palette[:, 3])
    palette[:2] = (0, 0, 0, 255), (255, 255, 255, 255)
    palette[255, 3] = 0
    return palette


def smooth_palette(rng):
    """A palette whose neighbours are alike: a ramp of colour and one of opacity, as pictures with soft edges have."""
    ramp = np.linspace(0.0, 255.0, 256)
    ends = rng.integers(0, 256, (2, 3))
    colours = ends[0] + (ends[1] - ends[0]) * ramp[:, None] / 255.0
    alpha = np.clip(rng.uniform(-300.0, 300.0) + rng.choice([2.0, 4.0]) * ramp, 0.0, 255.0)
    return np.concatenate([colours, alpha[:, None]], axis=1).astype(np.uint8)


def random_texels(rng, width, height, smooth):
    if not smooth:
        return rng.integers(0, 256, (height, width), dtype=np.uint8)
    t, s = np.mgrid[:height, :width]
    waves = sum(np.sin(rng.uniform(0.0, 0.2) * s + rng.uniform(0.0, 0.2) * t + rng.uniform(0.0, 6.3)) for _ in range(3))
    return np.clip(127.5 + 45.0 * waves, 0.0, 255.0).astype(np.uint8)


def random_layer(rng, display, build, smooth):
    """A layer at any depth, in view: turned, sheared and mirrored, larger or smaller than the panel."""
    radius, panel = display.array.radius_mm, display.panel
    size = math.hypot(panel.width_mm, panel.height_mm)
    full = rng.random() < 0.5
    width = build.width if full else int(rng.integers(1, build.width + 1))
    height = build.height if full else int(rng.integers(1, build.height + 1))
    sky = rng.random() < 0.15
    depth = math.inf if sky else float(rng.choice([-1.0, 1.0, 1.0, 1.0]) * radius * np.exp(rng.uniform(0.0, 5.5)))
    # What is seen of the plane: the panel, and more the farther it is.
    seen = 1.2 if sky else size + 0.6 * abs(depth)
    side = seen * float(np.exp(rng.uniform(-1.5, 0.7)))
    if smooth:  # as a cut is: no texel is finer than what a pixel sees there
        pixel = panel.pitches_mm[0] * (display.array.index - 1.0) / radius
        side = max(side, max(width, height) * pixel * (1.0 if sky else abs(depth)))
    angle = float(rng.choice([0.0, 0.0, math.pi / 2, rng.uniform(0.0, 6.3)]))
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    skew = np.array([[1.0, rng.uniform(-0.4, 0.4)], [0.0, -rng.choice([1.0, -1.0])]])
    linear = np.array([[width / side, 0.0], [0.0, height / side]]) @ skew @ turn
    middle = np.array([0.5 * width, 0.5 * height]) - linear @ rng.uniform(-0.4, 0.4, 2) * seen
    palette = smooth_palette(rng) if smooth else random_palette(rng)
    if not full and not (palette[:, 3] == 0).any():
        palette[0, 3] = 0
    return Layer(
        random_texels(rng, width, height, smooth), palette, depth, np.column_stack([linear, middle]),
        float(rng.choice([256, 256, rng.integers(0, 257)])) / 256.0, bool(rng.random() < 0.9),
    )  # fmt: skip


def random_stack(rng, display, build, layers=None, smooth=False):
    """A stack that the registers hold, of `layers` layers, or of up to as many as the build has."""
    count = int(rng.integers(1, build.layers + 1)) if layers is None else layers
    chosen = []
    for _ in range(1000):
        if len(chosen) == count:
            return LayerStack(tuple(chosen), rng.uniform(0.0, 1.0, 3))
        layer = random_layer(rng, display, build, smooth)
        try:
            scene_words(display, LayerStack((layer,)), build)
        except InputError:
            continue
        chosen.append(layer)
    raise AssertionError(f"no layers for {display}")


def free_layer(random, display, most=64):
    """A layer of any size, depth, turn, shear, flip and opacity, which covers some of the display or nearly none."""
    height, width = random.integers(1, most + 1, 2)
    palette = random.integers(0, 256, (256, 4), np.uint8)
    # Half of the palettes have many opaque and transparent colours, as pictures have.
    if random.random() < 0.5:
        palette[:, 3] = random.choice([0, 255, 127, 128, 254], 256)
    texels = random.integers(0, 256, (height, width), np.uint8)
    side = display.panel.width_mm
    sky = random.random() < 0.2
    scale = np.exp(random.uniform(-1.0, 2.0)) * np.array([width, height]) / (0.3 if sky else side)
    angle = random.choice([0.0, random.uniform(-math.pi, math.pi)])
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    linear = np.diag(scale * random.choice([-1.0, 1.0], 2)) @ turn
    linear += random.choice([0.0, 0.2]) * random.normal(size=(2, 2))
    shift = random.uniform(-0.2, 1.2, 2) * (width, height)
    depth = math.inf if sky else float(random.choice([0.0, random.uniform(-60.0, 60.0)]))
    brightness = float(random.choice([0.0, 1.0, random.random()]))
    return Layer(texels, palette, depth, np.column_stack([linear, shift]), brightness, bool(random.random() < 0.9))


def free_stack(random, display, most=64):
    """1 to 8 layers in any order of depths, before any background."""
    count = int(random.integers(1, MAX_LAYERS + 1))
    return LayerStack(tuple(free_layer(random, display, most) for _ in range(count)), random.random(3))


def float_lines(rays):
    """Where rays meet the plane z = 0 of the display's frame, mm, and their slopes."""
    origin, direction = rays.origin_mm.T, rays.direction.T
    slope_x, slope_y = direction[:2] / direction[2]
    return origin[0] - slope_x * origin[2], origin[1] - slope_y * origin[2], slope_x, slope_y


def float_coordinates(layer, x, y, slope_x, slope_y):
    """Texture coordinates (2, N) where lines through (x, y, 0), mm, meet a layer."""
    at = np.stack([slope_x, slope_y]) if math.isinf(layer.depth_mm) else (
        np.stack([x + layer.depth_mm * slope_x, y + layer.depth_mm * slope_y])
    )  # fmt: skip
    return layer.matrix[:, :2] @ at + layer.matrix[:, 2:]


def float_light(stack, lines, draws, bilinear):
    """Linear light (N, 3), 1 at white, of lines x, y (mm at z = 0), slope_x, slope_y; back to front, unlike the RTL."""
    light = np.tile(np.asarray(stack.background, np.float64), (len(lines[0]), 1))
    for layer in reversed(stack.layers):
        if not layer.visible:
            continue
        s, t = float_coordinates(layer, *lines)
        colour, cover = np.zeros_like(light), np.zeros(len(s))
        rows, columns = layer.texels.shape
        for dj in (0, 1) if bilinear else (0,):
            for di in (0, 1) if bilinear else (0,):
                i, j = (np.floor(s - 0.5) + di, np.floor(t - 0.5) + dj) if bilinear else (np.floor(s), np.floor(t))
                weight = np.maximum(0.0, 1.0 - abs(s - i - 0.5)) * np.maximum(0.0, 1.0 - abs(t - j - 0.5))
                weight = weight if bilinear else np.ones(len(s))
                inside = (i >= 0) & (j >= 0) & (i < columns) & (j < rows)
                index = layer.texels[np.where(inside, j, 0).astype(int), np.where(inside, i, 0).astype(int)]
                r, g, b, a = (layer.palette[index, k].astype(np.float64) for k in range(4))
                opacity = weight * inside * (a + np.where(a > 127.5, 1.0, 0.0)) / 256.0
                colour += opacity[:, None] * np.stack([r, g, b], axis=1) ** 2 / 65025.0
                cover += opacity
        light = layer.brightness * colour + (1.0 - cover)[:, None] * light
    return np.where(np.asarray(draws)[:, None], light, 0.0)
