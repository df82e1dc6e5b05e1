"""A film: a scene, a number of frames, and the paths of what moves in it, from a TOML file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from lippmann import toml
from lippmann.errors import InputError
from lippmann.film.path import Motion, check_frames
from lippmann.film.path import Path as FilmPath
from lippmann.rendering.moved import Move
from lippmann.rendering.placement import Placement
from lippmann.toml import key

#: Most frames of a film: file names count to four digits.
MAX_FRAMES = 10_000
Depth = Annotated[float | None, key("", default="the placement's, and as far as shapes move")]


@dataclass(frozen=True)
class Moving:
    """An object of a film: the shapes whose id matches a pattern (`*` any text, `?` any letter), and their path."""

    shapes: str
    path: FilmPath


@dataclass(frozen=True)
class Film:
    """A film.

    Attributes
    ----------
    name
        The file's name without extension.
    scene
        Mitsuba XML; absolute.
    frames, frames_per_second
        Its length and speed.
    objects
        What moves, against the scene; later ones move what earlier ones have moved.
    world
        How the whole scene moves against the display; None: not at all.
    near_mm, far_mm
        Depths of interest of all frames, in the display's frame. None: the scene's own, and as far as it moves.
    """

    name: str
    scene: Path
    frames: int
    frames_per_second: float
    objects: tuple[Moving, ...] = ()
    world: FilmPath | None = None
    near_mm: float | None = None
    far_mm: float | None = None

    def moves(self, frame: int, placement: Placement) -> tuple[Move, ...]:
        """Return what moves the objects at a frame, in the frame of a scene that stands by a placement."""
        forward, back = placement.display_from_scene, placement.scene_from_display
        return tuple(Move(one.shapes, back @ one.path.at(frame).display_from_scene @ forward) for one in self.objects)

    def placement(self, frame: int, placement: Placement, scale: float = 1.0) -> Placement:
        """Return how the whole scene stands at a frame: by a placement, along the world's path, then scaled."""
        if self.world is not None:
            placement = placement.then(self.world.at(frame))
        if scale != 1.0:
            placement = placement.then(Placement(scale))
        near = placement.near_mm if self.near_mm is None else self.near_mm
        far = placement.far_mm if self.far_mm is None else self.far_mm
        return replace(placement, near_mm=near, far_mm=far)


@dataclass(frozen=True, kw_only=True)
class ObjectKeys(FilmPath):
    """An object's table in a film file."""

    shapes: Annotated[str, key("id of the shapes in the scene's file; `*` stands for any text, `?` for any letter")]


@dataclass(frozen=True, kw_only=True)
class FilmFile:
    """The keys of a film file."""

    scene: Annotated[str, key("a Mitsuba scene, its path counted from the film file")]
    frames: Annotated[int, key("number of frames; they count from 0", low=1, high=MAX_FRAMES)]
    frames_per_second: Annotated[float, key("at most 50 for a `.gif`", low=0.1, high=1000.0)] = 12.0
    motion: Annotated[Motion, key("interpolation between keys")] = "smooth"
    near_mm: Annotated[Depth, key("front of the depths of interest in every frame; primary rays start there")] = None
    far_mm: Annotated[Depth, key("back of the depths of interest in every frame")] = None
    object: tuple[ObjectKeys, ...] = ()
    world: FilmPath | None = None


def load_film(path: str | Path) -> Film:
    """Read a film file.

    Raises
    ------
    InputError
        Naming file, key and remedy.
    """
    path = Path(path)
    keys = toml.read(FilmFile, toml.load(path, "film"), str(path))
    near, far = keys.near_mm, keys.far_mm
    if near is not None and far is not None and near <= far:
        raise InputError(f"{path}: near_mm {near:g} is not in front of far_mm {far:g}; +z is towards the eye")

    def moving(table: FilmPath, name: str) -> FilmPath:
        check_frames(table, keys.frames, f"{path}: {name}")
        return FilmPath(table.keys, table.pivot_mm, table.motion or keys.motion)

    objects = tuple(Moving(one.shapes, moving(one, f"object[{place}]")) for place, one in enumerate(keys.object))
    world = None if keys.world is None else moving(keys.world, "world")
    scene = (path.parent / keys.scene).resolve()
    return Film(path.stem, scene, keys.frames, keys.frames_per_second, objects, world, near, far)
