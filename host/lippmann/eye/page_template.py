"""Templates: text files of this package with `@@name@@` where a value goes, and `#include` in the viewer's shaders."""

from __future__ import annotations

import re
from importlib.resources import files

HOLE = re.compile(r"@@(\w+)@@")
INCLUDE = re.compile(r'^#include "([\w.]+)"\n', re.M)


def read(name: str) -> str:
    """Return the text of a file of this package."""
    return files("lippmann.eye").joinpath("page_files", name).read_text(encoding="utf-8")


def filled(name: str, **values: str) -> str:
    """Return a template with its holes filled; values are not looked into, and none may be missing or left over."""
    text = read(name)
    holes = set(HOLE.findall(text))
    if holes != set(values):
        raise ValueError(f"{name} has the holes {sorted(holes)}, not {sorted(values)}")
    return HOLE.sub(lambda hole: values[hole[1]], text)


def shader(name: str, defines: dict[str, str]) -> str:
    """Return a shader's source (GLSL ES 3.00) with its includes and definitions."""
    head = "".join(f"#define {key} {value}\n" for key, value in defines.items())
    return f"#version 300 es\n{head}{_included(name)}"


def _included(name: str) -> str:
    return INCLUDE.sub(lambda line: _included(line[1]), read(f"shaders/{name}"))
