"""A shot: one frame of a film, by itself all that its pixels depend on, so that any process can render it."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from lippmann import __version__
from lippmann.display import Display
from lippmann.film.film import Film
from lippmann.images import Image
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.metadata import image_metadata
from lippmann.rendering.moved import Move
from lippmann.rendering.placement import Placement
from lippmann.rendering.renderer import Settings, render_integral
from lippmann.rendering.scene import Scene, depths_of, digest_of, in_front_of, load_scene, placement_beside
from lippmann.select.model import TOLERANCE, choose_model


@dataclass(frozen=True)
class Options:
    """How all frames of a film are rendered; as of `lippmann render`, and `scale` of the whole film."""

    model: Model | Literal["auto"] = "auto"
    tolerance: float = TOLERANCE
    engine: Engine = "fast"
    fraction_bits: int | None = None
    settings: Settings = field(default_factory=Settings)
    scale: float = 1.0


@dataclass(frozen=True)
class Shot:
    """One frame.

    Attributes
    ----------
    film, frame
        What it is a frame of: the film's name, and its number.
    scene, digest
        Mitsuba XML, and what `digest_of` makes of it.
    moves
        What has moved in the scene.
    placement
        How the scene stands before the display.
    reach
        Whether near and far depth follow the shapes that move beyond the scene's box.
    display, options
        What it is rendered for, and how.
    """

    film: str
    frame: int
    scene: Path
    digest: str
    moves: tuple[Move, ...]
    placement: Placement
    reach: tuple[bool, bool]
    display: Display
    options: Options

    @property
    def identity(self) -> str:
        """Hash of all that the pixels depend on, 16 hexadecimal digits; the frame's file carries it."""
        options = asdict(self.options)
        del options["settings"]["memory_mb"]
        parts = {
            "scene": self.digest,
            "moves": [(move.shapes, move.matrix.tolist()) for move in self.moves],
            "placement": asdict(self.placement),
            "reach": self.reach,
            "display": self.display.identity,
            "options": options,
            "versions": [__version__, *(metadata.version(name) for name in ("mitsuba", "drjit"))],
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def shots_of(film: Film, display: Display, options: Options) -> list[Shot]:
    """Return the shots of a film.

    Raises
    ------
    InputError
        When the scene cannot be read, or does not stand before the display.
    """
    digest = digest_of(film.scene)
    rest = placement_beside(film.scene)
    reach = (film.near_mm is None, film.far_mm is None)
    return [
        Shot(
            film.name,
            frame,
            film.scene,
            digest,
            film.moves(frame, rest),
            film.placement(frame, rest, options.scale),
            reach,
            display,
            options,
        )
        for frame in range(film.frames)
    ]


def render_shot(shot: Shot) -> tuple[Image, dict[str, str]]:
    """Render a shot; return its radiance (height, width, 3) float32 and what its file carries.

    The seed is the film's in every frame: what stands still keeps its pixels, and costs the link nothing.

    Raises
    ------
    InputError
        As `load_scene` and `render_integral`.
    """
    options, display = shot.options, shot.display
    scene = load_scene(shot.scene, shot.placement, shot.moves)
    if shot.moves:
        scene = _reaching(scene, shot)
    if options.model == "auto":
        model = choose_model(display, scene.depth_range_mm, options.settings.aperture, options.tolerance).model
    else:
        model = options.model
    rendered = render_integral(
        scene, display, model, options.settings, engine=options.engine, fraction_bits=options.fraction_bits
    )
    carried = image_metadata(display, model, options.settings, shot.scene, options.engine, options.fraction_bits)
    return rendered.radiance, {**carried, "film": shot.film, "frame": str(shot.frame), "shot": shot.identity}


def _reaching(scene: Scene, shot: Shot) -> Scene:
    """Return the scene with depths that reach as far as its shapes have moved beyond where they were at rest."""
    rest = depths_of(_at_rest(shot.scene, shot.digest), scene.placement)
    moved = depths_of(scene.mitsuba, scene.placement)
    far, near = scene.depth_range_mm
    if shot.reach[0] and moved[1] > rest[1]:
        near = max(near, in_front_of(moved))
    if shot.reach[1] and moved[0] < rest[0]:
        far = min(far, moved[0])
    return replace(scene, placement=replace(scene.placement, near_mm=near, far_mm=far))


@functools.lru_cache(maxsize=1)
def _at_rest(path: Path, digest: str) -> Any:
    """Return the scene as its file has it."""
    return load_scene(path, Placement(near_mm=1.0, far_mm=0.0)).mitsuba
