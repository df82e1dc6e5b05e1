"""Checks the code's structure: `python -m tools.house`, a part of `make lint`.

The program compares sizes, uses of `Any` and refused names with house.toml's bounds. It checks names, files and import
chain of the package's rooms (folders), and the RTL's lines and names. import-linter checks the import layers.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from lippmann.simulation.toolchain import repository

BOUNDS = Path(__file__).with_name("house.toml")
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Sizes:
    """The sizes of a folder's Python files."""

    counts: Counter[str] = field(default_factory=Counter)
    #: A text such as "file:line name" for each finding, keyed by `long_functions` or `refused_names`.
    places: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    @property
    def mean_line(self) -> float:
        """The mean number of characters per line."""
        return self.counts["characters"] / max(self.counts["lines"], 1)

    @property
    def comment_share(self) -> float:
        """The mean number of comments per line."""
        return self.counts["comments"] / max(self.counts["lines"], 1)


def measure_sizes(folder: Path, function_lines: int, refused: frozenset[str]) -> Sizes:
    """Count lines, files, comments, uses of `Any`, long functions and refused names in a folder."""
    sizes = Sizes()
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text()
        place = path.relative_to(folder.parent)
        sizes.counts["files"] += 1
        sizes.counts["lines"] += text.count("\n")
        sizes.counts["characters"] += len(text) - text.count("\n")
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        sizes.counts["comments"] += sum(token.type == tokenize.COMMENT for token in tokens)
        for node in ast.walk(ast.parse(text)):
            sizes.counts["any"] += isinstance(node, ast.Name) and node.id == "Any"
            if isinstance(node, FUNCTIONS):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > function_lines:
                    sizes.places["long_functions"].append(f"{place}:{node.lineno} {node.name}, {lines} lines")
            name = bound_name(node)
            if name is not None and name.lstrip("_") in refused:
                sizes.places["refused_names"].append(f"{place}:{getattr(node, 'lineno', 0)} {name}")
    return sizes


def bound_name(node: ast.AST) -> str | None:
    """Return the name of the function, class, parameter or variable that a node defines, else None."""
    if isinstance(node, FUNCTIONS | ast.ClassDef):
        return node.name
    if isinstance(node, ast.arg):
        return node.arg
    return node.id if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else None


def compare_sizes(name: str, sizes: Sizes, bounds: Mapping[str, int]) -> Iterator[str]:
    """Yield a message for each count of a folder that exceeds its bound."""
    for key, bound in bounds.items():
        places = sizes.places[key]
        count = sizes.counts[key] or len(places)
        if count > bound:
            what = key.replace("_", " ")
            yield f"{name}: {count} {what}, at most {bound}: remove code, or raise the bound in {BOUNDS.name}"
            yield from (f"  {place}" for place in places)


def check_style(sizes: Sizes, style: Mapping[str, float]) -> Iterator[str]:
    """Yield a message if the package's lines are too long, or its comments too few."""
    if sizes.mean_line > style["mean_line"]:
        yield f"package: {sizes.mean_line:.2f} characters a line, at most {style['mean_line']}"
    if sizes.comment_share < style["comment_share"]:
        yield f"package: {sizes.comment_share:.4f} comments a line, at least {style['comment_share']}"


def check_rooms(package: Path, rooms: Mapping[str, Any]) -> Iterator[str]:
    """Yield a message for each unlisted or missing room or loose file, and each file name used in two rooms."""
    loose = {path.stem for path in package.glob("*.py")}
    for name in sorted(loose ^ set(rooms["loose"])):
        yield f"{name}.py: the package's files outside rooms must be {', '.join(rooms['loose'])}"
    folders = {path.parent.relative_to(package).as_posix() for path in package.rglob("*.py")} - {"."}
    for folder in sorted(folders ^ set(rooms["names"])):
        yield f"{folder}: the rooms are {', '.join(rooms['names'])}, without Python folders inside"
    places = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        if path.stem != "__init__" and path.parent != package:
            places[path.stem].append(path.parent.name)
    for stem, folders_of in sorted(places.items()):
        # Files in cli have the names of their commands.
        if len(set(folders_of) - {"cli"}) > 1:
            yield f"{stem}.py is in the rooms {' and '.join(folders_of)}: rename one of these files"


def room_imports(package: Path) -> dict[str, set[str]]:
    """Return the rooms that each room imports; imports for annotations only do not count."""
    rooms: dict[str, set[str]] = defaultdict(set)
    for path in package.rglob("*.py"):
        room = path.relative_to(package).parts[0].removesuffix(".py")
        tree = ast.parse(path.read_text())
        blocks = (node for node in ast.walk(tree) if isinstance(node, ast.If))
        checks = [block for block in blocks if ast.unparse(block.test) == "TYPE_CHECKING"]
        for_types = {id(inner) for node in checks for inner in ast.walk(node)}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module and id(node) not in for_types:
                parts = node.module.split(".")
                if parts[0] == package.name:
                    rooms[room] |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
    return {room: (imports & rooms.keys()) - {room} for room, imports in rooms.items()}


def longest_chain(imports: Mapping[str, set[str]], names: frozenset[str]) -> list[str]:
    """Return the longest chain of rooms, each importing the next; files outside rooms do not count."""

    @cache
    def chain(room: str) -> list[str]:
        below: list[str] = max((chain(other) for other in sorted(imports.get(room, ()))), key=len, default=[])
        return [room, *below] if room in names else below

    return max((chain(room) for room in sorted(imports)), key=len, default=[])


def check_rtl(top: Path, columns: int, refused: frozenset[str]) -> Iterator[str]:
    """Yield a message for each line of hand-written RTL that is too long or that has a refused name."""
    for path in sorted(path for folder in ("rtl", "sim") for path in (top / folder).rglob("*.sv")):
        # Skip generated RTL.
        if path.parent.name == "registers":
            continue
        for number, line in enumerate(path.read_text().splitlines(), 1):
            place = f"{path.relative_to(top)}:{number}"
            if len(line) > columns:
                yield f"{place}: {len(line)} columns, at most {columns}"
            names = re.findall(r"\b([a-z]+)(?:_[qdio]\d?)?\b", re.sub(r'//.*|"[^"]*"|\w+:', "", line))
            yield from (f"{place}: rename {name} to what it holds" for name in sorted(refused.intersection(names)))


def check_house(top: Path, bounds: Mapping[str, Any]) -> list[str]:
    """Return the violations in a checkout, one message each."""
    style, refused = bounds["style"], frozenset(bounds["names"]["refused"])
    folders = {"package": top / "host/lippmann", "tools": top / "host/tools", "tests": top / "tests"}
    sizes = {name: measure_sizes(folder, style["function_lines"], refused) for name, folder in folders.items()}
    faults = [line for name in sizes for line in compare_sizes(name, sizes[name], bounds[name])]
    faults += check_style(sizes["package"], style)
    rooms, rtl = bounds["rooms"], bounds["rtl"]
    faults += check_rooms(folders["package"], rooms)
    faults += check_rtl(top, rtl["columns"], frozenset(rtl["refused"]))
    chain = longest_chain(room_imports(folders["package"]), frozenset(rooms["names"]))
    if len(chain) > rooms["chain"]:
        faults.append(f"{len(chain)} rooms in a chain of imports, at most {rooms['chain']}: {' > '.join(chain)}")
    package, counts = sizes["package"], sizes["package"].counts
    print(
        f"house: {counts['lines']} lines in {counts['files']} files, {package.mean_line:.2f} characters and "
        f"{package.comment_share:.4f} comments a line, {counts['any']} Any, "
        f"{len(package.places['refused_names'])} refused names; tools {sizes['tools'].counts['lines']} lines, "
        f"tests {sizes['tests'].counts['lines']} lines; longest chain {len(chain)} rooms"
    )
    return faults


def main() -> int:
    """Print all violations; return 1 if there are any."""
    faults = check_house(repository(), tomllib.loads(BOUNDS.read_text()))
    for line in faults:
        print(line, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
