"""The fate of a ray."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """What became of a ray; the same numbers in golden, fast, twin and RTL."""

    OK = 0
    MISSED = 1
    INTERNAL_REFLECTION = 2
    BLOCKED = 3
    CROSSTALK = 4
