"""Writes tables from the code into the documentation: keys of TOML files, JSON Schemas, coverage points, promises.

`make docs-tables` writes tables of keys between `<!-- keys: FILE TABLE -->` and `<!-- end of keys -->` in pages, and
coverage points between `<!-- points -->` and `<!-- end of points -->`. Hard cases and promises have such marks too.
"""

from __future__ import annotations

import inspect
import json
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import click
from lippmann.base import toml
from lippmann.base.toml import Schema, bounds_text, documented, key, rivals, tables
from lippmann.cli import COMMANDS, cli
from lippmann.cli.inspect import FILES, schema_of
from lippmann.conformance.coverage_points import BEYOND_WORDS, POINTS
from lippmann.conformance.hard_cases import CASES
from lippmann.errors import did_you_mean, input_error
from lippmann.simulation.toolchain import repository

from tools.program import program

SCHEMAS = Path("docs/generated/schemas")
COMMAND_PAGES = Path("docs/generated/commands")
LISTED = re.compile(r"(<!-- (cases|points|promises) -->\n).*?(<!-- end of \2 -->)", re.S)
MARKED = re.compile(r"(<!-- keys: (\w+) ?([\w.]*) -->\n).*?(<!-- end of keys -->)", re.S)
FILE = Path("docs/promises.toml")


def generate(top: Path) -> dict[Path, str]:
    """Return the texts of all schemas, and of all pages that have tables, keyed by the path in the checkout."""
    texts = {SCHEMAS / f"{kind}.json": json.dumps(schema_of(kind), indent=2) + "\n" for kind in FILES}
    texts |= {COMMAND_PAGES / f"{name}.md": command_page(name) for name in COMMANDS}
    lists: dict[str, Callable[[], str]] = {"cases": _cases, "points": _points, "promises": partial(promises_table, top)}
    for page in sorted(top.glob("docs/**/*.md")):
        text, tables_filled = MARKED.subn(_filled, page.read_text())
        text, lists_filled = LISTED.subn(lambda place: place[1] + lists[place[2]]() + place[3], text)
        if tables_filled or lists_filled:
            texts[page.relative_to(top)] = text
    return texts


def command_page(name: str) -> str:
    """Return a command's page: help and options of the command and of its sub-commands."""
    top = click.Context(cli, info_name="lippmann", **cli.context_settings)
    command = cli.get_command(top, name)
    assert command is not None
    context = click.Context(command, info_name=name, parent=top)
    banner = "<!-- Generated from the command's help by `make docs-tables`; do not edit. -->"
    more = f"[Results, JSON and file formats](../../reference/command-line.md#{name})"
    parts = [f"# {context.command_path}", banner, *_help(command, context), more]
    for below in command.commands.values() if isinstance(command, click.Group) else ():
        inner = click.Context(below, info_name=below.name, parent=context)
        parts += [f"## {inner.command_path}", *_help(below, inner)]
    return "\n\n".join(parts) + "\n"


def _help(command: click.Command, context: click.Context) -> Iterator[str]:
    """Yield the paragraphs of a command's help, the example as code, and the table of the options."""
    for paragraph in inspect.cleandoc(command.help or "").split("\n\n"):
        text = " ".join(paragraph.split())
        example = text.removeprefix("Example: ")
        yield text if example == text else f"```sh\n{example}\n```"
    records = [record for option in command.params if (record := option.get_help_record(context)) and record[1]]
    rows = [[cell.replace("|", "\\|") for cell in record] for record in records]
    if rows:
        yield "\n".join(["| option | meaning |", "|---|---|", *(f"| `{words}` | {text} |" for words, text in rows)])


def _cases() -> str:
    rows = (f"| `{name}` | {(inspect.getdoc(case) or '').splitlines()[0]} |\n" for name, case in CASES.items())
    return f"| case | rays or displays |\n|---|---|\n{''.join(rows)}"


def _points() -> str:
    beyond = {name: f"no: {why}" for name, why in BEYOND_WORDS.items()}
    rows = (f"| `{name}` | {meaning} | {beyond.get(name, '')} |\n" for name, meaning in POINTS.items())
    return f"| point | met by | in words |\n|---|---|---|\n{''.join(rows)}"


def _filled(place: re.Match[str]) -> str:
    """Return a marked part of a page with its table of keys; alternative keys are in adjacent rows."""
    kind, name = place[2], place[3]
    schemas = dict(tables(schema_of(kind))) if kind in FILES else {}
    if name not in schemas:
        raise input_error(place[1].strip(), "there is no such table", f"choose from {', '.join(filter(None, schemas))}")
    properties, required = schemas[name]["properties"], schemas[name].get("required", ())
    groups = {group[0]: group for group, _ in rivals(schemas[name])}
    replaced = {key for group in groups.values() for key in group[1:]}
    lines = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for word in (word for first in properties if first not in replaced for word in groups.get(first, [first])):
        node = properties[word]
        if not name and ("properties" in node or "properties" in (node.get("items") or {})):
            continue  # this key has a separate table
        default = node.get("x-default", _toml(node.get("default", "")))
        if word in required:
            default = "*required*"
        elif word in groups and not default:
            default = "*one of these*"
        cells = (f"`{word}`", _value(node), default, node.get("description", ""))
        lines.append(f"| {' | '.join(cells)} |")
    return place[1] + "\n".join(lines) + "\n" + place[4]


def _value(node: Schema) -> str:
    """Return words for a key's allowed values; bounds that only prevent overflow are left out."""
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
    node = {**node, **{bound: None for bound in ("minimum", "maximum") if abs(node.get(bound) or 0.0) >= 1e9}}
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


@documented
@dataclass(frozen=True, kw_only=True)
class Promise:
    """A promise that a page makes to users, and the tests that check it."""

    page: Annotated[str, key("the page's path in the checkout")]
    words: Annotated[str, key("words of the page, with spaces for line ends")]
    kept_by: Annotated[tuple[str, ...], key("files that fulfil the promise: modules, RTL")]
    tests: Annotated[tuple[str, ...], key("tests that check the promise, `FILE::NAME`")]
    points: Annotated[tuple[str, ...], key("coverage points that rays of these tests meet")] = ()


@documented
@dataclass(frozen=True, kw_only=True)
class Promises:
    """The content of promises.toml."""

    promise: Annotated[tuple[Promise, ...], key("")]


def promises_table(top: Path) -> str:
    """Return the table of promises; raise InputError if a page, its words, a file, a test or a point is missing."""
    path = top / FILE
    promises = toml.read(Promises, toml.load(path, "promises"), str(path)).promise
    rows = ["| promise | kept by | held by |\n|---|---|---|\n"]
    for number, promise in enumerate(promises):
        _check(top, promise, f"{FILE}: promise[{number}]")
        tests = [f"[{name}]({_from_page(file)})" for file, _, name in (test.partition("::") for test in promise.tests)]
        tests += [f"[{point}](../reference/coverage.md)" for point in promise.points]
        words = f"{promise.words} ([{Path(promise.page).stem}]({_from_page(promise.page)}))"
        files = [f"[{Path(file).name}]({_from_page(file)})" for file in promise.kept_by]
        rows.append(f"| {words} | {', '.join(files)} | {', '.join(tests)} |\n")
    return "".join(rows)


def _check(top: Path, promise: Promise, where: str) -> None:
    for file in (promise.page, *promise.kept_by, *(test.partition("::")[0] for test in promise.tests)):
        if not (top / file).is_file():
            raise input_error(where, f"there is no file {file}", "give its current path")
    if promise.words not in " ".join((top / promise.page).read_text().split()):
        raise input_error(f"{where}.words", f"{promise.page} does not say '{promise.words}'", "quote its current words")
    for test in promise.tests:
        file, _, name = test.partition("::")
        names = re.findall(r"^(?:async )?def (\w+)\(", (top / file).read_text(), re.M)
        if name not in names:
            remedy = did_you_mean(name, names) or "name a test of this file, FILE::NAME"
            raise input_error(f"{where}.tests", f"{file} has no test '{name}'", remedy)
    for point in promise.points:
        if point not in POINTS:
            remedy = did_you_mean(point, POINTS) or f"choose from {', '.join(POINTS)}"
            raise input_error(f"{where}.points", f"there is no coverage point '{point}'", remedy)


def _from_page(file: str) -> str:
    return os.path.relpath(file, "docs/generated")


@program
def main() -> None:
    """Write the documentation's tables and JSON Schemas into the checkout.

    Example: python -m tools.generate_documentation
    """
    top = repository()
    for path, text in generate(top).items():
        (top / path).parent.mkdir(parents=True, exist_ok=True)
        (top / path).write_text(text)
        click.echo(path)
