"""Reads a film of layers for a board: a folder of layers, and motions from a TOML file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from lippmann.base import toml
from lippmann.base.toml import documented, key
from lippmann.display.description import Display
from lippmann.errors import did_you_mean, input_error, likely_file, located
from lippmann.layers.layers_and_pictures import Light, check_depth, is_layers, load_named_layers
from lippmann.layers.stack import Layer, LayerStack
from lippmann.motion.film import MAX_FRAMES, FrameNumber, Motion, check_frames, interpolate
from lippmann.scenes.placement import ORIGIN, Number, Scale, Triple

#: Frames per second of a folder of layers, which has a single frame.
STILL_RATE = 12.0
Pair = tuple[Number, Number]


@documented
@dataclass(frozen=True)
class LayerKey:
    """A layer's motion at one frame."""

    frame: FrameNumber
    offset_mm: Annotated[Triple, key("shift from the position at rest; z is towards the viewer")] = ORIGIN
    rotation_deg: Annotated[Number, key("rotation about z, counterclockwise")] = 0.0
    scale: Annotated[Scale, key("factor of the size")] = 1.0
    shear: Annotated[Number, key("shift to the right of what is 1 mm higher, mm")] = 0.0
    brightness: Annotated[Light, key("factor on the layer's own brightness")] = 1.0
    visible: Annotated[bool, key("whether the layer is drawn, from this frame on")] = True
    order: Annotated[float | None, key("place from front to back, from this frame on", default="as in the folder")] = (
        None
    )


@documented
@dataclass(frozen=True, kw_only=True)
class MovingLayer:
    """A layer that moves."""

    name: Annotated[str, key("name of the layer: its picture's, without `.png`")]
    keys: Annotated[tuple[LayerKey, ...], key("motion at some frames; at least one"), Meta(min_length=1)]
    pivot_mm: Annotated[Pair, key("centre of rotation, scaling and shear", shape="[x, y]")] = (0.0, 0.0)
    motion: Annotated[Motion | None, key("interpolation between keys", default="the film's")] = None


@dataclass(frozen=True, kw_only=True)
class LayerFilmFile:
    """The keys of a film of layers."""

    layers: Annotated[Path, key("a folder of layers; its path is relative to the film file")]
    frames: Annotated[int, key("number of frames, numbered from 0", low=1, high=MAX_FRAMES)]
    frames_per_second: Annotated[float, key("speed", low=0.1, high=1000.0)] = STILL_RATE
    motion: Annotated[Motion, key("interpolation between keys")] = "smooth"
    layer: tuple[MovingLayer, ...] = ()


@dataclass(frozen=True)
class LayerFilm:
    """A stack at rest, the names of its layers, and the motions of some layers."""

    stack: LayerStack
    names: tuple[str, ...]
    frames: int = 1
    frames_per_second: float = STILL_RATE
    motion: Motion = "smooth"
    moving: tuple[MovingLayer, ...] = ()

    def at(self, frame: int) -> tuple[LayerStack, tuple[int, ...]]:
        """Return a frame's stack, front to back, and its layers' indices in the stack at rest."""
        layers = list(self.stack.layers)
        order = [float(number) for number in range(len(layers))]
        for one in self.moving:
            number = self.names.index(one.name)
            layers[number] = _move_layer(layers[number], one, frame, self.motion)
            last = _last_key(one, frame)
            if last is not None and last.order is not None:
                order[number] = last.order
        numbers = tuple(sorted(range(len(layers)), key=lambda number: (order[number], number)))
        return replace(self.stack, layers=tuple(layers[number] for number in numbers)), numbers

    def depths_mm(self) -> Iterator[tuple[str, float]]:
        """Yield the name and the depth of each visible layer, frame by frame."""
        for frame in range(self.frames):
            stack, numbers = self.at(frame)
            for number, layer in zip(numbers, stack.layers, strict=True):
                if layer.visible:
                    yield self.names[number], layer.depth_mm


def load_layer_film(path: str | Path) -> LayerFilm:
    """Read a film or a folder of layers; raise InputError with file, key and remedy."""
    path = Path(path)
    if is_layers(path) or path.is_dir():
        return LayerFilm(*load_named_layers(path))
    if not path.exists():
        remedy = likely_file(path, (".toml",)) or "give a film of layers (.toml), or a folder that lippmann layers made"
        raise input_error(path, "no such file", remedy)
    film = toml.read(LayerFilmFile, toml.load(path, "film-of-layers"), str(path))
    with located(f"{path}: layers"):
        stack, names = load_named_layers(path.parent / film.layers)
    moving: set[str] = set()
    for place, one in enumerate(film.layer):
        where = f"{path}: layer[{place}]"
        if one.name not in names:
            remedy = did_you_mean(one.name, names) or f"choose from {', '.join(names)}"
            raise input_error(f"{where}.name", f"{film.layers} has no layer '{one.name}'", remedy)
        if one.name in moving:
            raise input_error(f"{where}.name", f"'{one.name}' moves already", "use one table for all keys of a layer")
        moving.add(one.name)
        check_frames([one_key.frame for one_key in one.keys], film.frames, where)
        if stack.layers[names.index(one.name)].sky:
            for number, sky_key in enumerate(one.keys):
                if sky_key.offset_mm != ORIGIN:
                    what = f"'{one.name}' is a sky, which cannot be shifted"
                    raise input_error(f"{where}.keys[{number}].offset_mm", what, "give the layer a depth in its folder")
    return LayerFilm(stack, names, film.frames, film.frames_per_second, film.motion, film.layer)


def _last_key(moving: MovingLayer, frame: int) -> LayerKey | None:
    reached = [one for one in moving.keys if one.frame <= frame]
    return reached[-1] if reached else None


def _move_layer(layer: Layer, moving: MovingLayer, frame: int, motion: Motion) -> Layer:
    numbers = np.array(
        [(*one.offset_mm, one.rotation_deg, one.scale, one.shear, one.brightness) for one in moving.keys]
    )
    frames = np.array([one.frame for one in moving.keys], np.float64)
    x, y, z, turn, scale, shear, brightness = interpolate(frames, numbers, moving.motion or motion, frame).tolist()
    angle = np.deg2rad(turn)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    from_rest = scale * rotation @ np.array([[1.0, shear], [0.0, 1.0]])
    # A point p of the resting layer moves to pivot + from_rest (p - pivot) + shift.
    pivot = np.array(moving.pivot_mm)
    linear = layer.matrix[:, :2] @ np.linalg.inv(from_rest)
    zero = layer.matrix[:, 2] + layer.matrix[:, :2] @ pivot - linear @ (pivot + np.array([x, y]))
    last = _last_key(moving, frame)
    visible = layer.visible if last is None else layer.visible and last.visible
    return replace(
        layer,
        matrix=np.column_stack([linear, zero]),
        depth_mm=layer.depth_mm + z,
        brightness=float(np.clip(layer.brightness * brightness, 0.0, 1.0)),
        visible=visible,
    )


def check_keys(film: LayerFilm, display: Display, path: str | Path) -> None:
    """Raise InputError if a frame has an invalid layer, such as one behind the eyes."""
    for frame in range(film.frames):
        with located(f"{path}: frame {frame}"):
            stack, numbers = film.at(frame)
        for number, layer in zip(numbers, stack.layers, strict=True):
            check_depth(layer.depth_mm, display, f"{path}: frame {frame}: layer '{film.names[number]}': depth")
