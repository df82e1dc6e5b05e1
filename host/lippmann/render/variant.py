"""Starts Mitsuba on the CPU (LLVM) or on an NVIDIA GPU (CUDA)."""

from __future__ import annotations

import functools
import signal
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
    # Python's exceptions end the process where they come up while these load: Ctrl-C waits.
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        import drjit as dr
        import mitsuba as mi
    except ImportError as error:
        raise MissingLibraryError(f"mitsuba cannot be imported ({error}); run make setup") from None
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)
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


def device_of(mi: Any) -> str:
    """Return "llvm" or "cuda", whichever variant runs."""
    variant: str = mi.variant()
    return variant.split("_", maxsplit=1)[0]
