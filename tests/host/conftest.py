"""Fixtures that several tests share: Mitsuba started once a worker."""

import pytest
from lippmann.rendering.variant import start_mitsuba


@pytest.fixture(scope="session")
def mi():
    """Mitsuba on the CPU, whatever else the machine has."""
    return start_mitsuba("llvm")
