"""Writes lens, array and camera of a set-up in POV-Ray's language (docs/reference/povray.md).

All z are in the object's frame, in which +z is towards lens, array and camera.
"""

from __future__ import annotations

import math

import numpy as np

from lippmann.capturing.capture_setup import Pickup, Setup
from lippmann.capturing.imaging_lens import Face, LensPair, ThinLens
from lippmann.capturing.povray_export import View
from lippmann.capturing.povray_text import block, matrix, number, pinhole, vector
from lippmann.display.description import Array, Display
from lippmann.errors import input_error
from lippmann.optics.lattice import Lattice
from lippmann.optics.system import PanelFrame

#: Extra lenslets beyond each side of the panel, for oblique rays.
SPARE_LENSLETS = 2
#: Maximum faces that a ray meets in the array, including lenslet walls.
ARRAY_FACES = 6
#: Overlap of adjacent lenslets as a fraction of their width: POV-Ray reflects rays at
#: walls between solids that only touch. Single precision loses some of an overlap of
#: 2e-5. A much larger overlap makes steps between the curved faces.
OVERLAP = 3e-5
#: Outer radius of the disc that stops light beside a lens, mm.
STOP_MM = 1e5

GLASS = "texture { pigment { rgbt 1 } finish { ambient 0 diffuse 0 } }"
BLACK = "texture { pigment { rgb 0 } finish { ambient 0 diffuse 0 } }"


def setup_view(setup: Setup) -> View:
    """Return a set-up's camera, array and lens; raise InputError for what POV-Ray cannot express."""
    where, panel = f"set-up '{setup.name}'", setup.display.panel
    to_plane = setup.camera_distance_mm
    if isinstance(setup.pickup, Pickup):
        raise input_error(where, "POV-Ray cannot render a sensor behind an array", "give a [camera]")
    if isinstance(setup.lens, ThinLens):
        raise input_error(where, "POV-Ray has no ideal thin lens", 'give a lens of kind "pair"')
    if setup.display.viewing_distance_mm is not None:
        what = "the display has a viewing_distance_mm, which the export does not support"
        raise input_error(where, what, "give a display without this key")
    assert to_plane is not None
    # Position z of the lens's origin or, without a lens, of the array's vertices.
    origin = setup.subject.distance_mm + (0.0 if setup.lens is None else setup.lens.hiatus_mm)
    position = (0.0, 0.0, origin + setup.pickup.distance_mm)
    camera = pinhole(position, (0.0, 0.0, -to_plane), panel.width_mm, panel.height_mm)
    side = 1.0 if setup.plano_to_camera else -1.0
    parts = [array_solids(setup.captured, origin + setup.array_distance_mm, side, setup.concave)]
    faces = ARRAY_FACES
    if isinstance(setup.lens, LensPair):
        parts += [_plano_convex(setup.lens, setup.lens.faces[k : k + 2], origin) for k in (0, 2)]
        faces += 4
    return View(camera, *panel.size_px, "\n".join(parts), faces)


def _plano_convex(pair: LensPair, faces: tuple[Face, ...], origin_mm: float) -> str:
    radius = 0.5 * pair.aperture_mm
    curved, flat = sorted(faces, key=lambda face: face.curvature == 0.0)
    # The lens's z axis is opposite to the object's z axis.
    centre = origin_mm - (curved.z_mm + 1.0 / curved.curvature)
    ends = [origin_mm - face.z_mm for face in (curved, flat)]
    outward = math.copysign(1.0, ends[1] - ends[0])
    solid = block(
        "intersection",
        f"cylinder {{ {vector((0, 0, ends[0]))}, {vector((0, 0, ends[1]))}, {number(radius)} open {BLACK} }}",
        f"sphere {{ {vector((0, 0, centre))}, {number(1.0 / abs(curved.curvature))} {GLASS} }}",
        f"plane {{ {vector((0, 0, outward))}, {number(ends[1] * outward)} {GLASS} }}",
        f"interior {{ ior {number(pair.index)} }} no_shadow",
    )
    hole = f"{vector((0, 0, ends[1]))}, z, {number(STOP_MM)}, {number(radius)}"
    # Scene surfaces must not reflect the stop, which covers half of all directions.
    stop = f"disc {{ {hole} {BLACK} no_shadow no_reflection }}"
    return f"{solid}\n{stop}"


def array_solids(display: Display, vertex_mm: float, side: float, concave: bool = False) -> str:
    """Return a display's lenslet as POV-Ray text, and a loop that repeats it.

    The lenslets' vertices are in the plane z = `vertex_mm`. The glass is on the +z side
    if `side` is +1, and on the -z side if `side` is -1.
    """
    array, depth = display.array, display.array.thickness_mm
    # The rims of a concave lenslet protrude beyond its centre.
    centre, front = (-array.radius_mm, -array.sag_mm) if concave else (array.radius_mm, 0.0)
    cell = _prism(array, side * front, side * depth)
    sphere = f"sphere {{ {vector((0, 0, side * centre))}, {number(array.radius_mm)} }}"
    if depth > array.radius_mm and not concave:
        # The sphere's far side would cut the substrate, so fill that side with glass.
        beyond = f"plane {{ {vector((0, 0, -side))}, {number(-array.radius_mm)} }}"
        sphere = f"merge {{ {sphere} {beyond} }}"
    body = f"difference {{ {cell} {sphere}" if concave else f"intersection {{ {sphere} {cell}"
    lenslet = f"#declare L_lenslet = {body} {GLASS} interior {{ ior {number(array.index)} }} no_shadow }}"
    rows, lattice = lattice_rows(display), Lattice.of(array)
    row = f"(Row + {rows[0][0]})"
    (p, _), (step_x, step_y) = lattice.centre(1.0, 0.0), lattice.centre(0.0, 1.0)
    solid, mount = "L_lenslet", ""
    if lattice.half_steps is not None:
        mount = f"#declare L_mount = object {{ {cell} {BLACK} no_shadow no_reflection }}\n"
        along = f"abs(2 * Column + {row if array.grid == 'hex' else '0'})"
        inside = f"{along} <= {lattice.half_steps[0]} & abs(2 * {row}) <= {lattice.half_steps[1]}"
        solid = f"#if ({inside}) L_lenslet #else L_mount #end"
    frame = PanelFrame.of(display)
    place = np.eye(4)
    place[:2, :2] = [[frame.cos, -frame.sin], [frame.sin, frame.cos]]
    place[:3, 3] = *frame.offset_mm, vertex_mm
    starts, ends = (", ".join(str(one[k]) for one in rows) for k in (1, 2))
    at = f"Column * {number(p)} + {row} * {number(step_x)}, {row} * {number(step_y)}, 0"
    return f"""{lenslet}
{mount}#declare L_first = array[{len(rows)}] {{ {starts} }}
#declare L_last = array[{len(rows)}] {{ {ends} }}
#for (Row, 0, {len(rows) - 1})
  #for (Column, L_first[Row], L_last[Row])
    object {{ {solid} translate <{at}> {matrix(place)} }}
  #end
#end"""


def _prism(array: Array, near: float, far: float) -> str:
    low, high = min(near, far), max(near, far)
    half = 0.5 * array.pitches_mm[0] * (1.0 + OVERLAP)
    if array.grid == "square" and array.regular:
        return f"box {{ {vector((-half, -half, low))}, {vector((half, half, high))} }}"
    corners = Lattice.of(array).corners
    # POV-Ray's prisms extend along y; the matrix rotates the prism to z.
    points = [f"<{number(x * (1.0 + OVERLAP))}, {number(y * (1.0 + OVERLAP))}>" for x, y in (*corners, corners[0])]
    sweep = f"linear_sweep linear_spline {number(low)}, {number(high)}, {len(points)}, {', '.join(points)}"
    return f"prism {{ {sweep} matrix <1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0> }}"


def lattice_rows(display: Display) -> list[tuple[int, int, int]]:
    """Return (row j, first i, last i) of lenslets on the panel and `SPARE_LENSLETS` around it."""
    panel, array = display.panel, display.array
    frame, lattice = PanelFrame.of(display), Lattice.of(array)
    spare = (SPARE_LENSLETS + 0.5) * array.coarsest_mm
    # A rotated panel is never wider than its diagonal.
    reach = math.hypot(panel.width_mm, panel.height_mm) + math.hypot(*array.offset_mm) + spare
    count = math.ceil(reach / min(array.row_pitch_mm, array.finest_mm))
    j, i = (axis.astype(float) for axis in np.mgrid[-count : count + 1, -3 * count : 3 * count + 1])
    x, y = frame.panel_from_array(*lattice.centre(i, j))
    covers = (np.abs(x) <= 0.5 * panel.width_mm + spare) & (np.abs(y) <= 0.5 * panel.height_mm + spare)
    rows = [(int(row[0]), columns[inside]) for row, columns, inside in zip(j, i, covers, strict=True) if inside.any()]
    return [(row, int(columns.min()), int(columns.max())) for row, columns in rows]
