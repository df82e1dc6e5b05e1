"""Reads a film from a TOML file: scene, number of frames, and paths of moving objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from msgspec import Meta

from lippmann.base import toml
from lippmann.base.toml import documented, key, values
from lippmann.errors import input_error
from lippmann.optics.rays import Floats
from lippmann.scenes.formats import kind_of
from lippmann.scenes.placement import ORIGIN, Placement, Scale, Triple
from lippmann.scenes.scene import Move

Motion = Literal["smooth", "linear"]
FrameNumber = Annotated[int, key("frame number; greater than that of the key before", low=0)]


def interpolate(frames: Floats, numbers: Floats, motion: Motion | None, frame: float) -> Floats:
    """Return numbers (N,) at a frame, interpolated from numbers (K, N) at the key frames (K,)."""
    from scipy.interpolate import PchipInterpolator

    place = np.clip(frame, frames[0], frames[-1])
    if motion != "linear" and len(frames) > 1:
        return np.asarray(PchipInterpolator(frames, numbers)(place))
    return np.array([np.interp(place, frames, column) for column in numbers.T])


@documented
@dataclass(frozen=True)
class Key:
    """An object's motion at one frame: scaling, rotation and shift."""

    frame: FrameNumber
    offset_mm: Annotated[Triple, key("shift from the position at rest")] = ORIGIN
    rotation_deg: Annotated[Triple, key("rotation about x, then y, then z; 360 is a turn")] = ORIGIN
    scale: Annotated[Scale, key("factor of the size")] = 1.0


@documented
@dataclass(frozen=True)
class MotionPath:
    """The keys of an object's path. The object stands still before the first and after the last key.

    "smooth" interpolates each component by cubics that never go beyond a key (Fritsch
    and Butland, "A method for constructing local monotone piecewise cubic
    interpolants", 1984). If `motion` is None, the film's applies, by default "smooth".
    """

    keys: Annotated[tuple[Key, ...], key("positions at some frames; at least one"), Meta(min_length=1)]
    pivot_mm: Annotated[Triple, key("centre of rotation and scaling, before the motion")] = ORIGIN
    motion: Annotated[Motion | None, key("interpolation between keys", default="the film's")] = None

    def at(self, frame: int) -> Placement:
        """Return the motion from the rest position to that at a frame, in the display's coordinates."""
        frames = np.array([key.frame for key in self.keys], np.float64)
        numbers = np.array([(*key.offset_mm, *key.rotation_deg, key.scale) for key in self.keys])
        x, y, z, about_x, about_y, about_z, scale = interpolate(frames, numbers, self.motion, frame).tolist()
        turned = Placement(scale, (about_x, about_y, about_z))
        pivot = np.array(self.pivot_mm)
        x, y, z = (np.array([x, y, z]) + pivot - turned.display_from_scene[:3, :3] @ pivot).tolist()
        return replace(turned, offset_mm=(x, y, z))


#: Maximum frames of a film; file names have four digits.
MAX_FRAMES = 10_000
AnyPath = TypeVar("AnyPath", bound=MotionPath)
Depth = Annotated[float | None, key("", default="the placement's, extended by the motions")]


@documented
@dataclass(frozen=True, kw_only=True)
class Moving(MotionPath):
    """A moving object of a film: shapes, and their path."""

    shapes: Annotated[str, key("id of the shapes in the scene file; `*` stands for any text, `?` for any character")]


@dataclass(frozen=True, kw_only=True)
class FilmFile:
    """The keys of a film file. Objects that share a shape move it in file order; then `world` moves all shapes."""

    scene: Annotated[Path, key("a Mitsuba scene; its path is relative to the film file")]
    frames: Annotated[int, key("number of frames, numbered from 0", low=1, high=MAX_FRAMES)]
    frames_per_second: Annotated[float, key("speed; at most 50 for a `.gif`", low=0.1, high=1000.0)] = 12.0
    motion: Annotated[Motion, key("interpolation between keys")] = "smooth"
    near_mm: Annotated[Depth, key("depth z at which primary rays start: in front of all objects in all frames")] = None
    far_mm: Annotated[Depth, key("farthest depth z that matters in any frame")] = None
    object: tuple[Moving, ...] = ()
    world: MotionPath | None = None


@documented
@dataclass(frozen=True, kw_only=True)
class Film(FilmFile):
    """A film; `name` is its file name without extension, and `scene` is an absolute path."""

    name: str

    @property
    def key_frames(self) -> list[int]:
        """The first, the last and all keys' frames, where each motion component has its extremes."""
        paths = [*self.object, self.world] if self.world is not None else self.object
        return sorted({0, self.frames - 1, *(one.frame for path in paths for one in path.keys)})

    def moves(self, frame: int, placement: Placement) -> tuple[Move, ...]:
        """Return the objects' motions at a frame, in scene coordinates."""
        forward, back = placement.display_from_scene, placement.scene_from_display
        return tuple(Move(one.shapes, back @ one.at(frame).display_from_scene @ forward) for one in self.object)

    def placement(self, frame: int, placement: Placement, film_placement: Placement | None = None) -> Placement:
        """Return the scene's placement at a frame, moved by `world`, then by `film_placement`."""
        if self.world is not None:
            placement = placement.then(self.world.at(frame))
        if film_placement is not None:
            placement = placement.then(film_placement)
        near = placement.near_mm if self.near_mm is None else self.near_mm
        far = placement.far_mm if self.far_mm is None else self.far_mm
        return replace(placement, near_mm=near, far_mm=far)


def is_film(path: str | Path) -> bool:
    """Tell whether a path is a film: a TOML file that is not a scene."""
    path = Path(path)
    return path.suffix.lower() == ".toml" and path.is_file() and kind_of(path) is None


def load_film(path: str | Path) -> Film:
    """Read a film file; raise InputError with file, key and remedy."""
    path = Path(path)
    film = Film(**values(toml.read(FilmFile, toml.load(path, "film"), str(path))), name=path.stem)
    near, far = film.near_mm, film.far_mm
    if near is not None and far is not None and near <= far:
        what = f"near_mm {near:g} is not in front of far_mm {far:g}"
        raise input_error(path, what, "raise near_mm: +z is towards the eye")
    world = film.world and _with_motion(film.world, film, f"{path}: world")
    moving = tuple(_with_motion(one, film, f"{path}: object[{place}]") for place, one in enumerate(film.object))
    return replace(film, scene=(path.parent / film.scene).absolute(), object=moving, world=world)


def check_frames(key_frames: Sequence[int], frames: int, where: str) -> None:
    """Raise InputError if keys are not in order, or are beyond a film's last frame."""
    before = -1
    for place, frame in enumerate(key_frames):
        key_name = f"{where}.keys[{place}].frame"
        if frame >= frames:
            raise input_error(key_name, f"{frame} is beyond the film's last frame", f"give at most {frames - 1}")
        if frame <= before:
            raise input_error(key_name, f"{frame} does not come after {before}", "sort the keys, at most one per frame")
        before = frame


def _with_motion(path: AnyPath, film: Film, where: str) -> AnyPath:
    check_frames([one.frame for one in path.keys], film.frames, where)
    return replace(path, motion=path.motion or film.motion)
