"""Loads a scene or a part of a scene, and moves its shapes."""

from __future__ import annotations

import fnmatch
import itertools
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lippmann.base.file_limits import check_xml
from lippmann.base.variant import dr, mi
from lippmann.errors import InputError, check_type, input_error, likely_file, missing_library, path_of
from lippmann.scenes.formats import FORMATS, SUFFIXES, as_mitsuba, kind_of
from lippmann.scenes.light_field_emitter import register_light_field
from lippmann.scenes.meshes import check_faces
from lippmann.scenes.placement import Arrange, Matrix, Placement, front_of, placement_beside, usual_arrange

if TYPE_CHECKING:
    import mitsuba as mts

#: A bounding box: the corners with the lowest and the highest x, y, z, (3,) each.
Box = tuple[Matrix, Matrix]
#: Minimum size of surroundings on each axis, divided by the size of all other shapes.
SURROUNDS = 3.0
#: Box around most splats: percentiles, relative margin, a splat's extent in sigmas.
STRAY_PERCENT, STRAY_REACH, SIGMAS = (5.0, 95.0), 0.25, 3.0
LISTED_IDS = 8
#: Maximum values in a lamp's property; a picture has more.
LAMP_NUMBERS = 16


@dataclass(frozen=True)
class Move:
    """A similarity transform (4, 4) of the shapes whose id matches a pattern (`*`, `?`)."""

    shapes: str
    matrix: Matrix


@dataclass(frozen=True)
class Part:
    """A part of a scene: all lights, and the shapes whose id does or does not match a pattern (`*`, `?`)."""

    shapes: str
    matching: bool = True


@dataclass(frozen=True)
class Scene:
    """A loaded scene: path, `mitsuba.Scene`, and placement with near and far depth."""

    path: Path
    mitsuba: mts.Scene
    placement: Placement
    #: The file's own integrator; if None, Mitsuba adds one.
    integrator: str | None = None
    #: Whether the file has its own camera; if not, Mitsuba adds one.
    has_camera: bool = False
    #: The default arrangement (`usual_arrange`), if the scene has no placement.
    usual: Arrange | None = None
    #: Messages for the user about the file's conversion.
    notes: tuple[str, ...] = ()

    @cached_property
    def bounds(self) -> Box:
        """The scene's bounding box, scene units; see `bounds_of`."""
        return bounds_of(self.mitsuba)

    @property
    def width_mm(self) -> float:
        """Largest side of the placed scene's bounding box, mm; 0 if it has no surface."""
        low, high = self.bounds
        return float(self.placement.scale * (high - low).max()) if np.isfinite(high - low).all() else 0.0

    @property
    def depth_range_mm(self) -> tuple[float, float]:
        """Depth range z of the placed scene, (far, near), mm."""
        near, far = self.placement.near_mm, self.placement.far_mm
        assert near is not None
        assert far is not None
        return far, near

    def box(self, placement: Placement) -> Box:
        """Return the scene's bounding box after `placement`, mm; infinite if the scene is unbounded."""
        return placed_box(self.bounds, placement)

    def placed(self, placement: Placement) -> Scene:
        """Return the scene, placed anew; its box replaces missing depths. Raises InputError for an infinite box."""
        check_type("placement", placement, Placement, "a lippmann.Placement")
        near, far = placement.near_mm, placement.far_mm
        if near is None or far is None:
            low, high = self.box(placement)
            if not np.isfinite(low).all():
                raise InputError(
                    f"{self.path}: the scene has no bounded extent; give near_mm and far_mm in its placement"
                )
            near = front_of(low, high) if near is None else near
            far = float(low[2]) if far is None else far
        return replace(self, placement=replace(placement, near_mm=near, far_mm=far), usual=None)


def check_scene_file(path: str | Path) -> Path:
    """Return the path of a scene file, or raise InputError."""
    path = path_of(path, "a scene")
    if not path.exists():
        raise input_error(path, "no such scene", likely_file(path, SUFFIXES) or FORMATS)
    if kind_of(path) is None:
        layers = "; for layers, a folder with layers.toml or pictures.toml" if path.is_dir() else ""
        raise input_error(path, "is a folder" if path.is_dir() else "is not a scene", f"{FORMATS}{layers}")
    return path


def _check_files(path: Path) -> None:
    """Refuse a scene file or an included file that would crash Mitsuba's parser."""
    files = [path]
    for file in files:  # the loop appends to `files`
        for include in map(file_of, check_xml(file, "mend the scene file")):
            if include not in files and (include.is_file() or include.is_fifo()):
                files.append(include)


@contextmanager
def parsed(
    path: Path, scene_from_display: Matrix | None = None, notes: list[str] | None = None
) -> Iterator[tuple[mts.parser.ParserConfig, mts.parser.ParserState]]:
    """Parse a scene; yield the configuration and state of Mitsuba's parser, or raise InputError."""
    # `as_mitsuba` uses `scene_from_display` and `notes` to convert other formats.
    register_light_field()
    before = mi.file_resolver()
    try:
        rotation = np.eye(3) if scene_from_display is None else scene_from_display
        with as_mitsuba(path, rotation, [] if notes is None else notes) as file:
            resolver = mi.FileResolver(before)
            resolver.prepend(mi.filesystem.path(str(file.parent)))
            mi.set_file_resolver(resolver)
            config = mi.parser.ParserConfig(mi.variant())
            _check_files(file)
            yield config, mi.parser.parse_file(config, str(file))
    except InputError:
        raise
    except ImportError as error:
        raise missing_library(error) from None
    except OSError as error:
        what = f"names {error.filename}, which cannot be read ({error.strerror})"
        raise input_error(path, what, "mend the scene file") from None
    except Exception as error:  # Mitsuba's errors have no common base
        raise input_error(path, without_places(error)[:400], "mend the scene file") from None
    finally:
        mi.set_file_resolver(before)


def without_places(error: Exception) -> str:
    """Return Mitsuba's error message on one line, without positions in its source."""
    return re.sub(r"\[\w+\.cpp:\d+\] *", "", " ".join(str(error).split())) or type(error).__name__


def load_scene(
    path: str | Path, placement: Placement | None = None, moves: Sequence[Move] = (), part: Part | None = None
) -> Scene:
    """Load a scene file or a part of it, move shapes, and place it, by default by `placement_beside`.

    Raises InputError for an invalid file, a move that matches no shape, and a part that
    matches no shape or all shapes.
    """
    path = check_scene_file(path)
    usual, notes = None, list[str]()
    if placement is None:
        usual, placement = usual_arrange(path), placement_beside(path)
    check_type("placement", placement, Placement, "a lippmann.Placement or None")
    rotation = placement.scene_from_display[:3, :3] * placement.scale
    with parsed(path, rotation, notes) as (config, state):
        kinds = mi.ObjectType.Shape, mi.ObjectType.Integrator, mi.ObjectType.Sensor
        shapes, integrators, cameras = ([node.props for node in state.nodes if node.type == kind] for kind in kinds)
        # The parser's next step invalidates the nodes that are read here.
        integrator = integrators[0].plugin_name() if integrators else None
        for move in moves:
            motion = mi.ScalarTransform4d(move.matrix)
            for props in _matching(shapes, move.shapes, path):
                props["to_world"] = motion @ props["to_world"] if "to_world" in props else motion
        if part is not None:
            _keep(part, state, path)
        mi.parser.transform_all(config, state)
        for node in state.nodes:
            if node.props.plugin_name() == "ply" and "filename" in node.props:
                check_faces(file_of(str(node.props["filename"])))
        scene = mi.parser.instantiate(config, state)
    if not isinstance(scene, mi.Scene):
        raise input_error(path, "contains no scene", "make <scene> its outermost element")
    _check_numbers(scene, str(path))
    loaded = Scene(path, scene, placement, integrator, bool(cameras), notes=tuple(notes))
    return replace(loaded.placed(placement), usual=usual)


def scene_of(scene: mts.Scene | dict[str, object], placement: Placement | None = None) -> Scene:
    """Return a Scene for a `mitsuba.Scene` or its dictionary, or raise InputError."""
    if isinstance(scene, dict):
        try:
            scene = mi.load_dict(scene)
        except Exception as error:  # Mitsuba's errors have no common base
            raise InputError(f"the scene's dictionary: {' '.join(str(error).split())[:400]}; mend it") from None
    if not isinstance(scene, mi.Scene):
        what = f"{type(scene).__name__} is not a scene"
        raise InputError(f"{what}; give a path, a mitsuba.Scene or a dictionary of the type scene")
    _check_numbers(scene, "the scene")
    placement = Placement() if placement is None else placement
    return Scene(Path("scene"), scene, placement, None, bool(scene.sensors())).placed(placement)


def _check_numbers(scene: mts.Scene, where: str) -> None:
    for part in mi.traverse(scene).hierarchy:
        is_lamp = isinstance(part, mi.Emitter)
        for name, value in mi.traverse(part) if is_lamp or isinstance(part, mi.BSDF | mi.Medium) else ():
            is_plain = isinstance(value, float) or (value is not None and dr.is_array_v(value))
            numbers = value if is_plain else getattr(value, "matrix", 0)
            if not dr.is_float_v(numbers) or (is_lamp and math.prod(dr.shape(numbers)) > LAMP_NUMBERS):
                continue
            if not np.isfinite(np.array(numbers)).all():
                kind = "lamp" if is_lamp else "material"
                which = f"the {kind} '{part.id()}'" if part.id() else f"a {part.class_name()}"
                raise input_error(where, f"{name} of {which} is not finite", "give finite numbers")


def _keep(part: Part, state: mts.parser.ParserState, path: Path) -> None:
    root, child = state.root.props, mi.Properties.ResolvedReference
    names = list(root.keys())
    inside = {name: state.nodes[root[name].index()] for name in names if isinstance(root[name], child)}
    shapes = {name: node.props for name, node in inside.items() if node.type == mi.ObjectType.Shape}
    ids = {props.id() for props in _matching(list(shapes.values()), part.shapes, path)}
    matches = {name for name, props in shapes.items() if props.id() in ids}
    if len(matches) == len(shapes):
        raise input_error(path, f"every shape's id matches '{part.shapes}'", "choose a narrower pattern")
    for name in matches ^ (set(shapes) if part.matching else set()):
        del root[name]


def _matching(shapes: Sequence[mts.Properties], pattern: str, path: Path) -> list[mts.Properties]:
    """Return shapes whose id matches a pattern; if none does, raise InputError with a list of ids."""
    matches = [props for props in shapes if fnmatch.fnmatchcase(props.id(), pattern)]
    if not matches:
        ids = [props.id() for props in shapes if props.id()]
        more = f" and {len(ids) - LISTED_IDS} more" if len(ids) > LISTED_IDS else ""
        listed = f"there are {', '.join(ids[:LISTED_IDS])}{more}"
        remedy = listed if ids else 'give the shapes ids in the file: <shape type="ply" id="...">'
        raise input_error(path, f"no shape's id matches '{pattern}'", remedy)
    return matches


def file_of(name: str) -> Path:
    """Return the path of a file that a scene names."""
    return Path(str(mi.file_resolver().resolve(mi.filesystem.path(name))))


def _boxes(scene: mts.Scene) -> list[Box]:
    boxes = []
    for shape in scene.shapes():
        # Mitsuba merges rectangles of one material into a mesh with an empty box.
        if isinstance(shape, mi.Mesh) and not shape.bbox().valid():
            shape.recompute_bbox()
        box = shape.bbox()
        low, high = (np.array(corner, np.float64).ravel() for corner in (box.min, box.max))
        boxes.append(_box_of_most_splats(shape, low, high) if shape.is_ellipsoids() else (low, high))
    return boxes


def _box_of_most_splats(shape: mts.Shape, lowest: Matrix, highest: Matrix) -> Box:
    data = np.array(mi.traverse(shape)["data"], np.float64).reshape(-1, 10)
    centres, reach = data[:, :3], SIGMAS * data[:, 3:6].max(axis=1, keepdims=True)
    low = np.percentile(centres - reach, STRAY_PERCENT[0], axis=0)
    high = np.percentile(centres + reach, STRAY_PERCENT[1], axis=0)
    beyond = STRAY_REACH * (high - low)
    return np.maximum(low - beyond, lowest), np.minimum(high + beyond, highest)


def union_of(boxes: Sequence[Box]) -> Box:
    """Return the smallest box that contains all boxes."""
    if not boxes:
        return np.full(3, np.inf), np.full(3, -np.inf)
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)


def bounds_of(scene: mts.Scene) -> Box:
    """Return a `mitsuba.Scene`'s bounding box, in scene units, excluding its surroundings."""
    # Rays that start outside a studio or a sky would not see the scene inside.
    boxes = sorted(_boxes(scene), key=lambda box: float(np.prod(box[1] - box[0])))
    while len(boxes) > 1:
        (low, high), (outer_low, outer_high) = union_of(boxes[:-1]), boxes[-1]
        around = (outer_low <= low).all() and (outer_high >= high).all()
        if not (around and (outer_high - outer_low >= SURROUNDS * (high - low)).all() and _closed(scene, low, high)):
            break
        boxes.pop()
    return union_of(boxes)


def _closed(scene: mts.Scene, low: Matrix, high: Matrix) -> bool:
    # A ray outwards from each face of the box must hit a surface.
    middle, half = (low + high) / 2, (high - low) / 2
    outwards = np.concatenate([np.eye(3), -np.eye(3)])
    starts = middle + (half + 1e-3 * half.max()) * outwards
    ray = mi.Ray3f(mi.Point3f(*starts.T), mi.Vector3f(*outwards.T))
    return bool(np.array(scene.ray_test(ray)).all())


def placed_box(bounds: Box, placement: Placement) -> Box:
    """Map a box from scene units to the display's frame, mm; an unbounded box becomes infinite."""
    low, high = bounds
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low <= high).all()):
        return np.full(3, -np.inf), np.full(3, np.inf)
    corners = np.array(list(itertools.product(*zip(low, high, strict=True), (1.0,))))
    placed = corners @ placement.display_from_scene[:3].T
    return placed.min(axis=0), placed.max(axis=0)
