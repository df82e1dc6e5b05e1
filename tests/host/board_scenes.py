"""Small displays that draw, and random layers for them."""

import dataclasses
import math

import numpy as np
from lippmann.display.description import load_display
from lippmann.fixed.drawn_frame import draw
from lippmann.fixed.scene_build import SceneBuild
from lippmann.layers.stack import Layer, LayerStack
from lippmann.simulation import virtual_board

WIDTH, HEIGHT = 112, 80
#: Few blocks: three of texels and the palette's.
USUAL = SceneBuild(layers=3, slots=4, width=64, height=48)


def display_of(grid, size=(WIDTH, HEIGHT), rotation_deg=1.5):
    display = load_display(f"scenes/displays/paper-{grid}.toml")
    panel = dataclasses.replace(display.panel, width_px=size[0], height_px=size[1])
    array = dataclasses.replace(display.array, rotation_deg=rotation_deg)
    return dataclasses.replace(display, name=f"small {grid}", panel=panel, array=array)


def random_layer(rng, display, build, sky=False):
    """A texture of noise that lies over the panel, turned, sheared and scaled by chance; one colour is clear."""
    palette = rng.integers(0, 256, (256, 4), np.uint8)
    palette[rng.integers(256), 3] = 0
    texels = rng.integers(0, 256, (build.height, build.width), np.uint8)
    size = np.array([display.panel.width_mm, display.panel.height_mm]) * rng.uniform(0.5, 1.5, 2)
    if sky:
        size = np.array([0.6, 0.6])
    angle = rng.uniform(-math.pi, math.pi)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    linear = np.diag([build.width, -build.height] / size) @ turn @ np.array([[1.0, rng.uniform(-0.3, 0.3)], [0.0, 1.0]])
    zero = np.array([build.width, build.height]) * rng.uniform(0.3, 0.7, 2)
    depth = math.inf if sky else rng.uniform(-15.0, 15.0)
    return Layer(texels, palette, depth, np.column_stack([linear, zero]), rng.uniform(0.2, 1.0), rng.random() < 0.9)


def random_stack(rng, display, build):
    count = int(rng.integers(1, build.layers + 1))
    layers = [random_layer(rng, display, build, sky=k == count - 1 and rng.random() < 0.5) for k in range(count)]
    return LayerStack(tuple(layers), rng.random(3))


def moved(rng, display, build, stack):
    layers = []
    for layer in stack.layers:
        other = random_layer(rng, display, build, layer.sky)
        layers.append(dataclasses.replace(other, texels=layer.texels, palette=layer.palette))
    return dataclasses.replace(stack, layers=tuple(layers))


def twin(display, stack, build):
    return draw(display, virtual_board.board_build(display, build), stack, build)
