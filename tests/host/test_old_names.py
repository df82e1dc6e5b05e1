"""Old names of modules: an error names the new one, and the new one is there."""

import importlib
import re

import pytest
from lippmann.old_names import MOVED


@pytest.mark.parametrize("old", MOVED)
def test_an_old_module_names_the_new_one(old):
    with pytest.raises(ModuleNotFoundError, match=rf"'lippmann\.{old}' is gone; import from ") as caught:
        importlib.import_module(f"lippmann.{old}")
    for new in re.findall(r"lippmann\.[a-z_.]+", MOVED[old].partition(";")[0]):
        assert importlib.import_module(new)
    assert "\n" not in str(caught.value)


def test_other_modules_are_missing_as_ever():
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'lippmann.nothing'"):
        importlib.import_module("lippmann.nothing")
