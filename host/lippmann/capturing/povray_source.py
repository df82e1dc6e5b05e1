"""Reads objects and properties of a Mitsuba scene file, with Mitsuba's own parser.

A caller reads the properties that it supports; `refuse_leftovers` raises an error for
any other property, with file and line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lippmann.base.variant import mi
from lippmann.errors import InputError, input_error
from lippmann.scenes.placement import Matrix, Triple
from lippmann.scenes.scene import parsed

Value = TypeVar("Value", float, str, bool)


class Item:
    """An object of a scene file, such as a shape; it records which properties were read."""

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
        """Return a path property, relative to the scene file if it exists there, else to the object's file."""
        text = self.value(name, "")
        including_file = Path(str(self.tree.state.files[self._node.file_index]))
        beside_scene = self.tree.path.parent / text
        return beside_scene if beside_scene.exists() else including_file.parent / text

    def refusal(self, what: str, remedy: str) -> InputError:
        """Return an InputError that names this object and its position in the scene file."""
        name = f"{self.kind.lower()} '{self.plugin}'" + (f" ({self.id})" if self.id else "")
        where = str(mi.parser.file_location(self.tree.state, self._node))
        return input_error(where, f"{name} {what}", remedy)

    def _take(self, name: str) -> Any:
        self._read.add(name)
        return self._properties.get(name)

    def values(self, *names: str) -> dict[str, Any]:
        """Return Mitsuba's values of those properties `names` that the object has."""
        return {name: self._take(name) for name in names if name in self._properties}

    def value(self, name: str, default: Value) -> Value:
        """Return a number, text or Boolean property, in the default's type."""
        value = self._take(name)
        return default if value is None else type(default)(value)

    def triple(self, name: str, default: Triple) -> Triple:
        """Return a point or colour property as three numbers."""
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
            raise self.refusal(f"has a {name} that is not an RGB colour", f"write {name} as rgb") from None
        return x, y, z

    def matrix(self) -> Matrix:
        """Return the property `to_world` as a matrix (4, 4)."""
        value = self._take("to_world")
        return np.eye(4) if value is None else np.array(value.matrix, np.float64).reshape(4, 4)

    def child(self, name: str) -> Item | None:
        """Return the object to which a property refers, or None if the property is a value."""
        value = self._properties.get(name)
        if not isinstance(value, self.tree.reference):
            return None
        self._read.add(name)
        return Item(self.tree, value.index())

    def children(self) -> list[Item]:
        """Return the nested and referenced objects that have not been read, in file order."""
        objects = [self.child(name) for name in self._properties if name not in self._read]
        return [one for one in objects if one is not None]

    def refuse_leftovers(self) -> None:
        """Raise InputError for the first property that no caller has read."""
        for name in self._properties:
            if name not in self._read:
                raise self.refusal(f"has a {name}, which cannot be exported to POV-Ray", f"remove {name}")


class Tree:
    """A parsed scene file; object 0 is the scene itself."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.reference = mi.Properties.ResolvedReference
        with parsed(path) as (configuration, self.state):
            mi.parser.transform_upgrade(configuration, self.state)
            mi.parser.transform_resolve(configuration, self.state)
