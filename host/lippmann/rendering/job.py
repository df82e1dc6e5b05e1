"""A job: what to draw for which display, with what may still be "auto". Its plan decides that, once."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from lippmann.base.variant import VARIANTS, own_variant
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.optics.model_choice import TOLERANCE
from lippmann.optics.rays import Model
from lippmann.rendering.bands import bands_of
from lippmann.rendering.diagnostics import warn_of_unused_parts, warn_of_view
from lippmann.rendering.options import RenderOptions
from lippmann.rendering.plan import ScenePlan, make_renderer, resolve_model
from lippmann.rendering.sampling import colours_of
from lippmann.scenes.arrange import arranged
from lippmann.scenes.placement import Arrange, Placement
from lippmann.scenes.scene import Scene, check_scene_file, digest_of, load_scene, scene_of

if TYPE_CHECKING:
    import mitsuba as mi

logger = logging.getLogger("lippmann")
#: A scene: its path, what `lippmann.load_scene` returned, a `mitsuba.Scene`, or a dictionary of `mitsuba.load_dict`.
SceneSource: TypeAlias = "str | Path | Scene | dict[str, Any] | mi.Scene"


@contextlib.contextmanager
def open_scene(source: SceneSource, placement: Placement | None = None, device: str = "auto") -> Iterator[Scene]:
    """Set Mitsuba's variant for a block, and yield the scene; a path is loaded first. See `lippmann.load_scene`.

    Raises InputError for a bad scene or device, MissingLibraryError as `start_mitsuba`.
    """
    if not isinstance(placement, Placement | None):
        raise InputError(f"placement must be a lippmann.Placement or None, not {str(placement)[:80]!r}")
    if isinstance(source, str | Path):
        check_scene_file(source)
        with own_variant(device):
            yield load_scene(source, placement)
        return
    if not isinstance(source, Scene):
        # A mitsuba.Scene has its variant, by which it was loaded.
        variant_name = getattr(type(source), "variant_name", None)
        with own_variant(device if variant_name is None else _device_of(variant_name(source))):
            yield scene_of(source, placement)
        return
    own = _device_of(source.mitsuba.variant_name())
    if device not in ("auto", own):
        raise InputError(f"the scene was loaded for device '{own}', not '{device}'; load it again")
    with own_variant(own):
        yield source if placement is None else source.placed(placement)


def _device_of(variant: str) -> str:
    """Return the device of a variant of Mitsuba."""
    for name, own in VARIANTS.items():
        if own == variant:
            return name
    raise InputError(f"the scene is of Mitsuba's variant {variant}; load it after set_variant('{VARIANTS['llvm']}')")


def place_scene(scene: Scene, display: Display, arrange: Arrange | None = None) -> Scene:
    """Return a scene as a display places it; None: as its file asks for. InputError as `arranged`."""
    arrange = scene.usual if arrange is None else arrange
    if arrange is None:
        return scene
    placed = arranged(scene, display, arrange)
    logger.info("placed by %s", placed.placement)
    return placed


def choose_model(scene: Scene, display: Display, options: RenderOptions) -> Model:
    """Return the lens model for a placed scene, after warnings about what will be seen of it.

    There are none where nobody reads the log (level INFO): their trial view takes time.
    Raises InputError as `resolve_model`.
    """
    if logger.isEnabledFor(logging.INFO):
        warn_of_unused_parts(scene, options.settings)
        warn_of_view(scene, display, options.settings, options.engine)
    return resolve_model(scene, display, options, logger)


@dataclass(frozen=True)
class Job:
    """The picture of a loaded scene for a display."""

    scene: Scene
    display: Display
    options: RenderOptions = field(default_factory=RenderOptions)
    #: How the display places the scene; None: as its file asks for, or where it stands.
    arrange: Arrange | None = None

    def plan(self, portable: bool = False) -> ScenePlan:
        """Decide all that is "auto".

        A portable plan is for other processes or for bands that are kept: it identifies the scene by its files.
        Raises InputError for a scene that has no file then, or cannot be placed, and as `choose_model` and `Renderer`.
        """
        scene = place_scene(self.scene, self.display, self.arrange)
        path = scene.path.absolute()  # workers have folders of their own; the files of a link are those beside it
        if portable and not path.exists():
            raise InputError("a scene in memory can neither be shared with workers nor be kept; give its file")
        # No tolerance is left when the model is chosen.
        options = replace(self.options, model=choose_model(scene, self.display, self.options), tolerance=TOLERANCE)
        panel = self.display.panel
        rays = options.settings.samples * colours_of(panel)
        bands = tuple(bands_of(panel.width_px, panel.height_px, rays))
        digest = digest_of(path) if portable else ""
        renderer = make_renderer(scene, self.display, options, bands, in_memory=not portable)
        if renderer.remark is not None:
            logger.info("%s", renderer.remark)
        options = replace(options, settings=renderer.settings)
        plan = ScenePlan(self.display, options, bands, path, digest, scene.placement)
        plan.planned_by.append(renderer)
        return plan
