"""Puts faults into the host's Python, one at a time, and counts those that quick tests catch (`make mutation-host`).

In a copy of the checkout, a fault changes an operator, a number or a sign, negates a condition, exchanges two arguments
or removes a statement, but not in docstrings, annotations, decorators or error messages. The tests of tests/host that
execute the line in their own process run first, up to a failure, then the tests in `LAST`.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import click
import coverage
from asttokens import ASTText
from lippmann.cli.frame import option
from lippmann.cli.output import log
from lippmann.simulation.toolchain import repository

from tools.mutation_runner import FEW, Fault, Scratch, Trial, read_equivalent_faults, report_faults
from tools.program import program

PACKAGE = Path("host/lippmann")
#: Areas (folders) of the package; each gets the same number of faults.
AREAS = ("display", "optics", "fixed", "board", "rendering")
#: Tests that simulate the RTL and run last, keyed by area.
LAST = {"fixed": ("tests/rtl/test_batch.py", "tests/rtl/raster"), "board": ("tests/system",)}
#: Arguments of pytest: the tests that run first (except those of this program), and options that record coverage.
TESTS = ("tests/host", "--ignore=tests/host/test_host_mutation.py")
MEASURED = ("--cov=host/lippmann", "--cov-context=test", "--cov-report=", "-p", "no:cacheprovider")

#: Faults that no test can detect, because the results do not change.
SAME = read_equivalent_faults("host")

#: Operators, each with its text and the wrong operator that replaces it.
SWAPS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"), ast.Pow: ("**", "*"), ast.LShift: ("<<", ">>"), ast.RShift: (">>", "<<"),
    ast.BitAnd: ("&", "|"), ast.BitOr: ("|", "&"), ast.BitXor: ("^", "|"), ast.And: ("and", "or"),
    ast.Or: ("or", "and"), ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"),
}  # fmt: skip

#: An edit: begin and end position in a file, and the new text.
Edit = tuple[int, int, str]


def faults_of(path: Path, file: str) -> list[Fault]:
    """Return all faults for a Python file, named `file` in reports; a few change nothing or are invalid."""
    source, faults = path.read_text(), []
    tree = ast.parse(source)
    for begin, end, new in sorted(set(_edits(source, ASTText(source, tree).get_text_range, tree))):
        first, last = source.rfind("\n", 0, begin) + 1, source.find("\n", end)
        now = source[first:begin] + new + source[end:last]
        faults.append(Fault(file, source.count("\n", 0, first) + 1, source[first:last], now))
    return faults


def differs(fault: Fault, text: str) -> bool:
    """Return whether a fault turns a file's text into a different and valid Python program."""
    try:
        return ast.dump(ast.parse(fault.changed(text))) != ast.dump(ast.parse(text))
    except SyntaxError:
        return False


def _edits(source: str, span: Callable[[ast.AST], tuple[int, int]], node: ast.AST) -> Iterator[Edit]:
    """Yield the edits for a syntax node and the nodes below it; `span` returns a node's begin and end position."""

    def text(part: ast.AST) -> str:
        return source[slice(*span(part))]

    for before, operator, after in _operators(node):
        was, now = SWAPS.get(type(operator), ("", ""))
        begin = span(before)[1]
        found_at = re.search(re.escape(was).replace(r"\ ", r"\s+"), source[begin : span(after)[0]])
        if was and found_at:
            yield begin + found_at.start(), begin + found_at.end(), now
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
    """Return a node's operators, each between its left and right operands."""
    match node:
        case ast.BinOp(left=before, op=op, right=after) | ast.AugAssign(target=before, op=op, value=after):
            return [(before, op, after)]
        case ast.Compare(left=first, ops=ops, comparators=others):
            return zip([first, *others], ops, others, strict=False)
        case ast.BoolOp(op=op, values=values):
            return [(before, op, after) for before, after in pairwise(values)]
    return ()


def _is_cast(node: ast.Call) -> bool:
    return isinstance(node.func, ast.Name) and node.func.id == "cast"


def _below(node: ast.AST) -> Iterable[ast.AST]:
    """Return a node's children that may get faults: not annotations, decorators and error messages."""
    match node:
        # Python 3.11 gives no positions in f-strings.
        case ast.Raise() | ast.JoinedStr() | ast.AnnAssign(value=None):
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


# ---- which tests execute a line ----


class Reach:
    """The tests that execute each line of the package, as recorded in one run without faults."""

    def __init__(self, scratch: Scratch) -> None:
        log("running the tests once, to record which tests execute each line")
        scratch.run([*MEASURED, *TESTS], scratch.jobs)
        self._data = coverage.CoverageData(str(scratch.folder / ".coverage"))
        self._data.read()
        self._folder = scratch.folder
        # Count each test's lines; tests of few lines are quick and specific, and run first.
        self._lines = Counter(
            test
            for file in self._data.measured_files()
            for contexts in self._data.contexts_by_lineno(file).values()
            for test in map(_test_of, contexts)
        )

    def tests(self, fault: Fault) -> list[str]:
        """Return the tests that execute a fault's line or, if the line runs only at import, any line of the file."""
        contexts = self._data.contexts_by_lineno(str(self._folder / fault.file))
        lines = range(fault.line, fault.line + fault.was.count("\n") + 1)
        tests = {_test_of(context) for line in lines for context in contexts.get(line, ())} - {""}
        tests = tests or {_test_of(context) for each in contexts.values() for context in each} - {""}
        return sorted(tests, key=lambda test: (self._lines[test], test))


_reach = cache(Reach)


def _test_of(context: str) -> str:
    """Return the test's name from a coverage context such as "tests/host/test_glass.py::test_index|run"."""
    return context.rpartition("|")[0]


def _last(file: str) -> list[str]:
    area, stem = Path(file).relative_to(PACKAGE).parts[0], Path(file).stem
    own = [f"tests/rtl/{stem}"] if area == "fixed" and (repository() / f"tests/rtl/{stem}").is_dir() else []
    return [*own, *LAST.get(area, ())]


def fate(fault: Fault, scratch: Scratch) -> str:
    """Return a fault's fate: "caught by" a test, "survived", or "refused" if the fault is no valid change."""
    if not differs(fault, (scratch.folder / fault.file).read_text()):
        return "refused"
    near = _reach(scratch).tests(fault)
    return scratch.fate(fault, [near[:FEW], near[FEW:]], [_last(fault.file)])


def groups(top: Path) -> dict[str, list[Fault]]:
    """Return all faults, keyed by area."""
    files = [path.relative_to(top) for path in sorted((top / PACKAGE).rglob("*.py"))]
    return {
        area: [fault for file in files if file.parts[2] == area for fault in faults_of(top / file, str(file))]
        for area in AREAS
    }


@program
def main(
    count: int = option("Number of faults.", 60, click.IntRange(1)),
    trial: Trial = Trial,  # type: ignore[assignment]
) -> None:
    """Put faults into the host's Python code, and report how many faults the quick tests catch.

    Example: python -m tools.host_mutation --count 5 --report out
    """
    report_faults("host_mutation", groups(repository()), fate, SAME, count, trial)
