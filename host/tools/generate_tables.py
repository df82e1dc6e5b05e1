"""Writes what the code declares into the documentation: key tables and JSON Schemas of TOML files, points, promises.

`python -m tools.generate_tables` (`make docs-tables`) writes them. A page holds a table between
`<!-- keys: FILE TABLE -->` and `<!-- end of keys -->`; that of the coverage points between `<!-- points -->` and
`<!-- end of points -->`, that of the promises between `<!-- promises -->` and `<!-- end of promises -->`.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import click
from lippmann.base.toml import Schema, bounds_text, rivals, tables
from lippmann.cli import run
from lippmann.cli.inspect import FILES, schema_of
from lippmann.conformance.coverage_points import BEYOND_WORDS, POINTS
from lippmann.errors import input_error
from lippmann.simulation.toolchain import repository

from tools import promises

SCHEMAS = Path("docs/reference/schemas")
POINTS_MARKED = re.compile(r"(<!-- points -->\n).*?(<!-- end of points -->)", re.S)
PROMISES_MARKED = re.compile(r"(<!-- promises -->\n).*?(<!-- end of promises -->)", re.S)
MARKED = re.compile(r"(<!-- keys: (\w+) ?([\w.]*) -->\n).*?(<!-- end of keys -->)", re.S)


def generate(top: Path) -> dict[Path, str]:
    """Return the text of every schema, and of every page with its tables filled in, by path in the checkout."""
    made = {SCHEMAS / f"{kind}.json": json.dumps(schema_of(kind), indent=2) + "\n" for kind in FILES}
    for page in sorted(top.glob("docs/**/*.md")):
        text = page.read_text()
        filled = POINTS_MARKED.sub(lambda place: place[1] + _points() + place[2], MARKED.sub(_filled, text))
        if PROMISES_MARKED.search(filled):
            filled = PROMISES_MARKED.sub(lambda place: place[1] + promises.table(top) + place[2], filled)
        if MARKED.search(text) or POINTS_MARKED.search(text) or PROMISES_MARKED.search(text):
            made[page.relative_to(top)] = filled
    return made


def _points() -> str:
    """Return the table of the coverage points of `lippmann regress`."""
    beyond = {name: f"no: {why}" for name, why in BEYOND_WORDS.items()}
    rows = (f"| `{name}` | {point.meaning} | {beyond.get(name, '')} |\n" for name, point in POINTS.items())
    return f"| point | met by | in words |\n|---|---|---|\n{''.join(rows)}"


def _filled(place: re.Match[str]) -> str:
    """Return a marked place with its table; keys that replace each other stand together."""
    kind, name = place[2], place[3]
    known = dict(tables(schema_of(kind))) if kind in FILES else {}
    if name not in known:
        raise input_error(place[1].strip(), "no such table", f"choose from {', '.join(filter(None, known))}")
    properties, required = known[name]["properties"], known[name].get("required", ())
    groups = {group[0]: group for group, _ in rivals(known[name])}
    replaced = {key for group in groups.values() for key in group[1:]}
    lines = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key in (key for first in properties if first not in replaced for key in groups.get(first, [first])):
        node = properties[key]
        if not name and ("properties" in node or "properties" in (node.get("items") or {})):
            continue  # it has a table of its own
        default = node.get("x-default", _toml(node.get("default", "")))
        if key in required:
            default = "*required*"
        elif key in groups and not default:
            default = "*one of these*"
        cells = (f"`{key}`", _value(node), default, node.get("description", ""))
        lines.append(f"| {' | '.join(cells)} |")
    return place[1] + "\n".join(lines) + "\n" + place[4]


def _value(node: Schema) -> str:
    """Return what a key takes. Bounds that only keep numbers from overflowing are left to the page's text."""
    if "anyOf" in node:
        return " or ".join(_value(option) for option in node["anyOf"])
    if "enum" in node:
        return ", ".join(_toml(option) for option in node["enum"])
    if "x-shape" in node:
        return str(node["x-shape"])
    if "prefixItems" in node:
        return f"[{', '.join('xyz'[: len(node['prefixItems'])])}]"
    if node.get("minimum") == 1e-9:
        node = {**node, "minimum": None, "exclusiveMinimum": 0.0}
    if (node.get("maximum") or 0.0) >= 1e9:
        node = {**node, "maximum": None}
    if (node.get("minimum") or 0.0) <= -1e9:
        node = {**node, "minimum": None}
    words = {"string": "text", "integer": "whole number", "array": "list of tables", "object": "table",
             "boolean": "true or false"}  # fmt: skip
    return f"{words.get(node['type'], node['type'])} {bounds_text(node)}".strip()


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return f"{value:g}"
    return f'`"{value}"`' if isinstance(value, str) and value else str(value)


@click.command()
def main() -> None:
    """Write key tables and JSON Schemas into the checkout.

    Example: python -m tools.generate_tables
    """
    top = repository()
    for path, text in generate(top).items():
        (top / path).parent.mkdir(parents=True, exist_ok=True)
        (top / path).write_text(text)
        click.echo(path)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))
