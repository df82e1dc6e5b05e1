"""Error classes with their exit codes, and checks of arguments."""

from __future__ import annotations

import difflib
import math
import re
import sys
import warnings
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from numbers import Integral, Real
from pathlib import Path
from typing import Self

#: Control characters, and characters that change the text direction.
CONTROLS = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069\\ud800-\\udfff]")


class LippmannError(Exception):
    """Base class of errors that a user can correct; the message gives place, fault and remedy."""

    exit_code = 2

    @classmethod
    def at(cls, where: object, what: str, remedy: str) -> Self:
        """Return the error with the one-line message `where: what; remedy`."""
        return cls(" ".join(f"{where}: {what}; {remedy}".split()))


class DeviceError(LippmannError):
    """A board or its connection failed."""

    exit_code = 1


class NoBoardError(DeviceError):
    """No board answers: no port, a lost connection, or no reply. A retry may succeed."""


class InputError(LippmannError):
    """A file, a key or an argument is wrong."""


class MissingLibraryError(LippmannError):
    """A library, program or device is missing on this machine or a worker."""

    exit_code = 3


class NoSpaceError(LippmannError):
    """A disk or the user's quota is full."""

    exit_code = 3


class LippmannWarning(UserWarning):
    """Warning that a valid result may be unwanted; the command line prints "note: text"."""


def warn_user(text: str) -> None:
    """Issue a LippmannWarning at the line of the user's program that called Lippmann."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "lippmann":
        level, frame = level + 1, frame.f_back
    warnings.warn(text, LippmannWarning, stacklevel=level)


#: Functions that return an error with the message `where: what; remedy`.
input_error, device_error, no_board_error = InputError.at, DeviceError.at, NoBoardError.at


def reason(error: Exception) -> str:
    """Return the cause of a failed read as text, without errno and path."""
    if isinstance(error, UnicodeDecodeError):
        return "it is not text in UTF-8"
    if "pickle" in str(error):  # numpy does not load Python objects
        return "it contains no array of numbers"
    return str((isinstance(error, OSError) and error.strerror) or error)


@contextmanager
def located(where: object) -> Iterator[None]:
    """Put "where: " before the message of an InputError that a block raises."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def path_of(value: object, what: str) -> Path:
    """Return an argument as a path; refuse other types. `what` names the kind of file."""
    if not isinstance(value, str | Path):
        raise InputError(f"{str(value)[:80]!r} is not {what}; give its path")
    if not str(value) or "\0" in str(value):
        raise InputError(f"{str(value)!r} is not a path; give the path of {what}")
    return Path(value)


#: Modules of each optional extra in pyproject.toml, keyed by extra.
EXTRA_MODULES = {
    "render": ("mitsuba", "drjit", "OpenImageIO", "trimesh", "plyfile", "imageio_ffmpeg"),
    "board": ("serial", "cobs", "qoi"),
    "calibrate": ("cv2",),
    "live": ("pygame",),
    "cluster": ("distributed", "dask", "cryptography"),
}


def to_install(extra: str = "") -> str:
    """Return the remedy for a missing package: `make setup` in a checkout, else `pip install`."""
    top = Path(__file__).resolve().parents[2]
    if (top / "Makefile").is_file() and (top / "pyproject.toml").is_file():
        return "run make setup"
    return f"run pip install 'lippmann[{extra}]'" if extra else "run pip install --upgrade lippmann"


def missing_library(error: ImportError, extra: str = "") -> MissingLibraryError:
    """Return the error for a failed import, with the command that installs the library."""
    module = (error.name or "").partition(".")[0]
    extra = extra or "".join(name for name, modules in EXTRA_MODULES.items() if module in modules)
    what = f"{module} cannot be imported ({error})" if module else str(error)
    return MissingLibraryError(f"{what}; {to_install(extra)}")


def whole_number(name: str, value: object, low: int, high: int) -> int:
    """Return a whole number from `low` to `high` as an int; refuse other values."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise InputError(f"{name} {value!r} is not a whole number; give {low} to {high}")
    if not low <= int(value) <= high:
        raise InputError(f"{name} {value} is out of range; give {low} to {high}")
    return int(value)


def as_number(value: object) -> float:
    """Return a real number as a float; return NaN for any other value."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    is_huge = isinstance(value, int) and value.bit_length() > 1023
    return math.inf if is_huge else float(value)


def check_type(name: str, value: object, kinds: type | tuple[type, ...], what: str) -> None:
    """Refuse an argument whose type is not in `kinds`; `what` names these types."""
    if not isinstance(value, kinds):
        raise InputError(f"{name} must be {what}, not {str(value)[:80]!r}")


def check_flags(**flags: object) -> None:
    """Refuse each argument that is not a bool, of Python or NumPy."""
    for name, value in flags.items():
        if type(value).__name__ not in ("bool", "bool_"):
            raise InputError(f"{name} must be True or False, not {str(value)[:80]!r}")


def check_choice(name: str, value: object, choices: Collection[str]) -> None:
    """Refuse an argument that is not one of `choices`."""
    if not (isinstance(value, str) and value in choices):
        raise InputError(f"unknown {name} '{value}'; choose from {', '.join(choices)}")


def did_you_mean(name: str, choices: Iterable[str]) -> str:
    """Return a remedy with the most similar choice, or "" if none is similar."""
    names = {one.casefold(): one for one in choices}
    matches = difflib.get_close_matches(name.casefold(), names, 1)
    return "".join(f"did you mean {names[likely]}?" for likely in matches)


def likely_file(path: Path, suffixes: Iterable[str]) -> str:
    """Return a remedy with the most similar file of a folder, or "" if none is similar."""
    others = sorted(path.parent.glob("*"))
    files = {one.stem: one for one in others if one.suffix.lower() in suffixes and one.is_file()}
    matches = difflib.get_close_matches(path.stem, files, 1)
    return "".join(f"did you mean {files[likely]}?" for likely in matches)


def not_there(path: Path, what: str = "file") -> str:
    """Return why a path is not a readable file."""
    if path.is_dir():
        return "is a folder"
    return "is not a plain file" if path.exists() else f"no such {what}"


def printable(text: str) -> str:
    """Escape the `CONTROLS` in a text for the terminal."""
    return CONTROLS.sub(lambda match: match[0].encode("unicode_escape").decode(), text)
