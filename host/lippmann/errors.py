"""Errors, and the exit code of each kind on the command line."""

from __future__ import annotations

from typing import Self


class LippmannError(Exception):
    """Base of all errors that a user can correct; its message is one line: what is wrong, where, and the remedy."""

    exit_code = 2

    @classmethod
    def at(cls, where: str, what: str, remedy: str) -> Self:
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


#: The errors whose line says where, what and the remedy.
input_error, device_error, no_board_error = InputError.at, DeviceError.at, NoBoardError.at
