"""Random stacks of layers for a display, from one generator."""

import math

import numpy as np
from lippmann.layers.stack import MAX_LAYERS, Layer, LayerStack


def random_layer(random, display, most=64):
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


def random_stack(random, display, most=64):
    """1 to 8 layers in any order of depths, before any background."""
    count = int(random.integers(1, MAX_LAYERS + 1))
    return LayerStack(tuple(random_layer(random, display, most) for _ in range(count)), random.random(3))
