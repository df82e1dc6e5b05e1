"""Loads a Mitsuba scene and places it before the display."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lippmann.errors import InputError, input_error
from lippmann.rendering.moved import Move, load_moved, scene_digest
from lippmann.rendering.placement import Placement, load_placement
from lippmann.variant import mitsuba


@dataclass(frozen=True)
class Scene:
    """A loaded scene.

    Attributes
    ----------
    path
        Its XML file.
    mitsuba
        The `mitsuba.Scene`.
    placement
        With both depths filled in.
    """

    path: Path
    mitsuba: Any
    placement: Placement

    @property
    def width_mm(self) -> float:
        """Largest side of the placed scene's bounding box, mm; 0 without any surface."""
        box = self.mitsuba.bbox()
        size = np.array(box.max).ravel() - np.array(box.min).ravel()
        return float(self.placement.scale * size.max()) if np.isfinite(size).all() else 0.0

    @property
    def depth_range_mm(self) -> tuple[float, float]:
        """(far, near) z, mm."""
        near, far = self.placement.near_mm, self.placement.far_mm
        assert near is not None
        assert far is not None
        return far, near

    def placed(self, placement: Placement) -> Scene:
        """Return the scene with another placement."""
        return replace(self, placement=_with_depths(self.mitsuba, placement, self.path))


def placement_beside(path: Path) -> Placement:
    """Return the placement in NAME.toml beside NAME.xml; without that file, scene units are millimetres."""
    beside = path.with_suffix(".toml")
    return load_placement(beside) if beside.exists() else Placement()


def check_scene_file(path: str | Path) -> Path:
    """Check that a path names a scene file.

    Raises
    ------
    InputError
        When the file is missing or not .xml.
    """
    path = Path(path)
    if not path.is_file():
        raise input_error(str(path), "no such scene", "give a Mitsuba scene (.xml)")
    if path.suffix.lower() != ".xml":
        raise input_error(str(path), "is not a Mitsuba scene", "give an .xml file")
    return path


def load_scene(path: str | Path, placement: Placement | None = None, moves: Sequence[Move] = ()) -> Scene:
    """Load a scene file.

    Parameters
    ----------
    path
        Mitsuba XML.
    placement
        None: `placement_beside`.
    moves
        Motions of its shapes.

    Raises
    ------
    InputError
        When the file is missing or Mitsuba refuses it (unknown plugin, missing texture or mesh, bad XML), or when a
        move matches no shape.
    """
    mi = mitsuba()
    path = check_scene_file(path)
    if placement is None:
        placement = placement_beside(path)
    try:
        scene = load_moved(path, moves) if moves else mi.load_file(str(path))
    except InputError:
        raise
    except Exception as error:  # Mitsuba's errors have no common base
        raise input_error(str(path), _first_reason(error), "mend the scene file") from None
    if not isinstance(scene, mi.Scene):
        raise input_error(str(path), "contains no scene", "make <scene> its outermost element")
    return Scene(path, scene, _with_depths(scene, placement, path))


def _first_reason(error: Exception) -> str:
    """Return Mitsuba's error message in one line, without source positions."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    text = re.sub(r"\[\w+\.cpp:\d+\] *", "", " ".join(lines)) if lines else type(error).__name__
    return text[:400]


def digest_of(path: str | Path) -> str:
    """Return a hash of a scene file and all files that it names (see `moved.scene_digest`).

    Raises
    ------
    InputError
        As `load_scene`.
    """
    path = check_scene_file(path)
    try:
        return scene_digest(path)
    except OSError as error:
        what = f"names {error.filename}, which cannot be read ({error.strerror})"
        raise input_error(str(path), what, "mend the scene file") from None
    except RuntimeError as error:
        raise input_error(str(path), _first_reason(error), "mend the scene file") from None


def depths_of(scene: Any, placement: Placement) -> tuple[float, float]:
    """Return (lowest, highest) z, mm, of a Mitsuba scene's placed bounding box; infinite if unbounded or empty."""
    box = scene.bbox()
    low, high = np.array(box.min).ravel(), np.array(box.max).ravel()
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low <= high).all()):
        return -np.inf, np.inf
    corners = np.array(list(itertools.product(*zip(low, high, strict=True), (1.0,))))[:, :4]
    z = corners @ placement.display_from_scene[2]
    return float(z.min()), float(z.max())


def in_front_of(depths: tuple[float, float]) -> float:
    """Return a depth just in front of (lowest, highest) z, so that rays do not start on a surface."""
    return depths[1] + 1e-3 * max(1.0, depths[1] - depths[0])


def _with_depths(scene: Any, placement: Placement, path: Path) -> Placement:
    if placement.near_mm is not None and placement.far_mm is not None:
        return placement
    depths = depths_of(scene, placement)
    if not np.isfinite(depths).all():
        raise InputError(f"{path}: the scene has no bounded extent; give near_mm and far_mm in its placement")
    return replace(
        placement,
        near_mm=placement.near_mm if placement.near_mm is not None else in_front_of(depths),
        far_mm=placement.far_mm if placement.far_mm is not None else depths[0],
    )
