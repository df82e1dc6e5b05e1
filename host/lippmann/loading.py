"""Loads libraries in less time: without the work that Python and Mitsuba do meanwhile for nothing."""

from __future__ import annotations

import contextlib
import functools
import gc
from collections.abc import Callable, Iterator
from typing import Any


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """Let Python look for no cycles meanwhile: what modules declare stays, and each look passes all of it."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextlib.contextmanager
def late_syntax(dr: Any) -> Iterator[None]:
    """Have functions that are declared meanwhile with `drjit.syntax` rewritten at their first call, not at once.

    Mitsuba declares its differentiable integrators anew with each variant, and hardly any is ever called.
    """
    at_once = dr.syntax

    def late(function: Callable[..., Any] | None = None, **options: Any) -> Any:
        if function is None:
            return functools.partial(late, **options)
        rewritten = functools.cache(lambda: at_once(function, **options))

        @functools.wraps(function)
        def call(*values: Any, **named: Any) -> Any:
            return rewritten()(*values, **named)

        return call

    dr.syntax = late
    try:
        yield
    finally:
        dr.syntax = at_once
