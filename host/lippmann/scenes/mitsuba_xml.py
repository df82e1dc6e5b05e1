"""Builds the XML elements of a Mitsuba scene."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
import numpy.typing as npt


def plugin(parent: Element, tag: str, kind: str, **attributes: str) -> Element:
    """Add the element of a plugin, such as a `shape` of type `ply`, and return it."""
    return SubElement(parent, tag, {"type": kind, **attributes})


def value(parent: Element, tag: str, name: str, content: npt.ArrayLike) -> None:
    """Add the element of a parameter: number, boolean, text, colour or vector."""
    if isinstance(content, str):
        text = content
    elif isinstance(content, bool):
        text = str(content).lower()
    else:
        text = " ".join(f"{number:.9g}" for number in np.ravel(content).tolist())
    values = dict(zip("xyz", text.split(), strict=True)) if tag in ("vector", "point") else {"value": text}
    SubElement(parent, tag, {"name": name, **values})


def to_world(parent: Element, step: str, **numbers: float) -> None:
    """Add a `to_world` transform of one step, such as `scale` with x and y."""
    transform = SubElement(parent, "transform", {"name": "to_world"})
    SubElement(transform, step, {name: repr(float(number)) for name, number in numbers.items()})


def write(scene: Element, path: Path) -> Path:
    """Write a scene to a file; return its path."""
    indent(scene)
    ElementTree(scene).write(path, encoding="utf-8")
    return path


def new_scene() -> Element:
    """Return an empty scene in which no ray passes between two adjacent triangles."""
    scene = Element("scene", {"version": "3.0.0"})
    value(scene, "boolean", "embree_use_robust_intersections", True)
    return scene


def unique(names: Iterable[str]) -> list[str]:
    """Return unique file names, ignoring case; a second `leaf` becomes `leaf-2`."""
    used: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"[^\w.-]", "_", name) or "shape"
        numbered = (f"{plain}-{number}" for number in itertools.count(2))
        free = next(one for one in itertools.chain([plain], numbered) if one.casefold() not in used)
        used[free.casefold()] = free
    return list(used.values())
