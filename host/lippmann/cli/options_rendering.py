"""Options, shared by several commands, for rendering and for placing a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    integrator: str = option("Integrator: lights; Mitsuba's direct, path, ...; or scene (as in the file).", "lights"),
    max_depth: int = option("Maximum surfaces per ray, 1 to 1000.", 4),
) -> Settings:
    return Settings(integrator=integrator, max_depth=max_depth, seed=seed)


#: Group of light-transport options, for commands with --seed.
LIGHT: Any = _light


def _settings(
    aperture: Aperture | None,
    samples: int = option("Samples per pixel, 1 to 65536.", 4),
    light: Settings = LIGHT,
    memory_mb: float | None = option("Memory limit, MB.  [default: 80 % of the free memory]"),
    shading: Shading = option(
        "Irradiance cache: always (shared), never (each), or if a trial reaches 45 dB (auto).", "auto"
    ),
) -> Settings:
    return replace(light, samples=samples, aperture=aperture or "full", memory_mb=memory_mb, shading=shading)


#: Group of render settings, for commands with --seed and --aperture.
SETTINGS: Any = _settings


def _render_options(
    model: ModelOption = option("Lens model; auto chooses the cheapest model within --tolerance.", "auto"),
    tolerance: float = option("Maximum error for --model auto, pixels of the reconstructed view.", TOLERANCE),
    engine: Engine = option("Engine that traces the rays; rtl simulates the FPGA.", "fast"),
    fraction_bits: int | None = ENGINE_BITS,
    aperture: Aperture = option("Chief rays only, or rays over the full lenslet.", "chief"),
    settings: Settings = SETTINGS,
) -> RenderOptions:
    return RenderOptions(model, tolerance, engine, fraction_bits, settings)


#: Group of render options, for commands with --seed.
RENDERING: Any = _render_options
WORKERS = option("Number of local render processes, 1 to 64.")
SCHEDULER = option("Render on the workers of this Dask scheduler: tcp://HOST:8786.", metavar="ADDRESS")


@dataclass(frozen=True)
class Moved:
    """Group of options that change a scene's placement."""

    scale: float | None = option("Scale, mm per scene unit.")
    rotate: Point | None = option("Rotation about x, then y, then z, degrees.")
    offset: Point | None = option("Position of the scene's origin, mm.")
    depth: float | None = option("Distance to move the scene towards the viewer, mm.")
    near: float | None = option("Depth z at which primary rays start, mm.")
    far: float | None = option("Farthest depth z of interest, mm.")
    fit: bool = option("Fit the scene into the display's depth range.")
    from_camera: bool = option("Place the scene as the camera in its file sees it.")

    @property
    def changes(self) -> dict[str, Any]:
        """Values of the given options, keyed by name."""
        return {name: value for name, value in vars(self).items() if value is not None and value is not False}

    def arrange(self, scene_path: Path) -> Arrange | None:
        """Return the automatic placement for the display; None uses only `placement`.

        Raises InputError for an option that would have no effect.
        """
        if not (self.fit or self.from_camera):
            return None if self.changes.keys() - {"rotate"} else usual_arrange(scene_path)
        first, allowed = ("fit", {"fit", "rotate"}) if self.fit else ("from-camera", {"from_camera"})
        for name in self.changes.keys() - allowed:
            raise InputError(f"{flag_of(name)} and --{first} both place the scene; leave one out")
        return "fit" if self.fit else "camera"

    def placement(self, scene_path: Path) -> Placement:
        """Return the placement from the scene's placement file, changed by the options."""
        own = placement_beside(scene_path)
        x, y, z = own.offset_mm if self.offset is None else self.offset
        names = {"scale": "scale", "rotate": "rotation_deg", "near": "near_mm", "far": "far_mm"}
        changed = {names[name]: value for name, value in self.changes.items() if name in names}
        changed = {"near_mm": None, "far_mm": None, "offset_mm": (x, y, z + (self.depth or 0.0)), **changed}
        return replace(own, **changed).keeping_depths(own)

    def load(self, scene_path: Path, display: Display) -> Scene:
        """Load a scene, and place it for a display."""
        arrange, placement = self.arrange(scene_path), self.placement(scene_path)
        return place_scene(load_scene(scene_path, placement), display, arrange)


MOVED: Any = Moved
