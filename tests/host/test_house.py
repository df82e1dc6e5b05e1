"""`python -m tools.house`: each kind of fault in a small house is told, and a sound one is not."""

import copy
import tomllib

import pytest
from tools.house import BOUNDS, check_house, longest_chain

SOUND = '''"""A file."""

#: Number of things.
COUNT = 1


def count_things(things):
    """Return their number."""
    return len(things)
'''
ROOMS = ("base", "display")


@pytest.fixture
def house(tmp_path):
    """A house of two rooms, and its bounds."""
    for folder in ("host/lippmann", "host/tools", "tests", *(f"host/lippmann/{room}" for room in ROOMS)):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "__init__.py").write_text('"""A room."""\n')
    (tmp_path / "host/lippmann/base/things.py").write_text(SOUND)
    (tmp_path / "host/lippmann/display/panels.py").write_text(SOUND + "\nfrom lippmann.base import things\n")
    bounds = copy.deepcopy(tomllib.loads(BOUNDS.read_text()))
    bounds["rooms"].update(names=list(ROOMS), loose=["__init__"], chain=2)
    return tmp_path, bounds


def test_a_sound_house_has_no_fault(house):
    assert check_house(*house) == []


LONG = "def draw():\n" + "    pass\n" * 60


@pytest.mark.parametrize(
    ("file", "text", "fault"),
    [
        ("host/lippmann/base/long.py", LONG, "package: 1 long functions, at most 0"),
        ("host/lippmann/base/wide.py", "x = 1  # " + "x" * 3000, "characters a line"),
        ("host/lippmann/base/bare.py", "x = 1\n" * 300, "comments a line"),
        ("host/lippmann/base/names.py", "told = 1\n", "package: 1 refused names, at most 0"),
        ("host/lippmann/loose.py", SOUND, "loose.py: the package's files"),
        ("host/lippmann/base/inner/deep.py", SOUND, "base/inner: the rooms are base, display"),
        ("host/lippmann/display/things.py", SOUND, "things.py is in the rooms base and display"),
        ("tests/test_many.py", "\n" * 60_000, "tests: 60001 lines"),
        ("rtl/scene.sv", "logic told_q;  // a name", "rtl/scene.sv:1: rename told"),
        ("sim/wide.sv", f"// {'x' * 98}", "sim/wide.sv:1: 101 columns, at most 100"),
    ],
)
def test_each_fault_is_told(house, file, text, fault):
    top, bounds = house
    bounds["package"] |= {"long_functions": 0, "refused_names": 0}
    (top / file).parent.mkdir(exist_ok=True)
    (top / file).write_text(text)
    assert any(fault in line for line in check_house(top, bounds))


def test_the_longest_chain_is_found():
    imports = {"cli": {"api", "board"}, "api": {"base"}, "board": {"optics"}, "optics": {"base"}, "base": set()}
    assert longest_chain(imports, frozenset({"cli", "board", "optics", "base"})) == ["cli", "board", "optics", "base"]
    assert longest_chain(imports, frozenset({"cli", "base"})) == ["cli", "base"]
