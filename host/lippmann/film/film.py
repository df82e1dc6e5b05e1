"""A film: a scene, a number of frames, and the paths of what moves in it, from a TOML file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

from lippmann.errors import InputError, input_error
from lippmann.film.path import MOTIONS, Motion, read_path
from lippmann.film.path import Path as FilmPath
from lippmann.rendering.moved import Move
from lippmann.rendering.placement import Placement
from lippmann.toml import Table

#: Most frames of a film: file names count to four digits.
MAX_FRAMES = 10_000
#: Slowest and fastest: what every kind of video can say of a frame's time.
SPEEDS = (0.1, 1000.0)


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


def load_film(path: str | Path) -> Film:
    """Read a film file.

    Raises
    ------
    InputError
        Naming file, key and remedy.
    """
    path = Path(path)
    try:
        raw = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:  # unreadable, no text, broken TOML, endless nests
        raise input_error(str(path), f"cannot be read ({error})", "give a film file (.toml)") from None
    top = Table(raw, str(path), "")
    scene = (path.parent / top.text("scene")).resolve()
    frames = top.integer("frames", 1, MAX_FRAMES)
    speed = top.number("frames_per_second", 12.0, at_least=SPEEDS[0], at_most=SPEEDS[1])
    motion: Motion = "linear" if top.choice("motion", MOTIONS, "smooth") == "linear" else "smooth"
    objects = []
    for one in top.tables("object"):
        shapes = one.text("shapes")
        objects.append(Moving(shapes, read_path(one, frames, motion)))
        one.refuse_leftovers()
    world_table = top.optional_table("world")
    world = None
    if world_table is not None:
        world = read_path(world_table, frames, motion)
        world_table.refuse_leftovers()
    near, far = top.optional_number("near_mm"), top.optional_number("far_mm")
    top.refuse_leftovers()
    if near is not None and far is not None and near <= far:
        raise InputError(f"{path}: near_mm {near:g} is not in front of far_mm {far:g}; +z is towards the eye")
    return Film(path.stem, scene, frames, speed, tuple(objects), world, near, far)
