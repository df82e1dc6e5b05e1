"""The frame of a command: a function whose parameters have their options and arguments as defaults.

The type of an option and its flag are those of the parameter, unless they are given: `scene_path` is --scene, `wait_s`
is --wait, `output` is -o. A parameter whose default is a function or class is a group of options: `board: Board =
_opened` has the options that `_opened` declares, and gets what it returns. A parameter of `_opened` that has no default
gets the value of the command's parameter of that name.
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
#: The path of a folder.
Folder = NewType("Folder", Path)


class Kind(click.ParamType[Any]):
    """A type of options: its form in help texts, and what reads a text or raises ValueError."""

    name = "kind"

    def __init__(self, form: str, read: Callable[[str], Any]) -> None:
        self.form, self.read = form, read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read a text; refuse it with what `read` says is wrong."""
        try:
            return self.read(value) if isinstance(value, str) else value
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form."""
        return self.form


def path_kind(form: str) -> Kind:
    """Return the type of a path, that of a FILE or a FOLDER."""

    def read(text: str) -> Path:
        if not text:
            raise ValueError(f"it is empty; name a {form.lower()}")
        return Path(text)

    return Kind(form, read)


#: Types of options by the types of their parameters, as far as click does not know them.
KINDS: dict[object, Kind] = {Path: path_kind("FILE"), Folder: path_kind("FOLDER")}
#: The option that each command has; see `lippmann.cli.output`.
JSON = click.Option(("--json", "as_json"), is_flag=True, help="One JSON object on stdout.")


class Choice(click.Choice[str]):
    """One of some values; a wrong one is answered with the likeliest."""

    def get_invalid_choice_message(self, value: object, ctx: click.Context | None) -> str:
        """Return what is wrong with a value, and the remedy."""
        return f"{super().get_invalid_choice_message(value, ctx)} {did_you_mean(str(value), map(str, self.choices))}"


@dataclass(frozen=True)
class Declared:
    """An option or argument: the flag (None: an argument; "": the parameter's name) and what click needs more."""

    flag: str | None
    attributes: Mapping[str, Any]

    def parameter(self, name: str, kind: object) -> click.Parameter:
        """Return click's parameter; `kind` is its type in Python."""
        if NoneType in get_args(kind):
            kind = get_args(kind)[0]
        attributes: dict[str, Any] = dict(self.attributes)
        if attributes["type"] is None:
            attributes["type"] = Choice(get_args(kind)) if get_origin(kind) is Literal else KINDS.get(kind, kind)
        # A text is mostly a file's name, and nothing else is known of it.
        if attributes["type"] is str or getattr(attributes["type"], "form", "") in ("FILE", "FOLDER"):
            attributes["shell_complete"] = lambda *_: [CompletionItem("", type="file")]
        if self.flag is None:
            return click.Argument((name,), **attributes)
        flag = self.flag or flag_of(name)
        return click.Option((flag, name), is_flag=True if kind is bool else None, **attributes)


def flag_of(name: str) -> str:
    """Return the flag of a parameter."""
    return "-o" if name == "output" else "--" + re.sub("_(path|s)$", "", name).replace("_", "-")


def option(
    help_text: str | None, default: object = REQUIRED, kind: object = None, flag: str = "", **others: object
) -> Any:
    """Declare an option; `kind` is click's type, `others` are further arguments of `click.Option`."""
    shown = not (default is None or default is REQUIRED or isinstance(default, bool | tuple))
    return Declared(flag, {"help": help_text, "show_default": shown, **_given(default, kind), **others})


def argument(metavar: str | None = None, default: object = REQUIRED, kind: object = None, **others: object) -> Any:
    """Declare an argument."""
    return Declared(None, {"metavar": metavar, **_given(default, kind), **others})


def _given(default: object, kind: object) -> dict[str, object]:
    return {"type": kind, "required": True} if default is REQUIRED else {"type": kind, "default": default}


def make_command(name: str, into: click.Group | None = None) -> Callable[[Function], click.Command]:
    """Return a decorator that makes a command, with --json, of a function; its docstring is the help."""

    def decorate(function: Function) -> click.Command:
        made = click.Command(
            name,
            callback=lambda **values: _call(function, {name: read_now(value) for name, value in values.items()}),
            params=[*parameters(function), JSON],
            help=function.__doc__,
        )
        if into is not None:
            into.add_command(made)
        return made

    return decorate


def read_now(value: Any) -> Any:
    """Return an option's value. Parsing reads no files: what reads one is a `functools.partial` until here."""
    return value() if isinstance(value, functools.partial) else value


def parameters(function: Function) -> Iterator[click.Parameter]:
    """Yield the options and arguments that a function declares, in the order of its parameters."""
    hints = get_type_hints(function)
    for name, default in _defaults(function).items():
        if isinstance(default, Declared):
            yield default.parameter(name, hints[name])
        elif callable(default):
            yield from parameters(default)


def _call(function: Function, values: Mapping[str, object]) -> object:
    """Call a function with the values of its options."""
    defaults = _defaults(function).items()
    return function(**{name: _call(given, values) if callable(given) else values[name] for name, given in defaults})


def _defaults(function: Function) -> dict[str, object]:
    """Return the default of each parameter; None for those without."""
    found = inspect.signature(function).parameters.items()
    return {name: None if parameter.default is REQUIRED else parameter.default for name, parameter in found}
