"""The mutation tool for the host: what it takes for a fault, which tests it runs first, and that they find one."""

from types import SimpleNamespace

import pytest
from lippmann.errors import LippmannError
from lippmann.simulation.toolchain import repository
from tools import host_mutation
from tools.host_mutation import differs, fate, faults_of
from tools.mutation_runner import Fault, Scratch, faults_page, try_faults

TOP = repository()
GLASS = "host/lippmann/display/glass.py"


def changes_of(tmp_path, text):
    """Each fault of a program, as its changed lines."""
    path = tmp_path / "program.py"
    path.write_text(text)
    found = faults_of(path, "program.py")
    return [fault.now.strip() for fault in found if differs(fault, text)]


@pytest.mark.parametrize(
    ("line", "faulty"),
    [
        ("y = a + b", ["y = a - b"]),
        ("y = (a) ** b  # not * here", ["y = (a) * b  # not * here"]),
        ("y = a < b == c", ["y = a <= b == c", "y = a < b != c"]),
        ("y = a is not b", ["y = a is b"]),
        ("y = a not in b or c", ["y = a in b or c", "y = a not in b and c"]),
        ("y = -a", ["y = a"]),
        ("y = x[7], 0.5, True", ["y = x[8], 0.5, True", "y = x[7], 0.55, True", "y = x[7], 0.5, False"]),
        ("y = 0.0", ["y = 1.0"]),
        ("y = f(a, b, k=c)", ["y = f(b, a, k=c)"]),
        ("y = f(a, *b)", []),
        ("f(a)", ["pass"]),
        ("y += a", ["pass", "y -= a"]),
        ("y = a if b else c", ["y = a if not (b) else c"]),
        ("y = cast(int, a + b)", ["y = cast(int, a - b)"]),
        ("y = 'ä' + 'ö', a * b", ["y = 'ä' - 'ö', a * b", "y = 'ä' + 'ö', a / b"]),
    ],
)  # fmt: skip
def test_each_place_gives_one_fault(tmp_path, line, faulty):
    assert sorted(changes_of(tmp_path, f"{line}\n")) == sorted(faulty)


def test_texts_types_and_errors_are_no_places_for_faults(tmp_path):
    text = '''"""With 1 + 1 == 2."""
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import json

@decorate(1 + 1)
def f(a: tuple[1, 2], b: "int | None" = None) -> list[3]:
    """Return f(1, 2), not 3."""
    c: dict[4, 5]
    d = f"{a + b} {1}"
    raise ValueError(a, b + 1)
'''
    assert changes_of(tmp_path, text) == ["pass"], "the raise alone"


def test_a_fault_over_two_lines(tmp_path):
    text = "def g():\n    return f(\n        a,\n        b,\n    )\n"
    path = tmp_path / "program.py"
    path.write_text(text)
    (fault,) = faults_of(path, "program.py")
    assert fault.changed(text) == "def g():\n    return f(\n        b,\n        a,\n    )\n"
    assert "+        b,\n         a,\n-        b,\n" in fault.diff(text)
    with pytest.raises(ValueError, match=r"program\.py:3 does not have"):
        fault.changed(text.replace("a", "z"))


def test_every_area_has_faults():
    groups = host_mutation.groups(TOP)
    assert list(groups) == ["display", "optics", "fixed", "board", "rendering"]
    assert all(len(group) > 100 for group in groups.values())
    assert all((TOP / path).exists() for paths in host_mutation.LAST.values() for path in paths)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return Scratch(tmp_path_factory.mktemp("scratch") / "copy")


@pytest.fixture(scope="module")
def reach(scratch):
    """Which of a few tests execute each line."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(host_mutation, "TESTS", ("tests/host/test_glass.py",))
        return host_mutation.Reach(scratch)


@pytest.fixture
def small(monkeypatch, reach):
    monkeypatch.setattr(host_mutation, "_reach", lambda _: reach)


def fault_at(scratch, file, text):
    lines = (scratch.folder / file).read_text().split("\n")
    place = next(k for k, line in enumerate(lines) if text in line)
    return Fault(file, place + 1, lines[place], f"{lines[place]} # other")


def test_the_tests_that_execute_a_line_run_first_those_that_execute_least(scratch, reach):
    # Found by reading test_glass.py: who asks for a glass that is unknown, and who for its index.
    refused = reach.tests(fault_at(scratch, GLASS, "raise"))
    assert refused
    assert all("::test_" in test and test.startswith("tests/host/test_glass.py") for test in refused)
    constant = reach.tests(fault_at(scratch, GLASS, "from __future__"))
    assert set(refused) < set(constant), "a line of the import: whoever executes any line of the file"
    assert not reach.tests(fault_at(scratch, "host/tools/peers.py", "import"))


def test_a_planted_fault_is_caught_by_the_tests_of_its_file(scratch, small):
    text = (TOP / GLASS).read_text()
    planted = [fault for fault in faults_of(TOP / GLASS, GLASS) if differs(fault, text)]
    fault = next(fault for fault in planted if fault.was.count(" / ") > fault.now.count(" / "))
    assert fate(fault, scratch).startswith("caught by tests/host/test_glass.py::")
    assert (scratch.folder / fault.file).read_text() == text, "the copy is as before"
    line = fault_at(scratch, GLASS, "from __future__")
    assert fate(Fault(GLASS, line.line, line.was, "from ("), scratch) == "refused"


@pytest.fixture
def planted(scratch, monkeypatch):
    """Returns the fate of a change that no test can see: a test file of a given text executes it, or runs last."""
    fault = fault_at(scratch, GLASS, "from __future__")
    path = scratch.folder / "tests/host/test_planted.py"

    def fate_with(text, stage):
        path.write_text(text)
        tests = ["tests/host/test_glass.py", "tests/host/test_planted.py"]
        near, last = (tests, []) if stage == "near" else (tests[:1], tests[1:])
        monkeypatch.setattr(host_mutation, "_reach", lambda _: SimpleNamespace(tests=lambda _: near))
        monkeypatch.setattr(host_mutation, "_last", lambda _: last)
        return fate(Fault(GLASS, fault.line, fault.was, f"{fault.was}; 1"), scratch)

    yield fate_with
    path.unlink()
    scratch.left_out.clear()
    scratch.sound.clear()


def test_a_test_that_fails_without_the_fault_is_left_out(scratch, planted, capsys):
    assert planted("def test_broken():\n    assert False\n", "near") == "survived"
    assert scratch.left_out == ["tests/host/test_planted.py::test_broken"]
    assert "test_planted.py::test_broken fails without a fault, too: the test is left out" in capsys.readouterr().err


def test_a_fault_that_keeps_a_file_of_tests_from_its_import_is_caught(scratch, monkeypatch):
    tests = ["tests/host/test_pll.py", "tests/host/test_glass.py::test_every_glass_is_checked_here"]
    monkeypatch.setattr(host_mutation, "_reach", lambda _: SimpleNamespace(tests=lambda _: tests))
    fault = fault_at(scratch, GLASS, "def index_of(")
    gone = Fault(GLASS, fault.line, fault.was, fault.was.replace("index_of", "index"))
    assert fate(gone, scratch) == f"caught by {tests[1]}"
    tests[1] = "tests/host/test_glass.py::test_that_never_was"
    with pytest.raises(LippmannError, match="pytest does not run in the copy"):
        fate(gone, scratch)
    scratch.left_out.clear()


#: Fails in its first run, with the fault, and whenever the file whose name it writes says so.
BY_CHANCE = """
from pathlib import Path

def test_chance():
    runs = Path({runs!r})
    runs.write_text(runs.read_text() + "x")
    assert len(runs.read_text()) in {passes}
"""


@pytest.mark.parametrize(
    ("stage", "passes", "end", "runs"),
    [
        ("near", (2,), "caught by tests/host/test_planted.py::test_chance", 2),
        pytest.param("last", (2,), "caught by tests/host/test_planted.py::test_chance", 3, marks=pytest.mark.full),
        ("last", (2, 3), "survived", 3),
    ],
    ids=["a test that executes the line fails once", "another fails twice", "another fails by chance"],
)
def test_another_test_must_fail_twice(scratch, planted, tmp_path, stage, passes, end, runs):
    """Its runs: with the fault, without it, and with the fault again."""
    record = tmp_path / "runs"
    record.write_text("")
    assert planted(BY_CHANCE.format(runs=str(record), passes=passes), stage) == end
    assert len(record.read_text()) == runs
    assert scratch.left_out == ["tests/host/test_planted.py::test_chance"] * (end == "survived")


def test_faults_are_counted_and_reported(tmp_path, capsys):
    made = [Fault("a.py", k, f"was {k}", f"now {k} | x") for k in (1, 2, 3, 4)]
    ends = {1: "caught by t", 2: "survived", 3: "refused", 4: "survived"}
    rows = try_faults(iter(made), 3, lambda fault: ends[fault.line], {("a.py", "now 4"): "0 is 0"})
    assert [end for _, end in rows] == ["caught by t", "survived", "no fault: 0 is 0"]
    assert "3/3 a.py:4 no fault: 0 is 0" in capsys.readouterr().err
    (tmp_path / "a.py").write_text("was 1\nwas 2\nwas 3\nwas 4\n")
    scratch = SimpleNamespace(folder=tmp_path, left_out=["tests/test_a.py::test_b"])
    made = faults_page("host_mutation", {"command": "make x"}, rows, {"a": made}, scratch).write(tmp_path / "page")
    assert [path.name for path in made] == ["host_mutation.md", "host_mutation.csv", "host_mutation.png"]
    page = made[0].read_text()
    assert "1 of 2 faults caught (50.0 %); 1 other changes do not change any result" in page
    assert "\n-was 2\n+now 2 | x\n" in page
    assert "| a.py | 4 | `was 4` | `now 4 \\| x` | 0 is 0 |\n" in page
    assert "`tests/test_a.py::test_b`" in page
    assert len(made[1].read_text().splitlines()) == 5
