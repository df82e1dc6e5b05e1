"""Reads TOML files by declarations: a dataclass declares a table, `key` describes a key.

The reader (`read`), the JSON Schema for editors (`schema`), the pages' tables
(`tools.generate_documentation`) and the checks (`check_fields`) use the declarations.
"""

from __future__ import annotations

import dataclasses
import difflib
import inspect
import math
import os
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
import tomli_w

from lippmann.base.file_limits import MAX_TOML_BYTES, read_limited
from lippmann.errors import InputError, check_type, input_error, likely_file, located, reason

#: Maximum parts of a dotted key; the parse time grows quadratically.
MAX_KEY_PARTS = 32
#: Maximum bytes of one part of a path, and characters of a whole path.
MAX_NAME_BYTES, MAX_PATH = 255, 4000
DEEP_KEY = re.compile(rf"""(?<![\w-])(?:(?>[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}}""", re.ASCII)

Form = TypeVar("Form")
Schema = dict[str, Any]
#: Types of a table (of a TOML file, declaration or schema) and of a value in it.
Table = dict[str, Any]
Value = Any
#: Top-level keys, and the kind of file that each key indicates.
KINDS = {
    "placement": "placement",
    "display": "set-up",
    "lens": "set-up",
    "camera": "set-up",
    "pickup": "set-up",
    "scene": "film",
    "world": "film",
    "layers": "film-of-layers",
    "panel": "display",
    "gap_mm": "display",
    "picture": "pictures",
    "depth_picture": "depth picture",
}
UNITS = r"_(deg|rad|nm|um|mm|cm|m|in|px|percent|cd_m2)$"
#: For each key, words with which users may begin a wrong name for it.
SYNONYMS = {
    "shear": ("skew", "slant"),
    "rotation_deg": ("angle", "tilt", "turn"),
    "grid": ("layout",),
    "subpixels": ("layout", "stripes"),
    "viewing_distance_mm": ("eye",),
}
ENDLESS = "a number of thousands of digits"
#: Remedy for invalid TOML syntax.
MEND = "correct the syntax there (write numbers with a point, text in quotes)"


def key(
    meaning: str,
    *,
    above: float | None = None,
    low: float | None = None,
    high: float | None = None,
    default: str = "",
    instead_of: str = "",
    shape: str = "",
    lengths: tuple[int | None, int | None] = (None, None),
) -> msgspec.Meta:
    """Describe a declared key: `name: Annotated[type, key(...)]`.

    `above` is an exclusive lower bound; `low` and `high` are inclusive bounds.
    `default` describes the default in words. The described key is an alternative to the
    key `instead_of`: a file has exactly one of the two, or at most one if `instead_of`
    has a `default`. `shape` describes a list in words, "a list of ..."; `lengths` are
    the list's minimum and maximum number of entries.
    """
    texts = ("x-default", default), ("x-instead-of", instead_of), ("x-shape", shape)
    extra = {name: text for name, text in texts if text}
    bounds: Table = {"gt": above, "ge": low, "le": high, "min_length": lengths[0], "max_length": lengths[1]}
    return msgspec.Meta(description=meaning, extra_json_schema=extra, **bounds)


def documented(form: type[Form]) -> type[Form]:
    """Append the descriptions of a dataclass's keys to its docstring."""
    lines = [inspect.cleandoc(form.__doc__ or ""), "", "Attributes", "----------"]
    for name, hint in get_type_hints(form, include_extras=True).items():
        notes = [meta for part in (hint, *get_args(hint)) for meta in getattr(part, "__metadata__", ())]
        meanings = [meta.description for meta in notes if meta.description]
        lines += [name, *(f"    {meaning}" for meaning in meanings[-1:])]
    form.__doc__ = "\n".join(lines)
    return form


def variant(form: type, optional: tuple[str, ...], **changes: object) -> Value:
    """Return the dataclass `form` with the field types `changes`; `optional` fields default to None."""
    hints = {**get_type_hints(form, include_extras=True), **changes}
    defaults = {field.name: field.default for field in dataclasses.fields(form)} | dict.fromkeys(optional)
    fields = []
    for name, kind in hints.items():
        field = dataclasses.field(default=defaults.get(name, dataclasses.MISSING))
        fields.append((name, kind | None if name in optional else kind, field))
    return dataclasses.make_dataclass(form.__name__, fields, frozen=True, kw_only=True)


def values(keys: Value) -> Table:
    """Return keys and values of a table that `read` returned, with defaults."""
    return {field.name: getattr(keys, field.name) for field in dataclasses.fields(keys)}


@cache
def schema(form: Value) -> Schema:
    """Return a file's JSON Schema; `other_tables = True` in a class accepts unknown top-level keys."""
    complete = msgspec.json.schema(form, schema_hook=lambda _: {"type": "string"})  # a path

    def plain(node: Value) -> Value:
        if isinstance(node, list):
            return [plain(item) for item in node]
        if not isinstance(node, dict):
            return node
        # TOML has no null; a missing key means None.
        options = [option for option in node.get("anyOf", ()) if option != {"type": "null"}]
        if options:
            only = options[0] if len(options) == 1 else {"anyOf": options}
            node = {**only, **node, "anyOf": only.get("anyOf")}
        if "enum" in node:
            node["enum"] = [option for option in node["enum"] if option is not None]
        if node.get("$ref"):  # leave out the class's docstring
            table = complete["$defs"][node["$ref"].rpartition("/")[2]]
            node = {**table, "title": None, "description": None, **node, "$ref": None}
        node = {name: plain(value) for name, value in node.items() if value is not None}
        if node.get("type") == "object":
            node["additionalProperties"] = False
            choices = []
            for group, needed in rivals(node):
                each = [{"required": [name]} for name in group]
                choices.append({"oneOf": each if needed else [*each, {"not": {"anyOf": each}}]})
            if choices:
                node["allOf"] = choices
        return node

    return {**plain({"$ref": complete["$ref"]}), "additionalProperties": getattr(form, "other_tables", False)}


def rivals(table: Schema) -> list[tuple[list[str], bool]]:
    """Return a table's groups of alternative keys, and whether each group is required."""
    groups: dict[str, list[str]] = {}
    for name, node in table["properties"].items():
        if "x-instead-of" in node:
            groups.setdefault(node["x-instead-of"], [node["x-instead-of"]]).append(name)
    return [(group, "x-default" not in table["properties"][first]) for first, group in groups.items()]


def tables(node: Schema, name: str = "") -> Iterator[tuple[str, Schema]]:
    """Yield name and schema of a table and of its inner tables; the top table's name is ""."""
    for option in node.get("anyOf", [node]):
        if "properties" in option:
            yield name, option
            for inner, value in option["properties"].items():
                yield from tables(value, f"{name}.{inner}" if name else inner)
        elif isinstance(option.get("items"), dict):
            yield from tables(option["items"], name)


def parse(text: str, source: str, remedy: str = MEND) -> Table:
    """Parse TOML text; errors contain `source`, and `remedy` for invalid syntax."""
    if (deep := DEEP_KEY.search(text)) is not None:
        place = text.count("\n", 0, deep.start()) + 1
        raise input_error(source, f"a key of more than {MAX_KEY_PARTS} parts in line {place}", remedy)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # invalid syntax, very long numbers, too deep nesting
        line = re.search(r"(?:twice|overwrite).*line (\d+)", str(error))
        if line:
            name = text.splitlines()[int(line[1]) - 1].partition("=")[0].strip()
            what = f"{name} is given a second time in line {line[1]}"
            raise input_error(source, what, "remove one of the lines") from None
        why = ENDLESS if "int_max_str_digits" in str(error) else error
        raise input_error(source, f"not TOML ({why})", remedy) from None


def load(path: Path, what: str) -> Table:
    """Read the tables of a TOML file; `what` is the kind of file in error messages."""
    remedy = f"give a {what} file (.toml)"
    try:
        text = read_limited(path, MAX_TOML_BYTES, remedy).decode("utf-8-sig")
    except FileNotFoundError:
        likely = likely_file(path, (".toml",)) or f"give the path of a {what} file (.toml)"
        raise input_error(path, "no such file", likely) from None
    except (OSError, ValueError) as error:  # the text is not UTF-8, or the file name is invalid
        raise input_error(path, f"cannot be read ({reason(error)})", remedy) from None
    return parse(text, str(path), MEND if path.suffix.lower() == ".toml" else remedy)


def read(form: Callable[..., Form], raw: Mapping[str, Value], source: str) -> Form:
    """Convert parsed TOML to the dataclass `form`.

    Raises InputError for unknown keys first, then for other faults.
    """
    top = schema(form)
    nodes = {name: (value, node) for name, value, node in _walk(raw, top, "")}
    for name, (value, node) in nodes.items():
        keys = value if isinstance(value, dict) and "properties" in node else ()
        # Report first a key that belongs to another kind of file.
        for unknown in sorted(keys, key=lambda one: bool(name) or one not in KINDS):
            if unknown not in node["properties"] and not node["additionalProperties"]:
                hint = _hint(top, node, value, unknown)
                if not name and unknown in KINDS and not hint.startswith("it belongs"):
                    kind = re.sub(r"(?<=[a-z])[A-Z]", r" \g<0>", form.__name__.removesuffix("File")).lower()
                    kind = kind.replace("setup", "set-up").replace("layer film", "film-of-layers")
                    hint = f"this is a {KINDS[unknown]} file, give a {kind} file"
                raise input_error(f"{source}: {_join(name, unknown)}", "unknown key", hint)
    for name, (value, node) in nodes.items():
        for group, needed in rivals(node) if isinstance(value, dict) and "properties" in node else ():
            count = sum(rival in value for rival in group)
            if count > 1 or (needed and not count):
                state = "several are given" if count else "none is given"
                raise input_error(f"{source}: {_join(name, ' or '.join(group))}", state, "give exactly one of them")
        numbers = value if isinstance(value, list) else [value]
        if not all(map(_is_finite, numbers)):
            raise _wrong(source, name, value, node)
    try:
        with located(source):  # a `__post_init__` may raise InputError
            read: Form = msgspec.convert(raw, form, dec_hook=_path)
            return read
    except msgspec.ValidationError as error:
        # A msgspec message ends with the key: "at `$.object[0].keys[1].frame`".
        place = re.search(r" - at `\$\.?(.*)`$", str(error))
        name = place[1] if place else ""
        missing = re.match(r"Object missing required field `(.*?)`", str(error))
        if missing:
            raise input_error(f"{source}: {_join(name, missing[1])}", "the key is missing", "add it") from None
        while name not in nodes:  # the key is an element of a vector or of a list of vectors
            name = name.rpartition("[")[0]
        raise _wrong(source, name, *nodes[name]) from None


def check_fields(table: object) -> None:
    """Check and convert the fields of a declared dataclass like `read`.

    Raises InputError for a wrong field.
    """
    form: Value = type(table)
    source, (plain, parts) = form.__name__, _plain_form(form)
    for name, part in parts.items():
        check_type(f"{source}: {name}", getattr(table, name), part, f"lippmann's {part.__name__}")
    nodes = schema(plain)["properties"]
    raw = {name: _builtin(getattr(table, name)) for name in nodes}
    try:
        fields = values(msgspec.convert(raw, plain))
    except msgspec.ValidationError as error:
        name = re.split(r"\W", str(error).rpartition("$.")[2])[0]
        raise _wrong(source, name, raw[name], nodes[name]) from None
    for name, value in fields.items():
        if not _is_finite(value):
            raise _wrong(source, name, raw[name], nodes[name])
        object.__setattr__(table, name, value)


class Checked:
    """Base class of dataclasses that check their fields when Python code creates them."""

    def __post_init__(self) -> None:
        check_fields(self)


@cache
def _plain_form(form: Value) -> tuple[Value, Table]:
    hints = get_type_hints(form, include_extras=True)
    parts = {name: kind for name, kind in hints.items() if dataclasses.is_dataclass(kind)}
    fields = [(name, kind) for name, kind in hints.items() if name not in parts]
    return dataclasses.make_dataclass(form.__name__, fields), {**parts}


def _builtin(value: Value) -> Value:
    if isinstance(value, list | tuple):
        return tuple(map(_builtin, value))
    return value.tolist() if hasattr(value, "tolist") else value


def _is_finite(value: object) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def toml_text(table: Mapping[str, object], *, one_line: bool = True) -> str:
    """Return a table as TOML text; if `one_line` is False, each list entry has its own line."""
    text = tomli_w.dumps(table, indent=2)
    if not one_line:
        return text
    # Only lists have lines that end with [ or a comma.
    return re.sub(r",\n *", ", ", re.sub(r"(?<=\[)\n *|,\n *(?=\])", "", text))


def _path(kind: Callable[[str], Path], text: str) -> Path:
    parts = [os.fsencode(part) for part in Path(text).parts]
    if b"\0" in b"".join(parts) or max(map(len, parts), default=0) > MAX_NAME_BYTES or len(text) > MAX_PATH:
        raise ValueError(text)
    return kind(text)


def _join(table: str, name: str) -> str:
    return f"{table}.{name}" if table else name


def _walk(value: Value, node: Schema, name: str) -> Iterator[tuple[str, Value, Schema]]:
    if isinstance(value, dict):  # the key accepts text or a table
        node = next((option for option in node.get("anyOf", ()) if "properties" in option), node)
    yield name, value, node
    if isinstance(value, dict) and "properties" in node:
        for inner, item in value.items():
            if inner in node["properties"]:
                yield from _walk(item, node["properties"][inner], _join(name, inner))
    elif isinstance(value, list):
        # `x-shape` describes the inner lists too; `prefixItems` are their entries' schemas.
        options = node.get("anyOf", ())
        node = next((option for option in options if "a list of [" in option.get("x-shape", "")), node)
        shape = node.get("x-shape", "").partition("a list of ")[2]
        inner = {**(node.get("items") or {}), **({"x-shape": shape} if shape else {})}
        parts = node.get("prefixItems", ()) if "x-shape" in node else ()
        for place, item in enumerate(value if inner else value[: len(parts)]):
            if isinstance(item, list) or not shape:
                yield from _walk(item, inner or parts[place], f"{name}[{place}]")


def _hint(top: Schema, table: Schema, keys: Mapping[str, object], unknown: str) -> str:
    missing = {*table.get("required", ())}.difference(keys)
    for group, needed in rivals(table):
        if needed and not set(group) & set(keys):
            missing.update(group)

    def likeness(name: str) -> float:
        alike = difflib.SequenceMatcher(None, unknown.lower(), name).ratio()
        part, first = name in unknown.lower() or unknown.lower() in name, name[0] == unknown[:1].lower()
        node = table["properties"][name]
        options = [one for choice in node.get("anyOf", [node]) for one in choice.get("enum", ())]
        # Users may write a value as a key; 1 or 2 letters would match too many values.
        value = len(unknown) > 2 and any(unknown.lower() in str(one) for one in options)
        return alike + 0.25 * (name in missing) + 0.3 * part + 0.1 * first + 0.6 * value

    likeliest = sorted(table["properties"], key=likeness, reverse=True)[:1]
    similar = [name for name in likeliest if likeness(name) > 0.6]
    homes = [home for home, node in tables(top) if unknown in node["properties"]]
    places = [f"in [{home}]" if home else "at the top of the file, before the first [table]" for home in homes]
    hints = [f"it belongs {' or '.join(places)}"] if places else []
    everywhere = [_join(home, other) for home, node in tables(top) for other in node["properties"]]
    last = {other.rpartition(".")[2]: other for other in reversed(everywhere)}
    synonyms = [key for key, words in SYNONYMS.items() if unknown.lower().startswith(words)]
    # Prefer a key of the same table.
    likely = [key for key in synonyms if key in table["properties"]]
    likely += [last[key] for key in synonyms if key in last]
    if likely and not places:
        similar = likely[:1]
    if not places and not similar:
        similar = [last[other] for other in difflib.get_close_matches(unknown, last, 1)]
        similar = similar or (list(missing) if len(missing) == 1 else [])
    if similar:
        meant, unit = table["properties"].get(similar[0], {}), re.search(UNITS, unknown)
        meaning = meant.get("description", "")
        takes = f" ({meaning})" if unit and meaning and not similar[0].endswith(unit[0]) else ""
        hints.append(f"did you mean {similar[0]}{takes}?")
    return ", or ".join(hints) or f"known here: {', '.join(table['properties'])}"


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    try:
        return reprlib.repr(value).replace("'", '"')
    except ValueError:  # Python cannot print such a long number
        return ENDLESS


def _wrong(source: str, name: str, value: object, node: Schema) -> InputError:
    where = f"{source}: {name}"
    low, high = node.get("minItems", 0), node.get("maxItems", math.inf)
    if isinstance(value, list) and "x-shape" not in node and "prefixItems" not in node:  # tables
        if len(value) > high:
            return input_error(where, f"{len(value)} {name.rpartition('.')[2]}s", f"give at most {high}")
        if len(value) < low:
            how = remedy(node, re.sub(r"\[\d+\]", "", name))
            return input_error(where, "is empty", f"give at least {low}: {how}")
    short = repr(value) if isinstance(value, float) and node.get("type") == "integer" else _short(value)
    if isinstance(value, str) and node.get("type") == "string" and "enum" not in node:  # from `_path`
        return input_error(where, f"{short} is not a file name", "give a file name")
    words = [str(word) for choice in node.get("anyOf", [node]) for word in choice.get("enum", ())]
    meant = [word for word in words if len(short) > 1 and short.strip('"').lower() in word]
    guess = f'did you mean "{meant[0]}"? ' if len(meant) == 1 else ""
    return input_error(where, f"{short} is not valid", guess + remedy(node, re.sub(r"\[\d+\]", "", name)))


def remedy(node: Schema, name: str) -> str:
    """Describe the valid values of a key, as the remedy for a wrong value."""
    if "anyOf" in node:
        return " or ".join(remedy(option, name) for option in node["anyOf"])
    if "enum" in node:
        return "choose from " + ", ".join(f'"{option}"' for option in node["enum"])
    if "x-shape" in node:
        return f"give {node['x-shape']}"
    if "prefixItems" in node:
        return f"give [{', '.join('xyz'[: len(node['prefixItems'])])}], finite numbers"
    bounds = bounds_text(node)
    return {
        "string": "put it in quotes",
        "boolean": "give true or false",
        "integer": f"give a whole number {bounds}",
        "number": f"give a finite number{bounds and ', '}{bounds}",
        "array": f"write each of them as [[{name}]] or {{ ... }}",
        "object": f"write it as [{name}]",
    }[node["type"]]


def bounds_text(node: Schema) -> str:
    """Describe in words the range of a number."""
    low, high = node.get("minimum"), node.get("maximum")
    if low is not None and high is not None:
        return f"from {low:g} to {high:g}"
    words = {"exclusiveMinimum": "more than", "minimum": "at least", "maximum": "at most"}
    return ", ".join(f"{word} {node[bound]:g}" for bound, word in words.items() if node.get(bound) is not None)
