"""The options of rendering and of the scene's placement, which several commands share."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from lippmann.cli.frame import flag_of, option
from lippmann.cli.options import ENGINE_BITS, Point
from lippmann.display.description import Display
from lippmann.errors import InputError
from lippmann.optics.model_choice import TOLERANCE
from lippmann.optics.rays import Engine
from lippmann.rendering.options import ModelOption, RenderOptions, Settings, Shading
from lippmann.rendering.plan import place_scene
from lippmann.rendering.sampling import Aperture
from lippmann.scenes.placement import Arrange, Placement, placement_beside, usual_arrange
from lippmann.scenes.scene import Scene, load_scene


def _light(
    seed: int,
    integrator: str = option("lights, any of Mitsuba's (direct, path, ...), or scene for the file's own.", "lights"),
    max_depth: int = option("Surfaces that a ray may meet, 1 to 1000.", 4),
) -> Settings:
    return Settings(integrator=integrator, max_depth=max_depth, seed=seed)


#: How light is followed; the command has --seed too.
LIGHT: Any = _light


def _settings(
    aperture: Aperture | None,
    samples: int = option("Samples for each pixel, 1 to 65536.", 4),
    light: Settings = LIGHT,
    memory_mb: float | None = option("Memory limit.  [default: four fifths of the free memory]", None),
    shading: Shading = option(
        "Whether rays share the light of diffuse surfaces; auto does where it pays and a trial has 45 dB or more.",
        "auto",
    ),
) -> Settings:
    return replace(light, samples=samples, aperture=aperture or "full", memory_mb=memory_mb, shading=shading)


#: How a scene is rendered; the command has --seed and --aperture too.
SETTINGS: Any = _settings


def _render_options(
    model: ModelOption = option("Lens model; auto chooses the cheapest within the tolerance.", "auto"),
    tolerance: float = option("Error that auto allows, pixels of the reconstructed view; above 0.", TOLERANCE),
    engine: Engine = option("Traces the rays through the lenslets; rtl shows what the FPGA would show.", "fast"),
    fraction_bits: int | None = ENGINE_BITS,
    aperture: Aperture = option("Chief rays, or rays over the whole lenslet.", "chief"),
    settings: Settings = SETTINGS,
) -> RenderOptions:
    return RenderOptions(model, tolerance, engine, fraction_bits, settings)


#: The options of a render; the command has --seed too.
RENDERING: Any = _render_options


@dataclass(frozen=True)
class Moved:
    """The changes of a scene's placement that a command's options ask for."""

    scale: float | None = option("mm for each scene unit.", None)
    rotate: Point | None = option("Degrees about x, then y, then z.", None)
    offset: Point | None = option("Position of the scene's origin, mm.", None)
    depth: float | None = option("Moves the scene towards the viewer, mm.", None)
    near: float | None = option("Depth z where primary rays start, mm.", None)
    far: float | None = option("Farthest depth of interest, mm.", None)
    fit: bool = option("Scale and move the scene into the display's depth range.", False)
    from_camera: bool = option("Place the scene as the camera in its file sees it.", False)

    @property
    def given(self) -> dict[str, Any]:
        """The options that are given, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None and value is not False}

    def arrange(self, scene_path: Path) -> Arrange | None:
        """Return how the display places the scene, if at all; refuse options that would be overruled."""
        if not (self.fit or self.from_camera):
            return None if self.given.keys() - {"rotate"} else usual_arrange(scene_path)
        first, allowed = ("fit", {"fit", "rotate"}) if self.fit else ("from-camera", {"from_camera"})
        for name in self.given.keys() - allowed:
            raise InputError(f"{flag_of(name)} and --{first} both place the scene; leave one out")
        return "fit" if self.fit else "camera"

    def placement(self, scene_path: Path) -> Placement:
        """Return the placement beside the scene, changed by the options."""
        own = placement_beside(scene_path)
        placement = replace(own, near_mm=None, far_mm=None)
        offset = placement.offset_mm if self.offset is None else self.offset
        if self.depth is not None:
            offset = (offset[0], offset[1], offset[2] + self.depth)
        names = {"scale": "scale", "rotate": "rotation_deg", "near": "near_mm", "far": "far_mm"}
        changed = {names[name]: value for name, value in self.given.items() if name in names}
        return replace(placement, offset_mm=offset, **changed).keeping_depths(own)

    def load(self, scene_path: Path, display: Display) -> Scene:
        """Load a scene, and place it for a display as the options say."""
        return place_scene(load_scene(scene_path, self.placement(scene_path)), display, self.arrange(scene_path))


#: The options of a scene's placement, as a `Moved`.
MOVED: Any = Moved
