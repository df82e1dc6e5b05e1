"""Fixtures that several tests share: Mitsuba started once a worker."""

import pytest
from lippmann.variant import mitsuba, start_mitsuba


@pytest.fixture(scope="session")
def mi():
    """Mitsuba on the CPU, whatever else the machine has."""
    start_mitsuba("llvm")
    return mitsuba()
