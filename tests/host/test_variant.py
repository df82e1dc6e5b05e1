"""Which of Mitsuba's variants runs: chosen once, chosen again, and given back to a user who had another."""

import drjit
import mitsuba
import pytest
from lippmann.base.variant import current_device, start_mitsuba
from lippmann.base.variant import mitsuba as ours
from lippmann.errors import InputError


@pytest.fixture
def kept():
    """Set this worker's variant again at the end."""
    before = mitsuba.variant()
    yield
    mitsuba.set_variant(before or "llvm_ad_rgb")


def test_each_start_sets_the_variant_again(mi, kept):
    """Starting was remembered by device, so that a variant set in between stayed."""
    assert start_mitsuba("llvm") == "llvm"
    mitsuba.set_variant("scalar_rgb")
    assert start_mitsuba("llvm") == "llvm"
    assert mitsuba.variant() == "llvm_ad_rgb"
    assert current_device() == "llvm"


def test_another_variant_is_named(mi, kept):
    mitsuba.set_variant("scalar_rgb")
    with pytest.raises(InputError, match="variant is scalar_rgb"):
        ours()


def test_dr_jit_is_as_it_comes_while_the_variant_is_set(mi, kept, monkeypatch):
    syntax, set_variant, seen = drjit.syntax, mitsuba.set_variant, []
    monkeypatch.setattr(mitsuba, "set_variant", lambda name: seen.append(drjit.syntax) or set_variant(name))
    start_mitsuba("llvm")
    assert seen == [syntax]
