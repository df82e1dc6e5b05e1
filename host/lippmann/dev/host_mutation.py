"""`make mutation-host`: puts faults into the host's Python one at a time and counts how many the quick tests catch.

A fault swaps an operator, changes a number, a sign or a comparison, negates a condition, swaps two arguments or drops
a statement. It is made in a copy of the checkout. The tests nearest to the faulty file, by name and by imports, run
first and stop at the first failure; then the other tests of tests/host run, and last the tests of `LAST`, which
simulate the RTL. A fault is caught when a test fails that passes without the fault.

Docstrings, annotations, decorators and the texts of errors stay as they are.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import numpy as np
from asttokens import ASTText
from scipy.sparse.csgraph import shortest_path

from lippmann.cli import run
from lippmann.dev.faults import Fault, Scratch, options, report_faults
from lippmann.sim.tools import repository

PACKAGE = Path("host/lippmann")
#: Parts of the package that get as many faults as each other.
AREAS = (("display.py",), ("optics",), ("fixed",), ("link", "board"), ("rendering",))
#: Tests that run last, by the part of the package: they simulate the RTL.
LAST = {
    "fixed": ("tests/rtl/test_batch.py", "tests/rtl/raster"),
    "link": ("tests/system",),
    "board": ("tests/system",),
}
#: Test files of a fault's first stage, and those that never run: this program's own.
FIRST, OWN = 8, ("test_host_mutation",)

#: Changes that no test can detect, because the program does the same: file, part of the changed line, and the reason.
SAME: dict[tuple[str, str], str] = {}

#: Operators, and the wrong one in place of each.
SWAPS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"), ast.Pow: ("**", "*"), ast.LShift: ("<<", ">>"), ast.RShift: (">>", "<<"),
    ast.BitAnd: ("&", "|"), ast.BitOr: ("|", "&"), ast.BitXor: ("^", "|"), ast.And: ("and", "or"),
    ast.Or: ("or", "and"), ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"),
}  # fmt: skip

#: Begin and end in a file, and the text that comes there.
Edit = tuple[int, int, str]


def faults_of(path: Path, file: str) -> list[Fault]:
    """Return every fault of a Python file, `file` in the report; a few do not differ, or are not Python."""
    source, found = path.read_text(), []
    tree = ast.parse(source)
    for begin, end, new in sorted(set(_edits(source, ASTText(source, tree).get_text_range, tree))):
        first, last = source.rfind("\n", 0, begin) + 1, source.find("\n", end)
        now = source[first:begin] + new + source[end:last]
        found.append(Fault(file, source.count("\n", 0, first) + 1, source[first:last], now))
    return found


def differs(fault: Fault, text: str) -> bool:
    """Tell whether a fault makes another program of a file's text, and one that is Python."""
    try:
        return ast.dump(ast.parse(fault.changed(text))) != ast.dump(ast.parse(text))
    except SyntaxError:
        return False


def _edits(source: str, span: Callable[[ast.AST], tuple[int, int]], node: ast.AST) -> Iterator[Edit]:
    """Yield the edits of a node and of the nodes below it; `span` tells where a node begins and ends in the source."""

    def text(part: ast.AST) -> str:
        return source[slice(*span(part))]

    for left, operator, right in _operators(node):
        was, now = SWAPS.get(type(operator), ("", ""))
        begin = span(left)[1]
        found = re.search(re.escape(was).replace(r"\ ", r"\s+"), source[begin : span(right)[0]])
        if was and found:
            yield begin + found.start(), begin + found.end(), now
    match node:
        case ast.AugAssign() | ast.Raise() | ast.Expr(value=ast.Call()):
            yield *span(node), "pass"
        case ast.UnaryOp(operand=operand):
            yield *span(node), text(operand)
        case ast.Constant(value=bool(value)):
            yield *span(node), str(not value)
        case ast.Constant(value=int(value)):
            yield *span(node), str(value + 1)
        case ast.Constant(value=float(value)):
            yield *span(node), repr(1.1 * value or 1.0)
        case ast.Call(args=arguments) if not _is_cast(node):
            for one, two in pairwise(arguments):
                if not isinstance(one, ast.Starred) and not isinstance(two, ast.Starred):
                    (begin, end), (start, stop) = span(one), span(two)
                    yield begin, stop, f"{text(two)}{source[end:start]}{text(one)}"
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test) if text(test) != "TYPE_CHECKING":
            yield *span(test), f"not ({text(test)})"
    for child in _below(node):
        yield from _edits(source, span, child)


def _operators(node: ast.AST) -> Iterable[tuple[ast.AST, ast.AST, ast.AST]]:
    """Return a node's own operators, each between its operands."""
    match node:
        case ast.BinOp(left=left, op=op, right=right) | ast.AugAssign(target=left, op=op, value=right):
            return [(left, op, right)]
        case ast.Compare(left=left, ops=ops, comparators=right):
            return zip([left, *right], ops, right, strict=False)
        case ast.BoolOp(op=op, values=values):
            return [(left, op, right) for left, right in pairwise(values)]
    return ()


def _is_cast(node: ast.Call) -> bool:
    return isinstance(node.func, ast.Name) and node.func.id == "cast"


def _below(node: ast.AST) -> Iterable[ast.AST]:
    """Return the nodes below one that may have faults: no annotations, decorators, or texts of errors."""
    match node:
        case ast.Raise() | ast.JoinedStr() | ast.AnnAssign(value=None):  # 3.11 does not place the parts of f-strings
            return ()
        case ast.AnnAssign(value=ast.AST() as value):
            return (value,)
        case ast.FunctionDef(args=arguments, body=body):
            return *arguments.defaults, *filter(None, arguments.kw_defaults), *body
        case ast.ClassDef(body=body):
            return body
        case ast.Call() if _is_cast(node):
            return (node.args[1],)
    return ast.iter_child_nodes(node)


# ---- which tests reach a file ----


def _imports(path: Path, modules: dict[str, Path]) -> set[str]:
    """Return the modules that a file imports, those inside functions and those named in texts included."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
        elif isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
            prefix = str(node.values[0].value)
            if prefix.startswith("lippmann."):
                found |= {name for name in modules if name.startswith(prefix)}
    return found & modules.keys()


@cache
def _distances(top: Path) -> tuple[dict[str, Path], Any]:
    """Return the modules of tests/host and of the package, and over how many imports each (row) reaches each."""
    modules = {path.stem: path for path in (top / "tests" / "host").glob("*.py")}
    for path in (top / PACKAGE).rglob("*.py"):
        parts = path.relative_to(top / "host").with_suffix("").parts
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    imports = [_imports(path, modules) for path in modules.values()]
    direct = np.array([[name in some for name in modules] for some in imports])
    return modules, shortest_path(direct, unweighted=True)


def order_tests(top: Path, file: str) -> tuple[list[str], list[str], list[str]]:
    """Return the test files of tests/host: the `FIRST` nearest to a file, others that import it, and the others.

    Near are those with the file's name in theirs, then those that import it over the fewest other files, then those
    that import least.
    """
    modules, distances = _distances(top)
    target, name = next((k, name) for k, (name, path) in enumerate(modules.items()) if path == top / file)
    words = {word[:6] for word in name.split(".")[-1].split("_") if len(word) > 3}
    ranked = []
    for test, steps in zip(modules, distances, strict=True):
        if test.startswith("test_") and test not in OWN:
            named = words & {word[:6] for word in test.split("_")} and steps[target] < np.inf
            ranked.append((not named, steps[target], sum(steps < np.inf), test))
    files = [f"tests/host/{test}.py" for *_, test in sorted(ranked)]
    connected = sum(steps < np.inf for _, steps, *_ in ranked)
    first = min(FIRST, connected)
    return files[:first], files[first:connected], files[connected:]


def _last(file: str) -> list[str]:
    """Return the tests of a file that simulate the RTL."""
    area, stem = Path(file).relative_to(PACKAGE).parts[0], Path(file).stem
    own = repository() / "tests" / "rtl" / stem
    return [*([f"tests/rtl/{stem}"] if area == "fixed" and own.is_dir() else []), *LAST.get(area, ())]


# ---- trying a fault ----


def fate(fault: Fault, scratch: Scratch) -> str:
    """Return how a fault ends: 'caught', with the test that failed, 'survived', or 'refused' when it is none."""
    if not differs(fault, (scratch.folder / fault.file).read_text()):
        return "refused"
    *near, others = order_tests(scratch.folder, fault.file)
    return scratch.fate(fault, near, [others, _last(fault.file)])


def groups(top: Path) -> dict[str, list[Fault]]:
    """Return the faults of each area."""
    files = [path.relative_to(top) for path in sorted((top / PACKAGE).rglob("*.py"))]
    return {
        ", ".join(parts): [
            fault for file in files if file.parts[2] in parts for fault in faults_of(top / file, str(file))
        ]
        for parts in AREAS
    }


@click.command(params=options(60))
def main(**chosen: Any) -> None:
    """Put faults into the host's Python and report how many the quick tests catch.

    Example: python -m lippmann.dev.host_mutation --count 5 --report out
    """
    report_faults("host_mutation", groups(repository()), fate, SAME, **chosen)


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:], main, None))
