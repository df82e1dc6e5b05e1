"""The elements of a Mitsuba scene, as XML."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
import numpy.typing as npt

from lippmann.optics.rays import Floats


def plugin(parent: Element, tag: str, kind: str, **attributes: str) -> Element:
    """Add a plugin, such as `shape` of the kind `ply`."""
    return SubElement(parent, tag, {"type": kind, **attributes})


def value(parent: Element, tag: str, name: str, content: npt.ArrayLike) -> None:
    """Add a parameter: a number, a truth value, a text, or the components of a colour or vector."""
    if isinstance(content, str):
        text = content
    elif isinstance(content, bool):
        text = str(content).lower()
    else:
        text = " ".join(f"{number:.9g}" for number in np.ravel(content).tolist())
    values = dict(zip("xyz", text.split(), strict=True)) if tag in ("vector", "point") else {"value": text}
    SubElement(parent, tag, {"name": name, **values})


#: Directions towards the lights, in the display's frame, and the share that each gives a surface that faces the viewer:
#: one beside the viewer's head, so that nothing that is seen is black; the key, above left; and a weak one below right.
LIGHTS = (((0.0, 0.0, 1.0), 0.35), ((-0.5, 0.7, 1.0), 0.5), ((0.8, -0.3, 0.5), 0.15))


def add_lights(scene: Element, scene_from_display: Floats) -> None:
    """Add `LIGHTS`, far away. A diffuse surface that faces the viewer, unshaded, has its albedo as radiance.

    `scene_from_display` is the rotation (3, 3): the lights stay with the display when the scene is turned.
    """
    for direction, share in LIGHTS:
        towards = np.array(direction) / np.linalg.norm(direction)
        light = plugin(scene, "emitter", "directional")
        value(light, "vector", "direction", -scene_from_display @ towards)
        # Lambert: radiance = albedo / pi * irradiance * cosine.
        value(light, "rgb", "irradiance", [np.pi * share / towards[2]] * 3)


def to_world(parent: Element, step: str, **numbers: float) -> None:
    """Add a transform of one step, such as `scale` with x and y."""
    placed = SubElement(parent, "transform", {"name": "to_world"})
    SubElement(placed, step, {name: repr(float(number)) for name, number in numbers.items()})


def write(scene: Element, path: Path) -> Path:
    """Write a scene; return its path."""
    indent(scene)
    ElementTree(scene).write(path, encoding="utf-8")
    return path


def new_scene() -> Element:
    """Return a scene without anything. No ray may slip through between two triangles: what it sees would be black."""
    scene = Element("scene", {"version": "3.0.0"})
    value(scene, "boolean", "embree_use_robust_intersections", True)
    return scene


def unique(names: Iterable[str]) -> list[str]:
    """Return names with plain characters that differ, also without case: of two `leaf` the second is `leaf-2`."""
    used: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"[^\w.-]", "_", name) or "shape"
        numbered = (f"{plain}-{number}" for number in itertools.count(2))
        free = next(one for one in itertools.chain([plain], numbered) if one.casefold() not in used)
        used[free.casefold()] = free
    return list(used.values())
