"""Takes the picture of a scene through imaging lens and array, and turns its elemental images."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lippmann.capturing.depths import image_distance, shown
from lippmann.capturing.rays import CaptureSource
from lippmann.capturing.rotation import rotated, rotation_map
from lippmann.capturing.setup import Setup
from lippmann.errors import InputError
from lippmann.rendering.placement import Placement
from lippmann.rendering.renderer import Progress, Rendered, Settings, render
from lippmann.rendering.scene import Scene, placement_beside
from lippmann.variant import current_device, mitsuba

#: Pixels whose rays are followed to measure the vignetting.
PROBE_PIXELS = 1 << 20


@dataclass(frozen=True)
class Vignetting:
    """Per cent of the picture's rays that the lens's aperture cuts off, and that are lost in the array."""

    lens_percent: float
    array_percent: float


@dataclass(frozen=True)
class Captured:
    """A picture that the set-up's display shows, and what was lost on the way."""

    rendered: Rendered
    vignetting: Vignetting


def vignetting(source: CaptureSource) -> Vignetting:
    """Measure which share of the picture's rays is lost, over its pixels or a million of them at random."""
    mi = mitsuba()
    import drjit as dr

    total = source.width_px * source.height_px
    pixel = dr.arange(mi.UInt32, min(total, PROBE_PIXELS))
    if total > PROBE_PIXELS:
        # Scattered at random: any regular step beats with the lenslets.
        scattered, _ = mi.sample_tea_32(pixel, mi.UInt32(source.seed & 0xFFFFFFFF))
        pixel = mi.UInt32((mi.UInt64(scattered) * total) >> 32)
    _, through_array, through_lens = source.rays(pixel, mi.UInt32(0))
    in_array = np.broadcast_to(np.asarray(through_array), len(pixel))
    in_both = in_array & np.asarray(through_lens)
    return Vignetting(100.0 * float(np.mean(in_array & ~in_both)), 100.0 * float(np.mean(~in_array)))


def check_stand(scene: Scene, setup: Setup) -> None:
    """Refuse a scene, loaded with the set-up's placement, that cannot be captured where it stands.

    Raises
    ------
    InputError
        When the scene reaches into the lens or its image to the camera, or when the array stands outside the scene's
        image space.
    """
    far, near = scene.depth_range_mm
    lens, subject = setup.lens, setup.subject
    front = subject.distance_mm - (0.0 if lens is None else lens.extent_mm[1] - lens.hiatus_mm)
    if near >= front:
        raise InputError(
            f"set-up '{setup.name}': the scene reaches to {near:.4g} mm before the object's centre, into what stands "
            f"{front:.4g} mm before it; move the object away, or make the scene smaller"
        )
    image = image_distance(setup, [far, near])
    to_camera = setup.camera_distance_mm
    if lens is not None and to_camera is not None:
        # At the focal length the image is infinitely far; it grows monotonically before.
        at_infinity = far < subject.distance_mm - lens.focal_length_mm <= near
        if at_infinity or setup.array_distance_mm + to_camera <= image.max():
            reaches = "infinity" if at_infinity else f"{image.max():.4g} mm"
            raise InputError(
                f"set-up '{setup.name}': camera.distance_mm: the scene's image reaches the camera, "
                f"{setup.array_distance_mm + to_camera:.4g} mm behind the lens: it stands from {image[0]:.4g} mm to "
                f"{reaches}; move the camera or the object away"
            )
    # Where even one point's light would come from the whole display, nothing is left of an object.
    panel, array = setup.display.panel, setup.display.array
    reach = setup.display.aperture_distance_mm * max(panel.width_mm, panel.height_mm) / array.pitch_mm
    depth = shown(setup, [far, near], rotated=True).depth_mm
    if depth[0] * depth[1] > 0.0 and np.abs(depth).min() > reach:
        raise InputError(
            f"set-up '{setup.name}': array.position_mm: {setup.position_mm:g} mm is outside the image space: the "
            f"scene's image stands {image[0]:.4g} to {image[1]:.4g} mm behind the lens, the array "
            f"{setup.array_distance_mm:.4g} mm, and {max(panel.width_mm, panel.height_mm) / array.pitch_mm:.3g} "
            "lenslets across the display are too few for such a depth; give a position nearer to it, or a wider panel"
        )


def stand_of(path: Path, setup: Setup, setup_path: str | Path) -> Placement:
    """Return how a scene file stands before a set-up: its own placement, then the set-up's.

    A set-up that bears the scene's name, beside it, is no placement.
    """
    beside = path.with_suffix(".toml")
    own = Placement() if beside.exists() and beside.samefile(setup_path) else placement_beside(path)
    return own.then(setup.subject.placement)


def capture(scene: Scene, setup: Setup, settings: Settings, rotate: bool, progress: Progress | None = None) -> Captured:
    """Take the picture of a scene.

    Parameters
    ----------
    scene
        The scene, placed in the object's frame (`Subject.placement`).
    setup
        The set-up.
    settings
        How to render; `aperture` is for a pickup.
    rotate
        Whether elemental images are turned by 180 degrees.
    progress
        See `render`.

    Raises
    ------
    InputError
        When the scene or the array stands where nothing can be seen, or no light gets through the lens.
    """
    check_stand(scene, setup)
    source = CaptureSource(setup, settings.samples, settings.aperture, settings.seed, current_device())
    lost = vignetting(source)
    if lost.array_percent >= 100.0:
        raise InputError(
            f"set-up '{setup.name}': array: no ray of the picture gets through the lenslets: their domes reflect all "
            "of it; give them a longer focal length, or a display whose lenslets are not seen at their rims alone"
        )
    if lost.lens_percent + lost.array_percent >= 100.0:
        raise InputError(
            f"set-up '{setup.name}': lens.aperture_mm: no ray of the picture gets through the lens (vignetting "
            f"{lost.lens_percent:.4g} %, lost in the array {lost.array_percent:.4g} %); make the aperture larger"
        )
    with ThreadPoolExecutor(1) as other:
        # Needs one core while Dr.Jit compiles, which takes one too.
        partner = other.submit(rotation_map, setup.display) if rotate else None
        rendered = render(scene, source, settings, progress)
        if partner is not None:
            rendered = replace(rendered, radiance=rotated(rendered.radiance, partner.result()))
    return Captured(rendered, lost)
