"""Plans the frames of a film, and stores them as files in a folder."""

from __future__ import annotations

import contextlib
import functools
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from lippmann.base.files import FolderLock
from lippmann.base.progress_protocol import Progress, report_each
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.motion.film import Film
from lippmann.rendering.executors import Band, RenderedBand
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.memory_estimate import bands_of
from lippmann.rendering.options import RenderOptions
from lippmann.rendering.picture_hash import digest_of, pixels_identity
from lippmann.rendering.plan import ScenePlan, make_renderer, report_and_choose_model
from lippmann.rendering.sampling import colours_of
from lippmann.rendering.sinks import MemorySink, bands_of_plan, render_picture
from lippmann.scenes.placement import Placement, fitting, front_of, placement_beside
from lippmann.scenes.scene import Box, Move, Scene, load_scene, placed_box, union_of

logger = logging.getLogger("lippmann")


@dataclass(frozen=True, eq=False)
class FramePlan(ScenePlan):
    """The plan of a film's frame. All frames have the same seed, so that pixels at rest do not change."""

    film: Film
    frame: int
    moves: tuple[Move, ...]

    @property
    def name(self) -> str:
        """See `Plan`."""
        return f"frame {self.frame}"

    @cached_property
    def identity(self) -> str:
        """See `Plan`; the frame's file stores the identity."""
        moves = [(move.shapes, move.matrix.tolist()) for move in self.moves]
        reach = (self.film.near_mm is None, self.film.far_mm is None)
        return pixels_identity(self.digest, self.placement, self.display, self.options, moves=moves, reach=reach)

    @property
    def metadata(self) -> dict[str, str]:
        """See `Plan`."""
        return {**super().metadata, "film": self.film.name, "frame": str(self.frame), "shot": self.identity}

    def load(self) -> Scene:
        """Load the scene, moved and placed. Raises errors of `load_scene`."""
        scene = load_scene(self.scene, self.placement, self.moves)
        return self._with_moved_shapes(scene) if self.film.object else scene

    def _with_moved_shapes(self, scene: Scene) -> Scene:
        """Extend a scene's depth range to its moved shapes, unless the film file gives the depths."""
        rest_low, rest_high = placed_box(_bounds_at_rest(self.scene, self.digest), scene.placement)
        low, high = scene.box(scene.placement)
        far, near = scene.depth_range_mm
        if self.film.near_mm is None and high[2] > rest_high[2]:
            near = max(near, front_of(low, high))
        if self.film.far_mm is None and low[2] < rest_low[2]:
            far = min(far, float(low[2]))
        return replace(scene, placement=replace(scene.placement, near_mm=near, far_mm=far))


@functools.lru_cache(maxsize=1)
def _bounds_at_rest(path: Path, digest: str) -> Box:
    return load_scene(path, Placement(near_mm=1.0, far_mm=0.0)).bounds


def plan_film(film: Film, display: Display, options: RenderOptions, scale: float | None = 1.0) -> list[FramePlan]:
    """Return the plans of a film's frames, scaled about the display's centre.

    A scale of None fits the film into the depth range. Raises InputError if the scene
    cannot be read, or if an unbounded scene must be fitted.
    """
    digest, at_rest = digest_of(film.scene), placement_beside(film.scene)
    film_placement = None if scale == 1.0 else Placement(scale or 1.0)
    if scale is None:
        film_placement = _fit_film(film, at_rest, display)
        # The depths in the film file are for the unscaled film.
        film = replace(film, near_mm=None, far_mm=None)
    panel = display.panel
    bands = tuple(bands_of(*panel.size_px, options.settings.samples * colours_of(panel)))
    picture = display, options, bands, film.scene, digest
    return [
        FramePlan(*picture, film.placement(frame, at_rest, film_placement), film, frame, film.moves(frame, at_rest))
        for frame in range(film.frames)
    ]


def _fit_film(film: Film, at_rest: Placement, display: Display) -> Placement:
    anywhere = Placement(near_mm=1.0, far_mm=0.0)
    boxes = [
        load_scene(film.scene, anywhere, film.moves(frame, at_rest)).box(film.placement(frame, at_rest))
        for frame in film.key_frames
    ]
    low, high = union_of(boxes)
    if not np.isfinite(high - low).all():
        raise InputError(f"{film.scene}: the scene has no bounded extent to fit; give --scale")
    return fitting(low, high, display)


def choose_shading(plans: list[FramePlan]) -> list[FramePlan]:
    """Replace shading "auto" in all plans: use the cache if trials at all key frames allow it."""
    # All frames have the same shading, so that pixels at rest do not change.
    options, film = plans[0].options, plans[0].film
    if options.settings.shading != "auto":
        return plans
    for frame in film.key_frames:
        renderer = make_renderer(plans[frame].load(), plans[frame].display, options, in_memory=True)
        settings = renderer.settings
        if renderer.cache_report is not None and (settings.shading == "each" or frame == film.key_frames[-1]):
            logger.info("frame %d: %s", frame, renderer.cache_report)
        if settings.shading == "each":
            break
    return [replace(plan, options=replace(options, settings=settings)) for plan in plans]


def warn_of_frame(plan: FramePlan) -> None:
    """Warn of a frame's problems (`report_and_choose_model`); keep its renderer for `start`."""
    scene = plan.load()
    model = report_and_choose_model(scene, plan.display, plan.options)
    plan.planned_by.append(make_renderer(scene, plan.display, replace(plan.options, model=model), plan.bands))


def render_frame(plan: FramePlan) -> IntegralImage:
    """Render a frame in this process. Raises errors of `FramePlan.load` and `Renderer`."""
    return render_picture(plan)


FRAME_STEM = "frame_"


def frame_path(folder: Path, frame: int) -> Path:
    """Return the path of a frame's file."""
    return folder / f"{FRAME_STEM}{frame:04d}.exr"


def lock_folder(folder: Path, frames: int) -> FolderLock:
    """Create and lock a film's folder. Raises InputError if the folder has frames of a longer film."""
    lock = FolderLock(folder, "choose another folder with -o")
    ours = {frame_path(folder, k) for k in range(frames)}
    for other in sorted(folder.glob("frame_*.exr")):
        if other not in ours:
            what = f"is beyond the film's {frames} frames"
            raise input_error(other, what, "remove the file, or choose another folder")
    return lock


def is_rendered(folder: Path, plan: FramePlan) -> bool:
    """Tell whether a folder contains the rendered frame of a plan."""
    with contextlib.suppress(InputError):
        image = IntegralImage.load(frame_path(folder, plan.frame), plan.display)
        return image.metadata.get("shot") == plan.identity
    return False


class FrameFolder:
    """A sink for a film's frames. A frame is written to a file after its last band."""

    def __init__(self, folder: Path, lock: FolderLock, plans: Sequence[FramePlan]) -> None:
        self.folder, self._lock, self._plans = folder, lock, plans
        self.missing_plans = [plan for plan in plans if not is_rendered(folder, plan)]
        self.bands = [band for plan in plans for band in bands_of_plan(plan)]
        self._pictures: dict[int, MemorySink] = {}

    def missing_bands(self) -> Sequence[Band]:
        """Return the bands of the missing frames."""
        return [band for plan in self.missing_plans for band in bands_of_plan(plan)]

    def take(self, rendered: RenderedBand) -> None:
        """Store a band; raise InputError or NoSpaceError if its frame cannot be written."""
        plan = rendered.band.plan
        assert isinstance(plan, FramePlan)
        if plan.frame not in self._pictures:
            self._pictures[plan.frame] = MemorySink(plan)
        picture = self._pictures[plan.frame]
        picture.take(rendered)
        if not picture.missing_bands():
            picture.write(frame_path(self.folder, plan.frame))
            del self._pictures[plan.frame]

    def images(self, progress: Progress | None = None) -> Iterator[IntegralImage]:
        """Yield the frames in order; `progress` gets (frames done, all frames)."""
        for plan in report_each(self._plans, progress):
            yield IntegralImage.load(frame_path(self.folder, plan.frame), plan.display)

    def stop(self, done_rows: int) -> None:
        """Unlock the folder."""
        self._lock.close()


@dataclass
class Reel:
    """A film that plays in a loop. No frame is skipped, so slow rendering slows the film."""

    plans: Sequence[FramePlan]
    frames_per_second: float
    playing: bool = True
    _place: float = 0.0

    @property
    def frame(self) -> int:
        """The current frame."""
        return int(self._place)

    def advance(self, seconds: float) -> None:
        """Advance a playing film by a time, but at most by a frame."""
        if self.playing:
            self._move(min(seconds * self.frames_per_second, 1.0))

    def step(self, frames: int) -> None:
        """Stop the film, and move by a number of frames."""
        self.playing = False
        self._place = float(self.frame)
        self._move(frames)

    def stage(self, frame: int) -> tuple[Scene | None, Placement]:
        """Return a frame's scene and placement; the scene is None if no shapes move."""
        plan = self.plans[frame]
        scene = plan.load() if plan.moves else None
        return scene, plan.placement if scene is None else scene.placement

    def _move(self, frames: float) -> None:
        self._place = (self._place + frames) % len(self.plans)
