"""A shot: one frame of a film with everything that its pixels depend on, so that any process can render it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from lippmann.base.toml import documented, key
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.motion.film import Film
from lippmann.rendering.integral import RenderOptions, pixels_identity, render_image, renderer_of
from lippmann.rendering.integral_image import IntegralImage
from lippmann.scenes.arrange import fitting
from lippmann.scenes.placement import Matrix, Placement, placement_beside
from lippmann.scenes.scene import (
    Move,
    Scene,
    bounds_of,
    box_of,
    depths_of,
    digest_of,
    in_front_of,
    load_scene,
    placed_box,
)


@documented
@dataclass(frozen=True)
class Shot:
    """One frame of a film."""

    film: Film
    frame: Annotated[int, key("the frame's number")]
    digest: Annotated[str, key("`digest_of` the scene")]
    moves: Annotated[tuple[Move, ...], key("motions of the scene's shapes")]
    placement: Annotated[Placement, key("of the scene before the display")]
    display: Display
    options: Annotated[RenderOptions, key("how to render")]

    @property
    def scene(self) -> Path:
        """The scene's file."""
        return self.film.scene

    def __str__(self) -> str:
        """Return its name for messages."""
        return f"frame {self.frame}"

    def render(self) -> IntegralImage:
        """Render it, on a worker."""
        return render_shot(self)

    @property
    def identity(self) -> str:
        """Hash of everything that the pixels depend on, 16 hexadecimal digits; the frame's file carries it."""
        moves = [(move.shapes, move.matrix.tolist()) for move in self.moves]
        reach = (self.film.near_mm is None, self.film.far_mm is None)
        return pixels_identity(self.digest, self.placement, self.display, self.options, moves=moves, reach=reach)


def shots_of(film: Film, display: Display, options: RenderOptions, scale: float | None = 1.0) -> list[Shot]:
    """Return the shots of a film that is scaled about the display's centre; None: fitted into its depth range.

    Raises InputError when the scene cannot be read, or its own placement is invalid; to fit, when it is unbounded.
    """
    digest, rest = digest_of(film.scene), placement_beside(film.scene)
    whole = None if scale == 1.0 else Placement(scale) if scale is not None else _fitting(film, rest, display)
    if scale is None:
        # The film's own depths belong to its own size.
        film = replace(film, near_mm=None, far_mm=None)
    return [
        Shot(film, frame, digest, film.moves(frame, rest), film.placement(frame, rest, whole), display, options)
        for frame in range(film.frames)
    ]


def _fitting(film: Film, rest: Placement, display: Display) -> Placement:
    """Return how the whole film is scaled and moved for a display: by the box round the scene at all key frames."""
    anywhere = Placement(near_mm=1.0, far_mm=0.0)
    boxes = [
        box_of(load_scene(film.scene, anywhere, film.moves(frame, rest)).mitsuba, film.placement(frame, rest))
        for frame in film.key_frames
    ]
    low, high = np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
    if not np.isfinite(high - low).all():
        raise InputError(f"{film.scene}: the scene has no bounded extent to fit; give --scale")
    return fitting(low, high, display)


def with_one_shading(film: Film, shots: list[Shot], note: Callable[[str], None]) -> list[Shot]:
    """Return a film's shots with one way to shade in place of "auto": shared where a trial at every key frame says so.

    What is at rest then keeps its pixels from frame to frame, and every process makes the same ones. `note` is called
    with what a trial says. Errors as `render_shot`.
    """
    options = shots[0].options
    if options.settings.shading != "auto":
        return shots
    for frame in film.key_frames:
        renderer = renderer_of(scene_of_shot(shots[frame]), shots[frame].display, options)
        settings = renderer.decide()
        if renderer.remark is not None and (settings.shading == "each" or frame == film.key_frames[-1]):
            note(f"frame {frame}: {renderer.remark}")
        if settings.shading == "each":
            break
    return [replace(shot, options=replace(options, settings=settings)) for shot in shots]


def render_shot(shot: Shot, note: Callable[[str], None] | None = None) -> IntegralImage:
    """Render a shot. All frames have the film's seed, so that the pixels of parts at rest do not change.

    `note`, and InputError, as for `load_scene` and `render_image`.
    """
    image = render_image(scene_of_shot(shot), shot.display, shot.options, note=note)
    image.metadata.update({"film": shot.film.name, "frame": str(shot.frame), "shot": shot.identity})
    return image


def scene_of_shot(shot: Shot) -> Scene:
    """Return a shot's scene, moved and placed. InputError as for `load_scene`."""
    scene = load_scene(shot.film.scene, shot.placement, shot.moves)
    return _reaching(scene, shot) if shot.film.object else scene


def _reaching(scene: Scene, shot: Shot) -> Scene:
    """Return the scene with a depth range that includes the shapes that have moved beyond it.

    A depth that the film gives holds.
    """
    low, high = placed_box(_bounds_at_rest(shot.film.scene, shot.digest), scene.placement)
    rest = low[2], high[2]
    moved = depths_of(scene.mitsuba, scene.placement)
    far, near = scene.depth_range_mm
    if shot.film.near_mm is None and moved[1] > rest[1]:
        near = max(near, in_front_of(moved))
    if shot.film.far_mm is None and moved[0] < rest[0]:
        far = min(far, moved[0])
    return replace(scene, placement=replace(scene.placement, near_mm=near, far_mm=far))


@functools.lru_cache(maxsize=1)
def _bounds_at_rest(path: Path, digest: str) -> tuple[Matrix, Matrix]:
    """Return the bounds of the scene without any motion, which is not kept: programs hold the code of all scenes."""
    return bounds_of(load_scene(path, Placement(near_mm=1.0, far_mm=0.0)).mitsuba)
