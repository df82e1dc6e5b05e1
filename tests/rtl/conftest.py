"""Fixtures of the tests that stream words: their seed, their random words, and the situations that they must see."""

import re

import numpy as np
import pytest
import runner
from rtl_coverage import Coverage


@pytest.fixture
def seed():
    """The seed of this test."""
    return runner.seed()


@pytest.fixture
def rng(seed):
    """Random numbers of this test's seed."""
    return np.random.default_rng(seed)


@pytest.fixture
def seen(request):
    """The situations of the module that the test's folder is named after."""
    return Coverage(request.path.parent.name, re.sub(r"[^\w.]+", "-", request.node.name).strip("-"))


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """Close `seen` behind a test that has passed, as the last of its checks."""
    result = yield
    if "seen" in pyfuncitem.fixturenames:
        pyfuncitem.funcargs["seen"].close()
    return result
