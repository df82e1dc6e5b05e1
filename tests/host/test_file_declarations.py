"""What follows from the declarations of the TOML files: schemas, the tables of the pages, and how a key is added."""

import json
import re
import tomllib
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lippmann.base import toml
from lippmann.base.toml import key
from lippmann.cli import run
from lippmann.cli.inspect import FILES, schema_of
from lippmann.display.description import Display, Panel, load_display, parse_display
from lippmann.errors import InputError
from tools.generate_documentation import MARKED, generate

TOP = Path(__file__).parents[2]


def test_tables_and_schemas_are_current():
    """`make docs-tables` would change nothing."""
    made = generate(TOP)
    pages = {str(path) for path in made if path.suffix == ".md"}
    assert pages >= {f"docs/reference/{name}-file.md" for name in ("display", "setup", "film")}
    assert {path.stem for path in made if path.suffix == ".json"} == set(FILES)
    assert [str(path) for path, text in made.items() if (TOP / path).read_text() != text] == []


def test_every_key_stands_in_a_table_and_has_a_meaning():
    for kind in ("display", "setup", "film"):
        page = (TOP / f"docs/reference/{kind}-file.md").read_text()
        shown = {mark[3]: mark[0] for mark in MARKED.finditer(page) if mark[2] == kind}
        wanted = dict(toml.tables(schema_of(kind)))
        # The set-up's display has a page of its own; the world's keys are an object's.
        same = {name for name in wanted if re.match(r"display|world", name)}
        assert set(shown) == set(wanted) - same
        for name, text in shown.items():
            for inner, node in wanted[name]["properties"].items():
                if name or (inner not in wanted):
                    assert f"| `{inner}` |" in text, f"{kind}: {name}.{inner}"
                    assert node.get("description"), f"{kind}: {name}.{inner} has no meaning"


def test_a_table_that_does_not_exist_is_refused(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/page.md").write_text("<!-- keys: display pannel -->\n<!-- end of keys -->\n")
    with pytest.raises(InputError, match=r"keys: display pannel.*no such table; choose from panel, array"):
        generate(tmp_path)


PROMISE = """[[promise]]
page = "docs/page.md"
words = "nothing is lost"
kept_by = ["rtl/kept.sv"]
tests = ["tests/test_page.py::test_nothing_is_lost"]
points = ["tie"]
"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("nothing is lost", "nothing was lost", r"words: docs/page.md does not say 'nothing was lost'; quote its"),
        ("docs/page.md", "docs/old.md", r"there is no file docs/old.md; give its"),
        ("kept.sv", "old.sv", r"there is no file rtl/old.sv; give its"),
        ("test_page.py", "test_old.py", r"there is no file tests/test_old.py; give its"),
        ("::test_nothing_is_lost", "::test_nothing_is_los", r"has no test 'test_nothing_is_los'; did you mean"),
        ('["tie"]', '["ties"]', r"points: there is no coverage point 'ties'; did you mean tie"),
    ],
)
def test_a_promise_whose_words_file_test_or_point_is_gone_is_refused(old, new, said, tmp_path):
    for name, text in {
        "docs/page.md": "Here nothing\nis lost.\n",
        "docs/generated/promises.md": "<!-- promises -->\n<!-- end of promises -->\n",
        "docs/promises.toml": PROMISE.replace(old, new),
        "rtl/kept.sv": "",
        "tests/test_page.py": "def test_nothing_is_lost():\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=rf"docs/promises.toml: promise\[0\].*{said}"):
        generate(tmp_path)


@pytest.mark.parametrize("kind", ["display", "setup", "film"])
def test_a_file_of_another_kind_is_named(kind, tmp_path):
    """By every key that only one kind of file has at its top, in files of the kinds without this key."""
    top = {one: set(schema_of(one)["properties"]) for one in FILES}
    titles = {"setup": "set-up", "layer_film": "film-of-layers"}
    for name, home in toml.KINDS.items():
        assert [titles.get(one, one.replace("_", " ")) for one in FILES if name in top[one]] == [home]
        inside = {inner for table, node in toml.tables(schema_of(kind)) for inner in node["properties"]}
        if name in inside:
            continue
        module, declared = FILES[kind]
        remedy = f"this is a {home} file, give a {titles.get(kind, kind)} file"
        with pytest.raises(InputError, match=f"^f.toml: {name}: unknown key; {remedy}$"):
            toml.read(getattr(import_module(module), declared), {name: {}}, "f.toml")


@pytest.mark.parametrize("kind", FILES)
def test_inspect_prints_the_schema(capsys, kind):
    assert run(["inspect", "--schema", kind]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((TOP / f"docs/generated/schemas/{kind}.json").read_text())


def test_inspect_needs_a_display_or_a_schema(refusal_of):
    assert "DISPLAY.toml" in refusal_of("inspect")
    assert run(["inspect", "--schema", "scene"]) == 2


def test_the_schema_says_what_the_reader_checks():
    top = schema_of("display")
    assert top["required"] == ["panel", "array", "gap_mm"]
    panel = top["properties"]["panel"]
    assert panel["additionalProperties"] is False
    assert panel["properties"]["bits"] == {
        "description": "bits of each colour, for PNG files and boards",
        "type": "integer",
        "minimum": 1,
        "maximum": 16,
        "default": 8,
    }
    assert panel["allOf"] == [{"oneOf": [{"required": ["pixel_pitch_mm"]}, {"required": ["dpi"]}]}]
    assert set(top["properties"]["array"]["properties"]["grid"]["enum"]) == {"square", "hex"}
    # Scenes keep tables of their own beside their placement.
    assert schema_of("placement")["additionalProperties"] is True
    assert schema_of("placement")["properties"]["placement"]["additionalProperties"] is False
    assert "null" not in json.dumps([schema_of(kind) for kind in FILES])
    assert "$ref" not in json.dumps([schema_of(kind) for kind in FILES])


def test_meanings_stand_in_docstrings():
    assert "\nAttributes\n----------\nwidth_px\n    number of pixels\n" in Panel.__doc__
    assert "\ngap_mm\n    from the panel's emitting plane" in Display.__doc__


@dataclass(frozen=True)
class Stand:
    """A table of a file to come."""

    height_mm: Annotated[float, key("above the floor", low=0.0, high=2000.0)]
    legs: Annotated[int, key("number of legs", low=3, high=5)] = 4
    wood: Annotated[Literal["oak", "pine"], key("its material")] = "oak"


@dataclass(frozen=True)
class Room:
    """A file to come."""

    stand: Stand
    stools: tuple[Stand, ...] = ()


def test_a_declaration_is_all_that_a_file_needs():
    read = toml.read(Room, {"stand": {"height_mm": 3}, "stools": [{"height_mm": 1.5, "wood": "pine"}]}, "f")
    assert read == Room(Stand(3.0), (Stand(1.5, wood="pine"),))
    assert isinstance(read.stand.height_mm, float)
    assert [name for name, _ in toml.tables(toml.schema(Room))] == ["", "stand", "stools"]


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        ({"stand": {"height_mm": 1, "legs": True}}, "f: stand.legs: True is not valid; give a whole number"),
        ({"stand": {"height_mm": 1}, "stools": [{"height_mm": 1}, 7]}, "f: stools[1]: 7 is not valid; write it as"),
        ({"stand": {"height_mm": 1}, "legs": 3}, "f: legs: unknown key; it belongs in [stand] or in [stools]"),
    ],
)
def test_its_faults_are_named(raw, said):
    with pytest.raises(InputError, match=re.escape(said)):
        toml.read(Room, raw, "f")


SHIPPED = {
    "display": "displays/vga-hex", "setup": "setups/pickup", "film": "films/swim", "placement": "fish/fish",
    "layers": "layers/fish/layers",
}  # fmt: skip
#: Of kinds of which no file ships.
TEXTS = {
    "depth_picture": """[depth_picture]
colour = "room.png"
depth = "room-depth.png"
unit_mm = 1.0
fov_deg = 60
""",
    "pictures": """background = [0, 0.5, 1]
[[picture]]
file = "hill.png"
depth_mm = "sky"
[[picture]]
file = "boat.png"
depth_mm = 5.0
centre_mm = [1.0, 2.0]
width_mm = 10.0
""",
    "layer_film": """layers = "fish"
frames = 9
frames_per_second = 24
motion = "linear"
[[layer]]
name = "stems"
pivot_mm = [1.0, -2.0]
keys = [{ frame = 0, offset_mm = [1, 0, 2.5], scale = 2 }, { frame = 8, shear = 0.1, order = 1.5, visible = false }]
""",
}
SCALARS = st.one_of(
    st.integers(), st.floats(), st.booleans(), st.sampled_from(("", "a\nb", "pair", "N-BK7")), st.dates()
)
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner))


def paths(value, before=()):
    """Every place in nested tables and lists."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [before, *(path for name, item in inner for path in paths(item, (*before, name)))]


@pytest.mark.parametrize("kind", FILES)
@given(data=st.data())
def test_any_value_anywhere_is_read_or_refused_in_one_line(kind, data):
    form = getattr(import_module(FILES[kind][0]), FILES[kind][1])
    text = TEXTS[kind] if kind in TEXTS else (TOP / f"scenes/{SHIPPED[kind]}.toml").read_text()
    raw = tomllib.loads(text)
    *path, last = data.draw(st.sampled_from(paths(raw)[1:]))
    place = raw
    for name in path:
        place = place[name]
    place[last] = data.draw(VALUES)
    try:
        toml.read(form, raw, "some/file.toml")
    except InputError as error:
        message = str(error)
        assert message.startswith("some/file.toml: ")
        assert "\n" not in message


def test_a_display_read_from_its_file_is_a_plain_dataclass():
    display = load_display(TOP / "scenes/displays/uhd-4k.toml")
    assert type(display) is Display
    # Numbers without a point are floats, as if they were written with one.
    panel, array = "width_px = 9\nheight_px = 9\ndpi = 254\n", "grid = 'hex'\npitch_mm = 1\nindex = 2\nradius_mm = 2\n"
    whole = f"gap_mm = 3\n[panel]\n{panel}[array]\n{array}"
    read = parse_display(whole)
    assert {type(x) for x in (read.gap_mm, read.array.pitch_mm, read.array.index, read.array.radius_mm)} == {float}
    assert read.identity == parse_display(re.sub(r"(mm|index) = (\d)", r"\1 = \2.0", whole)).identity
