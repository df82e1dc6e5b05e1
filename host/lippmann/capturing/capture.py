"""Renders what a camera or sensor captures of a scene through imaging lens and array, and rotates elemental images."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from lippmann.base.progress import Progress
from lippmann.capturing.depths import shown_depth
from lippmann.capturing.rays import capture_source
from lippmann.capturing.rotation import rotated, rotation_map
from lippmann.capturing.setup import Setup
from lippmann.errors import InputError
from lippmann.rendering.renderer import Rendered, Settings, render_rays
from lippmann.scenes.placement import Placement, placement_beside
from lippmann.scenes.scene import Scene


def check_placement(scene: Scene, setup: Setup) -> None:
    """Raise InputError for a scene, loaded with the set-up's placement, that cannot be captured.

    It extends into the lens, or its image to the camera, or the array is outside the image space.
    """
    far, near = scene.depth_range_mm
    lens, subject = setup.lens, setup.subject
    front = subject.distance_mm - (0.0 if lens is None else lens.extent_mm[1] - lens.hiatus_mm)
    if near >= front:
        raise InputError(
            f"set-up '{setup.name}': the scene extends {near:.4g} mm before the object's centre, beyond the lens or "
            f"array {front:.4g} mm before it; move the object away, or make the scene smaller"
        )
    image = setup.image_distance([far, near])
    to_camera = setup.camera_distance_mm
    if lens is not None and to_camera is not None:
        # The image distance grows monotonically with the scene's nearness, to infinity at the focal length.
        at_infinity = far < subject.distance_mm - lens.focal_length_mm <= near
        if at_infinity or setup.array_distance_mm + to_camera <= image.max():
            reaches = "infinity" if at_infinity else f"{image.max():.4g} mm"
            raise InputError(
                f"set-up '{setup.name}': camera.distance_mm: the scene's image reaches the camera, "
                f"{setup.array_distance_mm + to_camera:.4g} mm behind the lens: it extends from {image[0]:.4g} mm to "
                f"{reaches}; move the camera or the object away"
            )
    # Beyond this depth the light of a single point comes from the whole display: an object is not recognisable.
    panel, array = setup.display.panel, setup.display.array
    reach = setup.display.aperture_distance_mm * max(panel.width_mm, panel.height_mm) / array.finest_mm
    depth = shown_depth(setup, [far, near], rotated=True)
    if depth[0] * depth[1] > 0.0 and np.abs(depth).min() > reach:
        raise InputError(
            f"set-up '{setup.name}': array.position_mm: {setup.position_mm:g} mm is outside the image space: the "
            f"scene's image is {image[0]:.4g} to {image[1]:.4g} mm behind the lens, the array "
            f"{setup.array_distance_mm:.4g} mm, and {max(panel.width_mm, panel.height_mm) / array.finest_mm:.3g} "
            "lenslets across the display are too few for such a depth; give a position nearer to it, or a wider panel"
        )


def placement_before(setup: Setup, path: Path, setup_path: str | Path | None = None) -> Placement:
    """Return the placement of a scene file before a set-up: the file's own, then the set-up's.

    If the file beside the scene that has its name is the set-up's own (`setup_path`), it is not the scene's placement.
    """
    beside = path.with_suffix(".toml")
    is_setup = setup_path is not None and beside.exists() and beside.samefile(setup_path)
    return (Placement() if is_setup else placement_beside(path)).then(setup.subject.placement)


def capture(
    scene: Scene,
    setup: Setup,
    settings: Settings,
    rotate: bool,
    progress: Progress | None = None,
    note: Callable[[str], None] | None = None,
) -> Rendered:
    """Render the image that a set-up captures of a scene; its `lost_percent` are those of the lens and of the array.

    The scene is placed in the object's frame (`placement_before`). `settings.aperture` is for a pickup. `rotate` is
    whether elemental images are rotated by 180 degrees.

    Raises InputError when the scene cannot be captured (`check_placement`), or no light passes the array or the lens.
    """
    check_placement(scene, setup)
    with ThreadPoolExecutor(1) as other:
        # Takes one core, while compilation takes another.
        partner = other.submit(rotation_map, setup.display) if rotate else None
        rendered = render_rays(scene, capture_source(setup, settings.aperture), settings, progress, note)
        lens_percent, array_percent = rendered.lost_percent
        if array_percent >= 100.0:
            raise InputError(
                f"set-up '{setup.name}': array: no ray of the image gets through the lenslets: total internal "
                "reflection; give them a longer focal length, or a display with other lenslets"
            )
        if lens_percent + array_percent > 100.0 - 1e-9:
            raise InputError(
                f"set-up '{setup.name}': lens.aperture_mm: no ray of the image gets through the lens (vignetting "
                f"{lens_percent:.4g} %, lost in the array {array_percent:.4g} %); make the aperture larger"
            )
        if partner is not None:
            rendered = replace(rendered, radiance=rotated(rendered.radiance, partner.result()))
    return rendered
