"""The table from each promise of the documentation to what keeps it and what holds it.

`docs/promises.toml` lists them. `make docs-tables` writes the table into docs/reference/promises.md; a promise whose
page no longer has its words, or that names a file, a test or a coverage point that is gone, is an error.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from lippmann.base import toml
from lippmann.base.toml import documented, key
from lippmann.conformance.coverage_points import POINTS
from lippmann.errors import did_you_mean, input_error

FILE = Path("docs/promises.toml")
PAGE = Path("docs/reference/promises.md")


@documented
@dataclass(frozen=True, kw_only=True)
class Promise:
    """A promise, as a page says it."""

    page: Annotated[str, key("the page, from the top of the checkout")]
    words: Annotated[str, key("words that the page has; line ends are spaces")]
    kept_by: Annotated[tuple[str, ...], key("files that keep it: modules, RTL")]
    tests: Annotated[tuple[str, ...], key("tests that hold it, `FILE::NAME`")]
    points: Annotated[tuple[str, ...], key("coverage points that judged rays meet for it")] = ()


@documented
@dataclass(frozen=True, kw_only=True)
class Promises:
    """The file of promises."""

    promise: Annotated[tuple[Promise, ...], key("")]


def table(top: Path) -> str:
    """Return the table of all promises, in the order of the file.

    Raises InputError for a promise with a page, words, a file, a test or a point that is not there.
    """
    path = top / FILE
    promises = toml.read(Promises, toml.load(path, "promises"), str(path)).promise
    rows = ["| promise | kept by | held by |\n|---|---|---|\n"]
    for number, promise in enumerate(promises):
        _check(top, promise, f"{FILE}: promise[{number}]")
        held = [*map(_test_link, promise.tests), *(f"[{point}](coverage.md)" for point in promise.points)]
        said = f"{promise.words} ([{Path(promise.page).stem}]({_from_page(promise.page)}))"
        rows.append(f"| {said} | {', '.join(map(_link, promise.kept_by))} | {', '.join(held)} |\n")
    return "".join(rows)


def _check(top: Path, promise: Promise, where: str) -> None:
    for file in (promise.page, *promise.kept_by, *(test.partition("::")[0] for test in promise.tests)):
        if not (top / file).is_file():
            raise input_error(where, f"there is no file {file}", "name the file as it is called now")
    if promise.words not in " ".join((top / promise.page).read_text().split()):
        raise input_error(f"{where}.words", f"{promise.page} does not say '{promise.words}'", "quote what it says now")
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
    return str(Path(file).relative_to("docs/reference")) if file.startswith("docs/reference/") else f"../../{file}"


def _link(file: str) -> str:
    return f"[{Path(file).name}]({_from_page(file)})"


def _test_link(test: str) -> str:
    file, _, name = test.partition("::")
    return f"[{name}]({_from_page(file)})"
