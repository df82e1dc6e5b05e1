"""Processes that share a measurement, and end with the one that started them, however that ends."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context, parent_process

from lippmann.base.programs import starting_python


@contextlib.contextmanager
def processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Yield `jobs` processes; an exception in the block, Ctrl-C too, ends them at once."""
    others = set(active_children())
    with starting_python():
        pool = ProcessPoolExecutor(jobs, get_context("spawn"), _end_with_parent)
        try:
            yield pool
        except BaseException:
            for one in set(active_children()) - others:
                one.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Have this process end when the one that started it has, by kill -9 too: its queue would never end."""
    threading.Thread(target=_wait, daemon=True).start()


def _wait() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
