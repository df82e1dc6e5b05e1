"""The fate of a ray."""

from __future__ import annotations

from enum import IntEnum

from lippmann.optics.backend import Arr


class Status(IntEnum):
    """What became of a ray; the same numbers in golden, fast, twin and RTL."""

    OK = 0
    MISSED = 1
    INTERNAL_REFLECTION = 2
    BLOCKED = 3
    CROSSTALK = 4


def gets_through(status: Arr) -> Arr:
    """Tell which rays leave the lenslets: ok and crosstalk. `status` is an array of any backend."""
    # Plain integers: Dr.Jit does not compare with an IntEnum.
    return (status == int(Status.OK)) | (status == int(Status.CROSSTALK))
