"""Errors, and the exit code of each kind on the command line."""

from __future__ import annotations

import difflib
import re
import sys
import warnings
from collections.abc import Iterable
from numbers import Integral
from pathlib import Path
from typing import Self

#: What a terminal would obey instead of show: control characters, and those that turn the direction of writing.
OBEYED = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069\\ud800-\\udfff]")


class LippmannError(Exception):
    """Base of all errors that a user can correct; its message is one line: what is wrong, where, and the remedy."""

    exit_code = 2

    @classmethod
    def at(cls, where: object, what: str, remedy: str) -> Self:
        """Return the error `where: what; remedy` on one line."""
        return cls(" ".join(f"{where}: {what}; {remedy}".split()))


class DeviceError(LippmannError):
    """A board or its connection failed."""

    exit_code = 1


class NoBoardError(DeviceError):
    """No board answers, perhaps only for a while: no port, a lost connection, or no reply."""


class InputError(LippmannError):
    """A file, a key or an argument is wrong."""


class MissingLibraryError(LippmannError):
    """A library, a program or memory is missing on this machine."""

    exit_code = 3


class NoSpaceError(LippmannError):
    """A disk is full, or the user's share of it."""

    exit_code = 3


class LippmannWarning(UserWarning):
    """A remark on a result that is valid but may not be what the user wants: `warnings.warn(text, LippmannWarning)`.

    The command line shows it on stderr as "note: text". What a command does by itself goes to
    `logging.getLogger("lippmann")` instead, at level INFO, and is shown as it is.
    """


def warn_user(text: str) -> None:
    """Give a LippmannWarning that points at the line of the user's program that called Lippmann."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "lippmann":
        level, frame = level + 1, frame.f_back
    warnings.warn(text, LippmannWarning, stacklevel=level)


#: The errors whose line says where, what and the remedy.

input_error, device_error, no_board_error = InputError.at, DeviceError.at, NoBoardError.at


def reason(error: Exception) -> str:
    """Return why a file could not be read, in words: the system's, without its number and the path."""
    if isinstance(error, UnicodeDecodeError):
        return "it is not text in UTF-8"
    if "pickle" in str(error):  # numpy's word for Python's own objects
        return "it holds no array of numbers"
    return str((isinstance(error, OSError) and error.strerror) or error)


def path_of(value: object, what: str) -> Path:
    """Return a path that Python code gave; refuse what is none. `what` says of which file."""
    if not isinstance(value, str | Path):
        raise InputError(f"{str(value)[:80]!r} is not {what}; give its path")
    return Path(value)


#: The modules that each extra of the package brings (pyproject.toml); the others come with the package itself.
EXTRA_MODULES = {
    "render": ("mitsuba", "drjit", "OpenImageIO", "trimesh", "plyfile", "imageio_ffmpeg"),
    "board": ("serial", "cobs", "qoi"),
    "calibrate": ("cv2",),
    "live": ("pygame",),
    "cluster": ("distributed", "dask", "cryptography"),
}


def to_install(extra: str = "") -> str:
    """Return the remedy for a missing package, or one of an extra: make in a checkout, pip elsewhere."""
    top = Path(__file__).resolve().parents[2]
    if (top / "Makefile").is_file() and (top / "pyproject.toml").is_file():
        return "run make setup"
    return f"run pip install 'lippmann[{extra}]'" if extra else "run pip install --upgrade lippmann"


def missing_library(error: ImportError) -> MissingLibraryError:
    """Return the error of a library that cannot be imported, with the command that installs it."""
    module = (error.name or "").partition(".")[0]
    extra = "".join(name for name, modules in EXTRA_MODULES.items() if module in modules)
    what = f"{module} cannot be imported ({error})" if module else str(error)
    return MissingLibraryError(f"{what}; {to_install(extra)}")


def whole_number(name: str, value: object, low: int, high: int) -> int:
    """Return a value as an int; refuse what is not a whole number from `low` to `high`."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise InputError(f"{name} {value!r} is not a whole number; give {low} to {high}")
    if not low <= int(value) <= high:
        raise InputError(f"{name} {value} is out of range; give {low} to {high}")
    return int(value)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the remedy that names the likeliest of the known names, or an empty text."""
    names = {one.casefold(): one for one in known}
    return "".join(f"did you mean {names[likely]}?" for likely in difflib.get_close_matches(name.casefold(), names, 1))


def likely_file(path: Path, suffixes: Iterable[str]) -> str:
    """Return the remedy that names the likeliest file in a missing file's folder, or an empty text."""
    files = {one.stem: one for one in sorted(path.parent.glob("*")) if one.suffix.lower() in suffixes and one.is_file()}
    return "".join(f"did you mean {files[likely]}?" for likely in difflib.get_close_matches(path.stem, files, 1))


def not_there(path: Path, what: str = "file") -> str:
    """Return in words why a path is no file that can be read: it is not there, or something else is."""
    if path.is_dir():
        return "is a folder"
    return "is not a plain file" if path.exists() else f"no such {what}"


def printable(text: str) -> str:
    """Return a text for the terminal: what files and names bring that it would obey is shown escaped."""
    return OBEYED.sub(lambda match: match[0].encode("unicode_escape").decode(), text)
