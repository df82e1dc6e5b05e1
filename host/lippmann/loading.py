"""Starts Mitsuba in less time."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from typing import Any


@contextlib.contextmanager
def late_syntax(dr: Any) -> Iterator[None]:
    """Inside the block `@drjit.syntax` rewrites a function at its first call, not at its definition.

    Mitsuba defines its differentiable integrators with each variant, and hardly any is ever called.
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
