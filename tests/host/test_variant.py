"""Which of Mitsuba's variants runs: chosen once, chosen again, and given back to a user who had another."""

import drjit
import mitsuba
import pytest
from lippmann.base.variant import current_device, late_syntax, own_variant, start_mitsuba
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


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_spectral", "llvm_ad_rgb"])
def test_a_users_variant_and_log_level_come_back(mi, kept, variant):
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Warn)
    with own_variant("llvm") as device:
        assert device == "llvm"
        assert ours().variant() == "llvm_ad_rgb"
        assert mitsuba.log_level() == mitsuba.LogLevel.Error
    assert mitsuba.variant() == variant
    assert mitsuba.log_level() == mitsuba.LogLevel.Warn


def test_a_users_variant_comes_back_after_an_error(mi, kept):
    mitsuba.set_variant("scalar_rgb")
    with pytest.raises(ZeroDivisionError), own_variant("llvm"):
        raise ZeroDivisionError
    assert mitsuba.variant() == "scalar_rgb"


def test_another_variant_is_named(mi, kept):
    mitsuba.set_variant("scalar_rgb")
    with pytest.raises(InputError, match="variant is scalar_rgb"):
        ours()


def test_declared_functions_are_rewritten_when_they_are_called(mi, monkeypatch):
    """Mitsuba's integrators are declared with each variant. As written, Python would refuse an array as a condition."""
    rewritten = []
    at_once = drjit.syntax
    monkeypatch.setattr(drjit, "syntax", lambda function, **options: rewritten.append(options) or at_once(function))
    ours = drjit.syntax
    with late_syntax(drjit):

        @drjit.syntax
        def halvings(x):
            count = x - x
            while x > 1:
                x //= 2
                count += 1
            return count

        @drjit.syntax(recursive=True)
        def same(x):
            return x

    assert drjit.syntax is ours
    assert rewritten == []
    assert list(halvings(mi.UInt32([1, 2, 7, 8]))) == [0, 1, 2, 3]
    assert list(halvings(mi.UInt32([16]))) == [4]
    assert rewritten == [{}]
    assert list(same(mi.UInt32([3]))) == [3]
    assert rewritten == [{}, {"recursive": True}]


def test_mitsuba_s_integrators_run_when_they_are_asked_for(mi, kept):
    mitsuba.set_variant("scalar_rgb")
    start_mitsuba("llvm")
    integrator = mitsuba.load_dict({"type": "prb", "max_depth": 2})
    assert hasattr(type(integrator).sample, "__wrapped__")
    lit = {"type": "scene", "light": {"type": "constant", "radiance": 0.25}}
    scene = mitsuba.load_dict(
        {**lit, "camera": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}}
    )
    picture = mitsuba.render(scene, integrator=integrator, spp=4)
    assert float(abs(drjit.max(drjit.abs(picture.array - 0.25)).array[0])) < 1e-6
