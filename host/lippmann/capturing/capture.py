"""Renders the image that a camera or sensor captures through imaging lens and microlens array.

**Depth.** The display shows a captured point at a depth that follows from these steps,
to first order. Distances are along the axis, in mm.

1. The imaging lens (focal length f) images the object distance s at s', with 1/s' =
   1/f - 1/s, and multiplies heights by m = -s'/s (Hecht, Optics, section 5.2).
2. The array is at the distance a from the lens, and the point's image at z = a - s'
   before the array. If z < 0, the array intercepts the light before it converges.
3. The camera's pinhole is at L from the array. A lenslet (focal length f') images the
   pinhole to v before the array: 1/v = 1/f' - 1/L. The pixel at u from the lenslet's
   centre c shows the ray through c + u with slope c/L - u/v. On a sensor at D behind
   the array, the pixel shows the ray with slope -u/D through c.
4. The display emits the pixel's light through c with slope -u/g, or +u/g after rotation
   of the elemental images. g is the display's aperture distance.

The rays of all lenslets meet at z' = (g/v) (z - v) L / (L + z), x' = x L / (L + z) for
a camera, and at z' = (g/D) z, x' = x for a sensor. Rotation inverts the sign of z'. v
is negative for concave lenslets.

If the elemental images converge on an eye at E, u is 1 + g/E times as large, and the
slope of a lenslet's rays changes by c/E: 1/z'' = (1 + g/E)/z' + 1/E. With a sensor, the
captured rays change equally: z'' = z', or 1/z'' = 1/z' + 2/E after rotation.

Rays are traced against the light, in a left-handed frame: x is right and y is up as
seen by the camera, and z points to the lens. Lenslets and lenses are symmetric, so the
formulas hold in this frame.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lippmann.base.progress_protocol import Progress
from lippmann.base.variant import mi
from lippmann.capturing.capture_setup import Pickup, Setup
from lippmann.capturing.elemental_rotation import rotated, rotation_map
from lippmann.errors import InputError, warn_user
from lippmann.optics.backend import Arr, Backend, DrJitBackend, Point
from lippmann.optics.faces import Ray
from lippmann.optics.lattice import Lattice
from lippmann.optics.models import leave_panel
from lippmann.optics.rays import Floats, gets_through
from lippmann.optics.sample_points import square_to_cell
from lippmann.optics.system import System
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import Rendered, render_rays
from lippmann.rendering.sampling import Aperture, Lines, RaySource, owner_number
from lippmann.scenes.placement import Placement, placement_beside
from lippmann.scenes.scene import Scene

#: Percentage of lost rays above which a capture warns.
WARNING_PERCENT = 1.0


def check_placement(scene: Scene, setup: Setup) -> None:
    """Raise InputError for a scene at the lens, an image at the camera, or an array outside the image space."""
    far, near = scene.depth_range_mm
    lens, subject = setup.lens, setup.subject
    front = subject.distance_mm - (0.0 if lens is None else lens.extent_mm[1] - lens.hiatus_mm)
    if near >= front:
        raise InputError(
            f"set-up '{setup.name}': the scene extends {near:.4g} mm in front of the object's centre, but the lens or "
            f"array is {front:.4g} mm in front of it; move the object away, or make the scene smaller"
        )
    image = setup.image_distance([far, near])
    to_camera = setup.camera_distance_mm
    if lens is not None and to_camera is not None:
        # A point at the focal length from the lens has its image at infinity.
        at_infinity = far < subject.distance_mm - lens.focal_length_mm <= near
        camera_mm = setup.array_distance_mm + to_camera
        if at_infinity or camera_mm <= image.max():
            reaches = "infinity" if at_infinity else f"{image.max():.4g} mm"
            raise InputError(
                f"set-up '{setup.name}': camera.distance_mm: the scene's image ({image[0]:.4g} mm to {reaches}) "
                f"reaches the camera, {camera_mm:.4g} mm behind the lens; move the camera or the object away"
            )
    # Light of a point deeper than `reach` covers the whole display.
    panel, side = setup.display.panel, setup.display.array.finest_mm
    width_mm = max(panel.width_mm, panel.height_mm)
    reach = setup.display.aperture_distance_mm * width_mm / side
    depth = shown_depth(setup, [far, near], rotated=True)
    if depth[0] * depth[1] > 0.0 and np.abs(depth).min() > reach:
        raise InputError(
            f"set-up '{setup.name}': array.position_mm: {setup.position_mm:g} mm is outside the image space: the "
            f"scene's image is {image[0]:.4g} to {image[1]:.4g} mm behind the lens, the array "
            f"{setup.array_distance_mm:.4g} mm; {width_mm / side:.3g} lenslets across the display do not resolve "
            "this depth; move the array nearer to the image, or use a wider panel"
        )


def placement_before(setup: Setup, path: Path, setup_path: str | Path | None = None) -> Placement:
    """Return a scene file's placement, followed by the placement in the set-up.

    The .toml file beside the scene is ignored if it is the set-up file `setup_path`.
    """
    placement_file = path.with_suffix(".toml")
    is_setup = setup_path is not None and placement_file.exists() and placement_file.samefile(setup_path)
    return (Placement() if is_setup else placement_beside(path)).then(setup.subject.placement)


def capture(scene: Scene, setup: Setup, settings: Settings, rotate: bool, progress: Progress | None = None) -> Rendered:
    """Render the image that a set-up captures; `placement_before` has placed the scene.

    Only a set-up with a sensor uses `settings.aperture`. `rotate` rotates elemental
    images. The result's `lost_percent` has the percentages of rays that lens and array
    block. Raises InputError like `check_placement`, and if all rays are blocked.
    """
    check_placement(scene, setup)
    with ThreadPoolExecutor(1) as thread:
        partner = thread.submit(rotation_map, setup.display) if rotate else None
        rendered = render_rays(scene, capture_source(setup, settings.aperture), settings, progress)
        lens_percent, array_percent = rendered.lost_percent
        if array_percent >= 100.0:
            what = f"set-up '{setup.name}': array: total internal reflection blocks all rays in the lenslets"
            raise InputError(f"{what}; give a longer focal length, or a display with other lenslets")
        if lens_percent + array_percent > 100.0 - 1e-9:
            raise InputError(
                f"set-up '{setup.name}': lens.aperture_mm: no ray passes lens and array (the lens blocks "
                f"{lens_percent:.4g} %, the array {array_percent:.4g} %); make the aperture larger"
            )
        if partner is not None:
            rendered = replace(rendered, radiance=rotated(rendered.radiance, partner.result()))
    return rendered


def shown_depth(setup: Setup, z_mm: npt.ArrayLike, rotated: bool) -> Floats:
    """Return the depths, mm, at which the display shows points at depths z (mm, object's frame).

    The images of all points must be in front of the camera.
    """
    z = setup.array_distance_mm - setup.image_distance(z_mm)
    g = setup.display.aperture_distance_mm
    distance = setup.camera_distance_mm
    if distance is None:
        depth = z * g / setup.captured.aperture_distance_mm
    else:
        focal = setup.array.focal_length_mm * (-1.0 if setup.concave else 1.0)
        v = 1.0 / (1.0 / focal - 1.0 / distance)
        depth = (g / v) * (z - v) * distance / (distance + z)
    depth = -depth if rotated else depth
    eye_mm = setup.display.viewing_distance_mm
    if eye_mm is None or (distance is None and not rotated):
        return depth
    wider, lean = (1.0, 2.0 / eye_mm) if distance is None else (1.0 + g / eye_mm, 1.0 / eye_mm)
    # This form of 1 / (wider / depth + lean) is also valid for depth 0.
    with np.errstate(divide="ignore"):
        return np.asarray(depth / (wider + lean * depth))


def report_losses(lens_percent: float, array_percent: float) -> dict[str, float]:
    """Return a dict of the percentages of rays lost in lens and array; warn if high."""
    if lens_percent > WARNING_PERCENT:
        text = f"the lens's aperture cuts off {lens_percent:.1f} % of the rays (black in the image)"
        warn_user(f"{text}; increase lens.aperture_mm")
    if array_percent > WARNING_PERCENT:
        text = f"{array_percent:.1f} % of the rays are lost in the array (black in the image)"
        warn_user(f"{text}: the lenslets' rims reflect these rays; use a longer focal length")
    return {"vignetting_percent": lens_percent, "array_loss_percent": array_percent}


class CapturedRays(NamedTuple):
    """Rays to the scene in the object's frame, and masks of rays that passed array and lens."""

    ray: Ray
    through_array: Arr
    through_lens: Arr


def system_of(setup: Setup) -> System:
    """Return the optics of the set-up's array; each pixel has the same lenslet as in the display."""
    convergence = System.of(setup.display).convergence
    return replace(System.of(setup.captured), concave=setup.concave, convergence=convergence)


def rays_from_picture(b: Backend, setup: Setup, u: Arr, v: Arr, aperture: Point | None = None) -> CapturedRays:
    """Trace rays from the image's pixel coordinates u, v (double) to the object space.

    Rays to a sensor pass the lenslet's aperture at the point `aperture`, in mm from the
    centre along the array's axes; `None` means the centre.
    """
    system = system_of(setup)
    frame = system.frame
    if isinstance(setup.pickup, Pickup):
        i, j, x, y = system.locate(b, u, v)
    else:
        # The camera sees the pixel at `point` in the array's first principal plane.
        # Elemental images in the camera's picture are as large as on the display.
        point = system.convergence.towards_eye(*frame.array_from_panel(*frame.panel_from_pixel(u, v)))
        i, j, x, y = system.lattice.locate(b, *point)
        px, py = frame.panel_from_array(*point)
        to_camera = setup.camera_distance_mm
        assert to_camera is not None
        back = system.aperture_distance_mm / to_camera
        axis_x, axis_y = frame.turn_back(px, py)
        aperture = (x, y)
        x, y = x - axis_x * back, y - axis_y * back
    out = leave_panel(b, system, x, y, aperture, "exact")
    own = i, j
    i, j = i + b.double(out.di), j + b.double(out.dj)
    status = system.through_mount(b, out.status, (i, j), own)
    cx, cy = system.lattice.centre(i, j)
    px, py = frame.panel_from_array(cx + b.double(out.ray.x), cy + b.double(out.ray.y))
    dx, dy = frame.turn(out.ray.dx, out.ray.dy)
    # The rays run from the array's vertices through the lens to the object's frame.
    # The rays are in the engine's number format.
    ray = Ray(b.real(px), b.real(py), out.ray.z, dx, dy, out.ray.dz)
    lens = setup.lens
    object_z = setup.subject.distance_mm
    passed = ray.dz > 0.0
    if lens is not None:
        # The lens needs dz > 0, but lost rays may have dz <= 0.
        ray = ray._replace(z=ray.z - setup.array_distance_mm, dz=b.where(passed, ray.dz, 1.0))
        ray, inside = lens.trace(b, ray)
        passed = passed & inside
        object_z = object_z + lens.hiatus_mm
    return CapturedRays(ray._replace(z=object_z - ray.z, dz=-ray.dz), gets_through(status), passed)


def capture_source(setup: Setup, aperture: Aperture = "chief") -> RaySource:
    """Return a captured image's ray source (object's frame); `Lines.lost` has masks for lens and array."""
    panel, array = setup.display.panel, setup.array

    def lines(b: DrJitBackend, u: Arr, v: Arr, square: Point) -> Lines:
        aims = None
        if aperture == "full" and isinstance(setup.pickup, Pickup):
            x, y = square_to_cell(b, *square, Lattice.of(array))
            aims = (b.double(x), b.double(y))
        ray, through_array, through_lens = rays_from_picture(b, setup, u, v, aims)
        point = (mi.Float(ray.x), mi.Float(ray.y), mi.Float(ray.z))
        direction = (mi.Float(-ray.dx), mi.Float(-ray.dy), mi.Float(-ray.dz))
        lost = through_array & ~through_lens, mi.Bool(~through_array)
        return Lines(point, direction, through_array & through_lens, lost)

    def owner(b: DrJitBackend, u: Arr, v: Arr) -> Arr:
        return owner_number(*system_of(setup).locate(b, u, v)[:2])

    return RaySource(*panel.size_px, lines, detail_mm=array.finest_mm, owner=owner)
