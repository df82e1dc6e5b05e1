"""Errors, and the exit code of each kind on the command line."""

from __future__ import annotations


class LippmannError(Exception):
    """Base of all errors that a user can correct; its message is one line: what is wrong, where, and the remedy."""

    exit_code = 2


class DeviceError(LippmannError):
    """A board or its connection failed."""

    exit_code = 1


class NoBoardError(DeviceError):
    """No board answers, perhaps only for a while: no port, a lost connection, or no reply."""


class InputError(LippmannError):
    """A file, a key or an argument is wrong."""

    exit_code = 2


class MissingLibraryError(LippmannError):
    """A library, a program or memory is missing on this machine."""

    exit_code = 3


def input_error(where: str, what: str, remedy: str) -> InputError:
    """Return the error `where: what; remedy` on one line."""
    return InputError(" ".join(f"{where}: {what}; {remedy}".split()))


def device_error(where: str, what: str, remedy: str) -> DeviceError:
    """Return the error `where: what; remedy` on one line."""
    return DeviceError(" ".join(f"{where}: {what}; {remedy}".split()))


def no_board_error(where: str, what: str, remedy: str) -> NoBoardError:
    """Return the error `where: what; remedy` on one line."""
    return NoBoardError(" ".join(f"{where}: {what}; {remedy}".split()))
