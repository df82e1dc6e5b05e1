"""Convert a function to a command; its parameters' defaults declare options and arguments.

An option takes its type and flag from the parameter: `scene_path` becomes --scene,
`wait_s` --wait, `output` -o. Flags and optional values need no default. A default that
is a function or class is a group: `scene: Scene = _scene` adds the options of `_scene`,
and `scene` receives the result of `_scene`. A group's parameter without a default
takes its value from the command's parameter of the same name.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, NewType, get_args, get_origin, get_type_hints

import click
from click.shell_completion import CompletionItem

from lippmann.errors import did_you_mean

Function = Callable[..., Any]
REQUIRED = inspect.Parameter.empty
#: Parameter types: a folder's path; a file's or folder's name as the user wrote it.
Folder = NewType("Folder", Path)
Name = NewType("Name", str)


class Kind(click.ParamType[Any]):
    """Type of an option. `form` is shown in help texts; `read` converts a text or raises ValueError."""

    name = "kind"

    def __init__(self, form: str, read: Callable[[str], Any]) -> None:
        self.form, self.read = form, read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a text with `read`; a ValueError becomes a usage error."""
        try:
            return self.read(value) if isinstance(value, str) else value
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form that help texts show."""
        return self.form


def path_kind(read: Callable[[str], object], form: str = "FILE") -> Kind:
    """Return the option type of a path; the type refuses an empty path."""

    def read_path(text: str) -> object:
        if not text:
            raise ValueError(f"the name is empty; name a {form.lower()}")
        return read(text)

    return Kind(form, read_path)


#: Option types, keyed by the type of the parameter.
KINDS: dict[object, Kind] = {Path: path_kind(Path), Folder: path_kind(Path, "FOLDER"), Name: path_kind(str)}
#: Option --json, which every command has; see `lippmann.cli.output`.
JSON = click.Option(("--json", "as_json"), is_flag=True, help="Print one JSON object to stdout.")


class Choice(click.Choice[str]):
    """Option type with fixed values; an error message suggests the nearest value."""

    def get_invalid_choice_message(self, value: object, ctx: click.Context | None) -> str:
        """Return the message about an invalid value."""
        return f"{super().get_invalid_choice_message(value, ctx)} {did_you_mean(str(value), map(str, self.choices))}"


@dataclass(frozen=True)
class Declared:
    """An option or argument; `flag` None means an argument, "" a flag derived from the name."""

    flag: str | None
    attributes: Mapping[str, Any]

    def parameter(self, name: str, kind: object) -> click.Parameter:
        """Return click's parameter for the name and type of a function's parameter."""
        attributes: dict[str, Any] = dict(self.attributes)
        if NoneType in get_args(kind):
            kind = get_args(kind)[0]
            if attributes["default"] is REQUIRED:
                attributes["default"] = None
        if attributes["default"] is REQUIRED:
            del attributes["default"]
            attributes["required"] = kind is not bool
        if attributes["type"] is None:
            attributes["type"] = Choice(get_args(kind)) if get_origin(kind) is Literal else KINDS.get(kind, kind)
        # A text may be a file name, so the shell completes file names.
        if attributes["type"] is str or getattr(attributes["type"], "form", "") in ("FILE", "FOLDER"):
            attributes["shell_complete"] = lambda *_: [CompletionItem("", type="file")]
        if self.flag is None:
            return click.Argument((name,), **attributes)
        flag = self.flag or flag_of(name)
        return click.Option((*flag.split(), name), is_flag=True if kind is bool else None, **attributes)


def flag_of(name: str) -> str:
    """Return the flag for the name of a parameter."""
    return "-o" if name == "output" else "--" + re.sub("_(path|s)$", "", name).replace("_", "-")


def option(text: str | None, default: object = REQUIRED, kind: object = None, flag: str = "", **more: object) -> Any:
    """Declare an option; `kind` is click's type, `more` are other arguments of `click.Option`."""
    show = not (default is None or default is REQUIRED or isinstance(default, bool | tuple))
    return Declared(flag, {"help": text, "show_default": show, "type": kind, "default": default, **more})


def argument(metavar: str | None = None, default: object = REQUIRED, kind: object = None, **more: object) -> Any:
    """Declare an argument; `more` are other arguments of `click.Argument`."""
    return Declared(None, {"metavar": metavar, "type": kind, "default": default, **more})


def make_command(name: str, into: click.Group | None = None) -> Callable[[Function], click.Command]:
    """Return a decorator that converts a function to a command, and its docstring to help."""

    def decorate(function: Function) -> click.Command:
        def callback(**values: object) -> object:
            # A `functools.partial` reads a file here, not during parsing.
            read = {name: value() if isinstance(value, functools.partial) else value for name, value in values.items()}
            return _call(function, read)

        declared = click.Command(name, callback=callback, params=[*parameters(function), JSON], help=function.__doc__)
        if into is not None:
            into.add_command(declared)
        return declared

    return decorate


def parameters(function: Function) -> Iterator[click.Parameter]:
    """Yield click's options and arguments for a function's parameters."""
    hints = get_type_hints(function)
    for name, default in _defaults(function).items():
        if isinstance(default, Declared):
            yield default.parameter(name, hints[name])
        elif callable(default):
            yield from parameters(default)


def _call(function: Function, values: Mapping[str, object]) -> object:
    defaults = _defaults(function).items()
    return function(**{name: _call(group, values) if callable(group) else values[name] for name, group in defaults})


def _defaults(function: Function) -> dict[str, object]:
    signature = inspect.signature(function).parameters.items()
    return {name: None if parameter.default is REQUIRED else parameter.default for name, parameter in signature}
