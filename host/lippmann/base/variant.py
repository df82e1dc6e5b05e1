"""Selects the CPU (LLVM) or an NVIDIA GPU (CUDA) for Mitsuba and Dr.Jit."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from types import ModuleType
from typing import Any, TypeAlias

from lippmann.base import interrupts
from lippmann.errors import InputError, MissingLibraryError, check_choice, missing_library

#: A value of Dr.Jit or Mitsuba, such as an array, whose type depends on the variant.
Jit: TypeAlias = Any

VARIANTS = {"llvm": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}


def check_device(device: str) -> None:
    """Raise InputError for an unknown device name."""
    check_choice("device", device, ("auto", *VARIANTS))


def available_device(device: str = "auto") -> str:
    """Return "llvm" or "cuda" for a device name; "auto" prefers a GPU.

    Raises InputError for an unknown device, and MissingLibraryError if Dr.Jit, libLLVM
    or the CUDA driver is missing.
    """
    check_device(device)
    try:
        import drjit as dr
    except ImportError as error:
        raise missing_library(error) from None
    if device == "auto":
        device = "cuda" if dr.has_backend(dr.JitBackend.CUDA) else "llvm"
    cuda = device == "cuda"
    if not dr.has_backend(dr.JitBackend.CUDA if cuda else dr.JitBackend.LLVM):
        needs = "an NVIDIA driver: use device llvm" if cuda else "a system libLLVM: install one, or run make setup"
        raise MissingLibraryError(f"device '{device}' is not available; it needs {needs}")
    return device


def start_mitsuba(device: str = "auto") -> str:
    """Set Mitsuba's variant for a device name, and return "llvm" or "cuda".

    A scene works only with the variant that was set when the scene was loaded. Raises
    the errors of `available_device`, and MissingLibraryError if Mitsuba is missing.
    """
    check_device(device)
    mi = _loaded()
    device = available_device(device)
    mi.set_variant(VARIANTS[device])
    mi.set_log_level(mi.LogLevel.Error)
    return device


@contextlib.contextmanager
def own_variant(device: str = "auto") -> Iterator[str]:
    """Run a block with a device's variant, then restore Mitsuba's variant and log level.

    Raises the errors of `start_mitsuba`.
    """
    mi = _loaded()
    variant = mi.variant()
    level = mi.log_level() if variant else None
    device = start_mitsuba(device)
    try:
        yield device
    finally:
        if variant:
            mi.set_variant(variant)
            mi.set_log_level(level)


def mitsuba() -> ModuleType:
    """Return the module `mitsuba`; if no variant is set, set the variant for "auto".

    Raises InputError for a variant outside `VARIANTS`; see also `start_mitsuba`.
    """
    mi = _loaded()
    variant = mi.variant()
    if variant is None:
        start_mitsuba()
    elif variant not in VARIANTS.values():
        what = f"Mitsuba's variant is {variant}; call mitsuba.set_variant with {' or '.join(VARIANTS.values())}"
        raise InputError(f"{what}, or call lippmann.render")
    return mi


class _Lazy:
    """A stand-in for a module that is imported at first use."""

    def __init__(self, load: Callable[[], ModuleType]) -> None:
        self._load = load

    def __getattr__(self, name: str) -> Jit:
        if name.startswith("__"):  # inspecting the object must not load the module
            raise AttributeError(name)
        return getattr(self._load(), name)


#: The modules `drjit` and `mitsuba`, imported at first use.
dr: Jit = _Lazy(lambda: import_module("drjit"))
mi: Jit = _Lazy(mitsuba)


def _loaded() -> ModuleType:
    loaded = sys.modules.get("mitsuba")
    if loaded is not None and hasattr(loaded, "variant"):  # another thread may be importing Mitsuba
        return loaded
    try:
        with interrupts.hold_signals():
            import mitsuba as mi
    except ImportError as error:
        raise missing_library(error) from None
    return mi


def current_device() -> str:
    """Return the device of Mitsuba's current variant, "llvm" or "cuda"."""
    variant: str = mitsuba().variant()
    return variant.split("_", maxsplit=1)[0]
