"""Plans a render: replaces "auto" options, and describes a picture for any process."""

from __future__ import annotations

import contextlib
import functools
import importlib.metadata
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from lippmann import __version__
from lippmann.base.images import Radiance
from lippmann.base.variant import VARIANTS, check_device, own_variant
from lippmann.display.description import Display
from lippmann.errors import InputError, check_type, input_error, printable
from lippmann.fixed.words import WIDEST
from lippmann.optics import model_choice
from lippmann.optics.model_choice import TOLERANCE
from lippmann.optics.rays import Model
from lippmann.rendering.diagnostics import warn_of_unused_parts, warn_of_view
from lippmann.rendering.integral_image import metadata_of
from lippmann.rendering.memory_estimate import bands_of
from lippmann.rendering.options import RenderOptions
from lippmann.rendering.picture_hash import PIXEL_LIBRARIES, digest_of, pixels_identity
from lippmann.rendering.renderer import Renderer
from lippmann.rendering.sampling import colours_of, display_source
from lippmann.scenes.placement import Arrange, Placement, arranged
from lippmann.scenes.scene import Scene, check_scene_file, load_scene, scene_of

if TYPE_CHECKING:
    import mitsuba as mi

logger = logging.getLogger("lippmann")
#: A scene: path, loaded scene, `mitsuba.Scene`, or dictionary for `mitsuba.load_dict`.
SceneSource: TypeAlias = "str | Path | Scene | dict[str, Any] | mi.Scene"


class BandRenderer(Protocol):
    """Renders the bands of one plan, in any order."""

    @property
    def choices(self) -> Mapping[str, str]:
        """The values chosen for "auto" options, as metadata."""

    def prepare(self) -> float:
        """Compile the program; return the compilation time in seconds."""

    def render(self, number: int, report_rows: Callable[[int], None] | None = None) -> tuple[Radiance, list[int]]:
        """Return a band's radiance (rows, width, 3), and numbers of lost samples for each reason.

        `report_rows` is called with the number of the band's finished rows.
        """


@dataclass(frozen=True, eq=False)
class Plan(ABC):
    """A picture that executors render and sinks store."""

    display: Display
    options: RenderOptions
    #: The rows of each band; they do not depend on workers' devices.
    bands: tuple[range, ...]

    @property
    @abstractmethod
    def name(self) -> str:
        """The picture's name in messages."""

    @property
    @abstractmethod
    def identity(self) -> str:
        """Hash of all inputs that determine the pixels, 16 hexadecimal digits."""

    @property
    @abstractmethod
    def metadata(self) -> dict[str, str]:
        """The metadata of the picture's file; a renderer's `choices` replace some of it."""

    @property
    def rays(self) -> int:
        """Number of rays per pixel."""
        return self.options.settings.samples

    @property
    def prepare_seconds(self) -> float:
        """Compilation time during planning, s; 0 after `start` was called."""
        return 0.0

    @abstractmethod
    def start(self, worker: str | None = None) -> BandRenderer:
        """Return the renderer; raise InputError if the scene differs on the machine of `worker`."""


@dataclass(frozen=True, eq=False)
class ScenePlan(Plan):
    """The plan of a scene's picture. Only a film's frame can keep the lens model "auto"."""

    scene: Path
    #: Result of `digest_of`; "" if only this process renders and keeps no bands.
    digest: str
    placement: Placement
    #: Planning's renderer, which the next `start` in this process returns.
    planned_by: list[Renderer] = field(default_factory=list, init=False)

    @property
    def name(self) -> str:
        """See `Plan`."""
        return self.scene.name

    @functools.cached_property
    def identity(self) -> str:
        """See `Plan`."""
        return pixels_identity(self.digest, self.placement, self.display, self.options)

    @property
    def metadata(self) -> dict[str, str]:
        """See `Plan`."""
        return {**image_metadata(self.options, self.scene), **metadata_of(self.display)}

    @property
    def rays(self) -> int:
        """See `Plan`."""
        return self.options.settings.samples * colours_of(self.display.panel)

    @property
    def prepare_seconds(self) -> float:
        """See `Plan`."""
        return sum(renderer.prepare_seconds for renderer in self.planned_by)

    def load(self) -> Scene:
        """Load and place the scene. Raises errors of `load_scene`."""
        return load_scene(self.scene, self.placement)

    def start(self, worker: str | None = None) -> Renderer:
        """Return the renderer from planning, or load the scene into a new renderer."""
        if worker is not None:
            check_same_scene(worker, self.scene, self.digest)
        if self.planned_by:
            return self.planned_by.pop()
        return make_renderer(self.load(), self.display, self.options, self.bands)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "planned_by": []}


@functools.lru_cache(maxsize=8)
def check_same_scene(worker: str, path: Path, digest: str) -> None:
    """Raise InputError if the scene is missing on a worker, or differs there."""
    try:
        own = digest_of(path)
    except InputError as error:
        raise InputError(f"{worker}: {error}; share the scene's folder between all machines") from None
    if own != digest:
        raise input_error(worker, f"{path} differs there", "share the scene's folder between all machines")


def make_renderer(
    scene: Scene,
    display: Display,
    options: RenderOptions,
    bands: tuple[range, ...] | None = None,
    in_memory: bool = False,
) -> Renderer:
    """Return the renderer of a scene. Raises errors of `Renderer` and `resolve_model`."""
    settings, model = options.settings, resolve_model(scene, display, options)
    source = display_source(display, model, settings.samples, settings.aperture, options.engine, options.fraction_bits)
    renderer = Renderer(scene, source, settings, bands, in_memory=in_memory)
    renderer.choices["model"] = model
    return renderer


def resolve_model(
    scene: Scene, display: Display, options: RenderOptions, logger: logging.Logger | None = None
) -> Model:
    """Return the lens model; for "auto", choose a model and log it. Raises errors of `choose_model`."""
    if options.model != "auto":
        return options.model
    choice = model_choice.choose_model(display, scene.depth_range_mm, options.settings.aperture, options.tolerance)
    if logger is not None:
        logger.info("%s", choice)
    return choice.model


def image_metadata(options: RenderOptions, scene_path: Path) -> dict[str, str]:
    """Return metadata of options and scene; `IntegralImage` adds the display's metadata."""
    bits = {} if options.engine in ("golden", "fast") else {"fraction_bits": str(options.fraction_bits or WIDEST)}
    names = ("aperture", "integrator", "samples", "max_depth", "seed", "shading")
    return {
        "model": options.model,
        "engine": options.engine,
        **bits,
        **{name: str(getattr(options.settings, name)) for name in names},
        "scene": printable(scene_path.name),
        "version": __version__,
        **{name: importlib.metadata.version(name) for name in PIXEL_LIBRARIES},
    }


@contextlib.contextmanager
def open_scene(source: SceneSource, placement: Placement | None = None, device: str = "auto") -> Iterator[Scene]:
    """Set Mitsuba's variant; yield a loaded scene. Raises errors of `load_scene` and `start_mitsuba`."""
    check_type("placement", placement, (Placement, type(None)), "a lippmann.Placement or None")
    check_device(device)
    if isinstance(source, str | Path):
        check_scene_file(source)
        with own_variant(device):
            yield load_scene(source, placement)
        return
    if not isinstance(source, Scene):
        variant_name = getattr(type(source), "variant_name", None)
        with own_variant(device if variant_name is None else _device_name(variant_name(source))):
            yield scene_of(source, placement)
        return
    own = _device_name(source.mitsuba.variant_name())
    if device not in ("auto", own):
        raise InputError(f"the scene was loaded for device '{own}', not '{device}'; give '{own}', or load it again")
    with own_variant(own):
        yield source if placement is None else source.placed(placement)


def _device_name(variant: str) -> str:
    for name, own in VARIANTS.items():
        if own == variant:
            return name
    raise InputError(f"the scene uses Mitsuba's variant {variant}; load it after set_variant('{VARIANTS['llvm']}')")


def place_scene(scene: Scene, display: Display, arrange: Arrange | None = None) -> Scene:
    """Place a scene for a display by `arrange`, by default `scene.usual`."""
    arrange = scene.usual if arrange is None else arrange
    if arrange is None:
        return scene
    placed = arranged(scene, display, arrange)
    logger.info("placed by %s", placed.placement)
    return placed


def report_and_choose_model(scene: Scene, display: Display, options: RenderOptions) -> Model:
    """Warn of a picture's problems; choose and log the lens model. Raises errors of `resolve_model`."""
    # The trial view takes time, so it is rendered only at level INFO.
    warn_of_unused_parts(scene, options.settings)
    if logger.isEnabledFor(logging.INFO):
        warn_of_view(scene, display, options.settings, options.engine)
    return resolve_model(scene, display, options, logger)


@dataclass(frozen=True)
class Job:
    """A loaded scene, its display and the render options."""

    scene: Scene
    display: Display
    options: RenderOptions = field(default_factory=RenderOptions)
    arrange: Arrange | None = None

    def plan(self, portable: bool = False) -> ScenePlan:
        """Return a plan, usable in any process if `portable`. Raises errors of `arranged` and `Renderer`."""
        # Other processes and kept bands identify the scene by its files.
        scene = place_scene(self.scene, self.display, self.arrange)
        path = scene.path.absolute()  # resolve() would lose the files beside a link
        if portable and not path.exists():
            raise InputError("workers and kept bands need a scene file, not a scene in memory; give one")
        # The model is chosen, so the tolerance must not change the plan's identity.
        model = report_and_choose_model(scene, self.display, self.options)
        options = replace(self.options, model=model, tolerance=TOLERANCE)
        panel = self.display.panel
        bands = tuple(bands_of(*panel.size_px, options.settings.samples * colours_of(panel)))
        digest = digest_of(path) if portable else ""
        renderer = make_renderer(scene, self.display, options, bands, in_memory=not portable)
        if renderer.cache_report is not None:
            logger.info("%s", renderer.cache_report)
        options = replace(options, settings=renderer.settings)
        plan = ScenePlan(self.display, options, bands, path, digest, scene.placement)
        plan.planned_by.append(renderer)
        return plan
