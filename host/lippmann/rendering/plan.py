"""A plan: a picture with all that its pixels depend on, so that any process can render any of its bands.

Its identity is the key of these: a kept band, a frame of a film and a worker's renderer are used again where their key
is the same, and nowhere else.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from lippmann import __version__
from lippmann.base.images import Radiance
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.fixed.words import WIDEST
from lippmann.optics.model_choice import choose_model
from lippmann.optics.rays import Engine, Model
from lippmann.rendering.integral_image import metadata_of
from lippmann.rendering.options import RenderOptions, Settings
from lippmann.rendering.renderer import Renderer
from lippmann.rendering.sampling import colours_of, display_source
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene, digest_of, load_scene


class BandRenderer(Protocol):
    """Renders the bands of one plan, in any order."""

    @property
    def choices(self) -> Mapping[str, str]:
        """How it decided what was open, as metadata."""

    def prepare(self) -> float:
        """Compile the program; return the seconds that it took."""

    def render(self, number: int, report_rows: Callable[[int], None] | None = None) -> tuple[Radiance, list[int]]:
        """Return the radiance (rows, width, 3) of a band, and its numbers of lost samples by reason.

        `report_rows` is called with the number of the band's rows that are done.
        """


@dataclass(frozen=True, eq=False)
class Plan(ABC):
    """A picture that executors render and sinks store."""

    #: The display whose panel shows the picture.
    display: Display
    #: How it is rendered.
    options: RenderOptions
    #: The rows of each band: chosen once, for a worker's device may prefer others.
    bands: tuple[range, ...]

    @property
    @abstractmethod
    def name(self) -> str:
        """Name for messages."""

    @property
    @abstractmethod
    def identity(self) -> str:
        """Hash of all that the pixels depend on, 16 hexadecimal digits."""

    @property
    @abstractmethod
    def metadata(self) -> dict[str, str]:
        """What the picture's file carries; a renderer's `choices` replace its own."""

    @property
    def rays(self) -> int:
        """Rays for each pixel."""
        return self.options.settings.samples

    @property
    def prepare_seconds(self) -> float:
        """Seconds of compilation that planning took, until `start` is called."""
        return 0.0

    @abstractmethod
    def start(self, worker: str | None = None) -> BandRenderer:
        """Return the renderer of this plan's bands; loads what it needs.

        Raises InputError on a worker, with its name, where the plan's files are missing or different.
        """


@dataclass(frozen=True, eq=False)
class ScenePlan(Plan):
    """The picture of a scene. Only a film's frames may leave the lens model "auto": it depends on their own depths."""

    scene: Path
    #: `digest_of` the scene; "" where no other process renders it and no band is kept.
    digest: str
    placement: Placement
    #: The renderer that planned it, which the next `start` in this process returns.
    planned_by: list[Renderer] = field(default_factory=list, init=False)

    @property
    def name(self) -> str:
        """Name for messages."""
        return self.scene.name

    @functools.cached_property
    def identity(self) -> str:
        """Hash of all that the pixels depend on, 16 hexadecimal digits."""
        return pixels_identity(self.digest, self.placement, self.display, self.options)

    @property
    def metadata(self) -> dict[str, str]:
        """What the picture's file carries."""
        options = self.options
        return {
            **image_metadata(options.model, options.settings, self.scene, options.engine, options.fraction_bits),
            **metadata_of(self.display),
        }

    @property
    def rays(self) -> int:
        """Rays for each pixel."""
        return self.options.settings.samples * colours_of(self.display.panel)

    @property
    def prepare_seconds(self) -> float:
        """Seconds of compilation that planning took, until `start` is called."""
        return sum(renderer.prepare_seconds for renderer in self.planned_by)

    def load(self) -> Scene:
        """Load the scene where it is placed; InputError as `load_scene`."""
        return load_scene(self.scene, self.placement)

    def start(self, worker: str | None = None) -> Renderer:
        """Return the renderer of the bands: the one that planned them, or a new one that loads the scene."""
        if worker is not None:
            check_same_scene(worker, self.scene, self.digest)
        if self.planned_by:
            return self.planned_by.pop()
        return make_renderer(self.load(), self.display, self.options, self.bands)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what belongs to this process."""
        return {**self.__dict__, "planned_by": []}


@functools.lru_cache(maxsize=8)
def check_same_scene(worker: str, path: Path, digest: str) -> None:
    """Raise InputError for a scene that is missing or different on a worker's machine."""
    try:
        own = digest_of(path)
    except InputError as error:
        raise InputError(f"{worker}: {error}; a cluster's machines must share the scene's folder") from None
    if own != digest:
        raise input_error(worker, f"{path} differs there", "share the scene's folder between the cluster's machines")


def make_renderer(
    scene: Scene,
    display: Display,
    options: RenderOptions,
    bands: tuple[range, ...] | None = None,
    in_memory: bool = False,
) -> Renderer:
    """Return the renderer of the integral image of a loaded scene, not compiled yet; `bands` as for `Renderer`.

    Raises InputError as `Renderer` and `choose_model`.
    """
    settings, model = options.settings, resolve_model(scene, display, options)
    source = display_source(display, model, settings.samples, settings.aperture, options.engine, options.fraction_bits)
    renderer = Renderer(scene, source, settings, bands, in_memory=in_memory)
    renderer.choices["model"] = model
    return renderer


def resolve_model(
    scene: Scene, display: Display, options: RenderOptions, logger: logging.Logger | None = None
) -> Model:
    """Return the lens model of a render: "auto" takes the cheapest within the tolerance, and a logger learns why.

    Raises InputError as `choose_model`.
    """
    if options.model != "auto":
        return options.model
    choice = choose_model(display, scene.depth_range_mm, options.settings.aperture, options.tolerance)
    if logger is not None:
        logger.info("%s", choice)
    return choice.model


def image_metadata(
    model: str, settings: Settings, scene_path: Path, engine: Engine = "fast", fraction_bits: int | None = None
) -> dict[str, str]:
    """Return how an image was made, as metadata; `IntegralImage` adds the display."""
    bits = {} if engine in ("golden", "fast") else {"fraction_bits": str(fraction_bits or WIDEST)}
    return {
        "model": model,
        "engine": engine,
        **bits,
        "aperture": settings.aperture,
        "integrator": settings.integrator,
        "samples": str(settings.samples),
        "max_depth": str(settings.max_depth),
        "seed": str(settings.seed),
        "shading": settings.shading,
        "scene": scene_path.name,
        "version": __version__,
        "mitsuba": importlib.metadata.version("mitsuba"),
        "drjit": importlib.metadata.version("drjit"),
    }


def pixels_identity(
    digest: str, placement: Placement, display: Display, options: RenderOptions, **others: object
) -> str:
    """Return the hash, 16 hexadecimal digits, of all that a picture's pixels depend on.

    `digest` is the scene's (`scenes.scene.digest_of`); `others` are what else they depend on, as JSON holds it.
    """
    arguments = asdict(options)
    del arguments["settings"]["memory_mb"]
    parts = {
        "scene": digest,
        "placement": asdict(placement),
        "display": display.identity,
        "options": arguments,
        "versions": list(pixel_versions().values()),
        **others,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def pixel_versions() -> dict[str, str]:
    """Return the versions of the packages that a picture's pixels depend on; Lippmann's includes its code's digest."""
    others = {name: importlib.metadata.version(name) for name in ("mitsuba", "drjit")}
    return {"lippmann": __version__ + code_digest(Path(__file__).parents[1]), **others}


@functools.cache
def code_digest(folder: Path) -> str:
    """Return "+" and the hash, 8 hexadecimal digits, of a folder's Python files as they are when it is first asked for.

    Between releases a version has many codes. "" without such files, as where only their compiled forms are installed.
    """
    digest = hashlib.sha256()
    paths = [path for path in sorted(folder.rglob("*.py")) if path.is_file() and not path.name.startswith(".")]
    for path in paths:
        code = path.read_bytes()
        digest.update(f"{path.relative_to(folder)} {len(code)}\n".encode() + code)
    return f"+{digest.hexdigest()[:8]}" if paths else ""
