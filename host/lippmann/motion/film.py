"""A film: a scene, a number of frames, and the paths of what moves in it, from a TOML file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, TypeVar

from lippmann.base import toml
from lippmann.base.toml import documented, key, values
from lippmann.errors import InputError, input_error
from lippmann.motion.path import Motion
from lippmann.motion.path import Path as FilmPath
from lippmann.scenes.formats import kind_of
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Move

#: Most frames of a film: file names count to four digits.
MAX_FRAMES = 10_000
AnyPath = TypeVar("AnyPath", bound=FilmPath)
Depth = Annotated[float | None, key("", default="the placement's, extended by the motions")]


@documented
@dataclass(frozen=True, kw_only=True)
class Moving(FilmPath):
    """An object of a film: shapes, and their path."""

    shapes: Annotated[str, key("id of the shapes in the scene file; `*` stands for any text, `?` for any character")]


@dataclass(frozen=True, kw_only=True)
class FilmFile:
    """The keys of a film file. Later objects move what earlier ones have moved; the world is the whole scene."""

    scene: Annotated[Path, key("a Mitsuba scene; its path is relative to the film file")]
    frames: Annotated[int, key("number of frames, numbered from 0", low=1, high=MAX_FRAMES)]
    frames_per_second: Annotated[float, key("speed; at most 50 for a `.gif`", low=0.1, high=1000.0)] = 12.0
    motion: Annotated[Motion, key("interpolation between keys")] = "smooth"
    near_mm: Annotated[Depth, key("front of the depths z that matter in every frame; primary rays start there")] = None
    far_mm: Annotated[Depth, key("back of the depths z that matter in every frame")] = None
    object: tuple[Moving, ...] = ()
    world: FilmPath | None = None


@documented
@dataclass(frozen=True, kw_only=True)
class Film(FilmFile):
    """A film; `name` is its file's name without extension, `scene` an absolute path."""

    name: str

    @property
    def key_frames(self) -> list[int]:
        """The first frame, the last, and those of all keys: between keys no number goes beyond them."""
        paths = [*self.object, self.world] if self.world is not None else self.object
        return sorted({0, self.frames - 1, *(one.frame for path in paths for one in path.keys)})

    def moves(self, frame: int, placement: Placement) -> tuple[Move, ...]:
        """Return what moves the objects at a frame, in the frame of a scene that stands by a placement."""
        forward, back = placement.display_from_scene, placement.scene_from_display
        return tuple(Move(one.shapes, back @ one.at(frame).display_from_scene @ forward) for one in self.object)

    def placement(self, frame: int, placement: Placement, whole: Placement | None = None) -> Placement:
        """Return how the scene stands at a frame: by a placement, along the world's path, then moved as a whole."""
        if self.world is not None:
            placement = placement.then(self.world.at(frame))
        if whole is not None:
            placement = placement.then(whole)
        near = placement.near_mm if self.near_mm is None else self.near_mm
        far = placement.far_mm if self.far_mm is None else self.far_mm
        return replace(placement, near_mm=near, far_mm=far)


def is_film(path: str | Path) -> bool:
    """Tell whether a path is a TOML file that is no scene."""
    path = Path(path)
    return path.suffix.lower() == ".toml" and path.is_file() and kind_of(path) is None


def load_film(path: str | Path) -> Film:
    """Read a film file; InputError names file, key and remedy."""
    path = Path(path)
    film = Film(**values(toml.read(FilmFile, toml.load(path, "film"), str(path))), name=path.stem)
    near, far = film.near_mm, film.far_mm
    if near is not None and far is not None and near <= far:
        raise InputError(f"{path}: near_mm {near:g} is not in front of far_mm {far:g}; +z is towards the eye")
    world = film.world and _moving(film.world, film, f"{path}: world")
    moving = tuple(_moving(one, film, f"{path}: object[{place}]") for place, one in enumerate(film.object))
    return replace(film, scene=(path.parent / film.scene).absolute(), object=moving, world=world)


def _moving(path: AnyPath, film: Film, where: str) -> AnyPath:
    """Return a path with the film's motion where it has none; refuse keys out of order or beyond the last frame."""
    before = -1
    for place, frame in enumerate(one.frame for one in path.keys):
        here = f"{where}.keys[{place}].frame"
        if frame >= film.frames:
            raise input_error(here, f"{frame} is beyond the film's last frame", f"give at most {film.frames - 1}")
        if frame <= before:
            raise input_error(here, f"{frame} does not come after {before}", "sort the keys by frame")
        before = frame
    return replace(path, motion=path.motion or film.motion)
