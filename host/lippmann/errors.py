"""What can go wrong, and the exit code that each kind of failure has on the command line."""

from __future__ import annotations


class LippmannError(Exception):
    """Base of all errors that a user can mend; its message is one line: what, where, how to mend."""

    exit_code = 2


class DeviceError(LippmannError):
    """A board or a line failed."""

    exit_code = 1


class NoBoardError(DeviceError):
    """No board answers, perhaps only for a while: no port, a lost line, or silence."""


class InputError(LippmannError):
    """A file, a key or an argument is wrong."""

    exit_code = 2


class MissingLibraryError(LippmannError):
    """The machine lacks something that the work needs."""

    exit_code = 3


def input_error(where: str, what: str, remedy: str) -> InputError:
    """Return the error `where: what; remedy`, folded into one line."""
    return InputError(" ".join(f"{where}: {what}; {remedy}".split()))


def device_error(where: str, what: str, remedy: str) -> DeviceError:
    """Return the error `where: what; remedy`, folded into one line."""
    return DeviceError(" ".join(f"{where}: {what}; {remedy}".split()))


def no_board_error(where: str, what: str, remedy: str) -> NoBoardError:
    """Return the error `where: what; remedy`, folded into one line."""
    return NoBoardError(" ".join(f"{where}: {what}; {remedy}".split()))
