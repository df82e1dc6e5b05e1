"""Reads the objects and properties of a scene file as Mitsuba parses them.

The caller reads the properties that it supports. Each remaining property is an error
that names property, file and line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lippmann.base.variant import mitsuba
from lippmann.errors import InputError, input_error
from lippmann.scenes.placement import Matrix, Triple
from lippmann.scenes.scene import parsed

Value = TypeVar("Value", float, str, bool)


class Item:
    """An object of a scene file, such as a shape; methods mark the properties that they read."""

    def __init__(self, tree: Tree, index: int) -> None:
        self.index = index
        self.tree = tree
        self._node = tree.state.nodes[index]
        self.plugin: str = self._node.props.plugin_name()
        self.kind: str = self._node.type.name
        self.id: str = self._node.props.id()
        self._properties: dict[str, Any] = dict(self._node.props.items())
        self._read: set[str] = set()

    def path(self, name: str) -> Path:
        """Return the path in a property, relative to the scene file or to the included file."""
        text = self.value(name, "")
        including_file = Path(str(self.tree.state.files[self._node.file_index]))
        beside_scene = self.tree.path.parent / text
        return beside_scene if beside_scene.exists() else including_file.parent / text

    def refusal(self, what: str, remedy: str) -> InputError:
        """Return an error that names this object and its position in the file."""
        name = f"{self.kind.lower()} '{self.plugin}'" + (f" ({self.id})" if self.id else "")
        where = str(self.tree.mi.parser.file_location(self.tree.state, self._node))
        return input_error(where, f"{name} {what}", remedy)

    def _take(self, name: str) -> Any:
        self._read.add(name)
        return self._properties.get(name)

    def values(self, *names: str) -> dict[str, Any]:
        """Return the properties among `names` that the file gives, as Mitsuba's values."""
        return {name: self._take(name) for name in names if name in self._properties}

    def value(self, name: str, default: Value) -> Value:
        """Return a number, a text or a Boolean, of the default's type."""
        value = self._take(name)
        return default if value is None else type(default)(value)

    def triple(self, name: str, default: Triple) -> Triple:
        """Return a point or a colour."""
        value = self._take(name)
        if value is None:
            return default
        if isinstance(value, int | float):
            return (float(value),) * 3
        uniform = getattr(value, "is_uniform", None)
        if uniform is not None and uniform():
            return (float(value.values[0]),) * 3
        try:
            x, y, z = (float(component) for component in value)
        except (TypeError, ValueError):
            raise self.refusal(f"has a {name} that is not an RGB colour", f"give {name} as rgb") from None
        return x, y, z

    def matrix(self) -> Matrix:
        """Return the transform `to_world`, (4, 4)."""
        value = self._take("to_world")
        return np.eye(4) if value is None else np.array(value.matrix, np.float64).reshape(4, 4)

    def child(self, name: str) -> Item | None:
        """Return the object that a property refers to; None if the property is a value."""
        value = self._properties.get(name)
        if not isinstance(value, self.tree.reference):
            return None
        self._read.add(name)
        return Item(self.tree, value.index())

    def children(self) -> list[Item]:
        """Return the nested and referenced objects that are not yet read, in order."""
        objects = [self.child(name) for name in self._properties if name not in self._read]
        return [one for one in objects if one is not None]

    def refuse_leftovers(self) -> None:
        """Raise InputError for the first property that has not been read."""
        for name in self._properties:
            if name not in self._read:
                raise self.refusal(f"has a {name}, which has no counterpart in POV-Ray", f"leave {name} out")


class Tree:
    """A parsed scene file; its object 0 is the scene."""

    def __init__(self, path: Path) -> None:
        self.mi = mi = mitsuba()
        self.path = path
        self.reference = mi.Properties.ResolvedReference
        with parsed(path) as (configuration, self.state):
            mi.parser.transform_upgrade(configuration, self.state)
            mi.parser.transform_resolve(configuration, self.state)
