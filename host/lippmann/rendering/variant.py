"""Starts Mitsuba on the CPU (LLVM) or on an NVIDIA GPU (CUDA)."""

from __future__ import annotations

import contextlib
import functools
import signal
import threading
from collections.abc import Iterator
from typing import Any

from lippmann.errors import InputError, MissingLibraryError

VARIANTS = {"llvm": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}


@functools.cache
def start_mitsuba(device: str = "auto") -> Any:
    """Return the module `mitsuba` with a variant set for a device: "llvm", "cuda", or "auto".

    "auto" takes the GPU when there is one.

    Raises
    ------
    InputError
        For an unknown device.
    MissingLibraryError
        When Mitsuba, or the libLLVM or CUDA driver that it needs, cannot be loaded.
    """
    if device not in ("auto", *VARIANTS):
        raise InputError(f"unknown device '{device}'; choose from auto, {', '.join(VARIANTS)}")
    try:
        with interrupts_held():
            import drjit as dr
            import mitsuba as mi
    except ImportError as error:
        raise MissingLibraryError(f"mitsuba cannot be imported ({error}); run make setup") from None
    if device == "auto":
        device = "cuda" if dr.has_backend(dr.JitBackend.CUDA) else "llvm"
    backend = {"llvm": dr.JitBackend.LLVM, "cuda": dr.JitBackend.CUDA}[device]
    if not dr.has_backend(backend):
        needs = {
            "llvm": "a system libLLVM: run make setup",
            "cuda": "an NVIDIA driver: use --device llvm",
        }
        raise MissingLibraryError(f"device '{device}' is not to be had here; it needs {needs[device]}")
    mi.set_variant(VARIANTS[device])
    mi.set_log_level(mi.LogLevel.Error)
    return mi


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait until the block ends: where C++ loads, Python's exceptions end the process.

    To block the signal would not do: other libraries' threads take it, and Python answers in this one.
    """
    before = signal.getsignal(signal.SIGINT)
    # Only the main thread has handlers, and those that are not Python's cannot be put back.
    if threading.current_thread() is not threading.main_thread() or before is None:
        yield
        return
    held: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: held.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if held:
            signal.raise_signal(signal.SIGINT)


def device_of(mi: Any) -> str:
    """Return "llvm" or "cuda", whichever variant runs."""
    variant: str = mi.variant()
    return variant.split("_", maxsplit=1)[0]
