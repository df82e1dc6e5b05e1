"""Renders the frames of a film, or the bands of a picture, across processes and machines, by Dask distributed.

The scheduler distributes them; when a worker is lost, what it had goes to another. Workers read the scene from the
same path as this process, so the machines must share its folder.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import re
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Protocol, TypeVar

from lippmann.base import interrupts
from lippmann.base.programs import starting_python
from lippmann.base.provenance import pixel_versions
from lippmann.base.variant import start_mitsuba
from lippmann.errors import InputError, MissingLibraryError, device_error, input_error, missing_library
from lippmann.rendering.recorded import garbage_kept
from lippmann.scenes.scene import digest_of

#: Seconds in which the scheduler must answer, and a first worker must join.
ANSWER_S = 10.0
#: Seconds without any worker after which a message says so.
ALONE_S = 5.0
#: Tasks submitted for each thread of the workers: one is rendered, one waits.
AHEAD = 2

#: The command that starts a scheduler on this machine alone.
SCHEDULER = "dask scheduler --host 127.0.0.1 --no-dashboard"

#: A worker renders one task at a time on all cores, whatever its number of threads.
_rendering = threading.Lock()


class Task(Protocol):
    """What a worker renders; its text names it in messages."""

    @property
    def scene(self) -> Path:
        """The scene's file."""

    @property
    def digest(self) -> str:
        """Its `digest_of`."""

    def render(self) -> Any:
        """Render it."""


Tasks = TypeVar("Tasks", bound=Task)


def render_on_cluster(
    address: str, device: str, tasks: Sequence[Tasks], log: Any = lambda text: None, security: Any = None
) -> Iterator[tuple[Tasks, Any]]:
    """Render tasks on the workers of a cluster; yield each with what it renders as it arrives.

    `address` is the scheduler's, such as tcp://127.0.0.1:8786; `device` each worker's, "auto", "llvm" or "cuda". The
    tasks are distributed in their order. `log` is called with a message when no worker is left. `security` is what the
    scheduler's connections need (`distributed.Security`), where the workers are this command's own (`local_workers`).

    Raises InputError when no scheduler answers at the address, no worker has joined, or a worker lacks the scene, has a
    different scene or different versions; DeviceError when the scheduler is lost, or a task crashes several workers;
    MissingLibraryError when Dask is missing here, or Lippmann on a worker.
    """
    if not tasks:
        return
    client = _connected(address, security)
    from distributed import KilledWorker, wait

    own = security is not None
    where = "--workers" if own else address

    try:
        waiting = iter(tasks)
        running: dict[Any, Tasks] = {}
        alone = time.monotonic()
        while True:
            threads = sum(client.nthreads().values())
            room = max(1, AHEAD * threads) - len(running)
            for task in itertools.islice(waiting, max(0, room)):
                running[client.submit(_rendered, task, device, pixel_versions(), pure=False)] = task
            if not running:
                return
            try:
                done = wait(list(running), timeout=1.0, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                done = ()
            for future in done:
                task = running.pop(future)
                rendered = future.result()
                future.release()
                yield task, rendered
            if threads:
                alone = time.monotonic()
            elif time.monotonic() - alone > ALONE_S:
                remedy = "" if own else f" ({_worker(address)})"
                log(f"{where}: no worker is left; waiting for one{remedy}")
                alone = float("inf")
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"{address}: a worker lacks {error.name}; run its dask worker in an environment with Lippmann"
        ) from None
    except KilledWorker:
        remedy = f"{'' if own else 'see their logs; '}they may lack memory{': give fewer of them' if own else ''}"
        raise device_error(where, f"{task} crashed several workers", remedy) from None
    except (OSError, CancelledError) as error:  # of Dask's connections, and of waiting for them
        what = f"the scheduler is lost ({type(error).__name__})"
        remedy = "start it and run the command again: what is finished is kept"
        raise device_error(address, what, remedy) from None
    finally:
        client.close()


def check_scheduler(address: str) -> None:
    """Raise the errors of `render_on_cluster` where no scheduler with a worker answers, before more is done."""
    _connected(address).close()


@contextlib.contextmanager
def local_workers(count: int) -> Iterator[tuple[str, Any]]:
    """Start workers on this machine, on loopback alone; yield their scheduler's address and its `Security`.

    They talk by TLS with a key that only these processes have: who reaches a port of Dask's may run programs. They run
    no Python file of the current folder. A worker that dies is replaced. None has a limit of memory: with one, Dask
    has those wait for ever that hold nearly their share. MissingLibraryError when Dask is missing.
    """
    try:
        import dask
        from distributed import LocalCluster, Security

        security = Security.temporary()
    except ImportError as error:
        raise missing_library(error) from None
    with contextlib.ExitStack() as end:
        end.enter_context(starting_python())
        end.enter_context(
            dask.config.set({"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []})
        )
        # Of a signal to all processes of a terminal, this one ends the workers; they inherit what is blocked here.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, interrupts.ENDING)
        try:
            resource_tracker.ensure_running()  # which unblocks some, so now and not between
            signal.pthread_sigmask(signal.SIG_BLOCK, interrupts.ENDING)
            cluster = LocalCluster(
                n_workers=count, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, security=security,
                memory_limit=0, scheduler_kwargs={"dashboard_address": "127.0.0.1:0"}, silence_logs=logging.CRITICAL,
            )  # fmt: skip
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        end.enter_context(cluster)
        yield cluster.scheduler_address, security


def _worker(address: str) -> str:
    """Return the command that starts a worker: on loopback when the scheduler is there, and without a web page."""
    loopback = re.search(r"//(127\.|localhost|\[::1\])", address)
    return f"dask worker {address}{' --host 127.0.0.1' if loopback else ''} --no-dashboard"


def _connected(address: str, security: Any = None) -> Any:
    """Return a client of a cluster that has at least one worker."""
    try:
        import distributed
    except ImportError as error:
        raise missing_library(error) from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # our errors say the same in a line
    try:
        client = distributed.Client(address, timeout=ANSWER_S, security=security)
    except (OSError, ValueError, TypeError):
        raise input_error(
            address, "no scheduler answers there", f"start one ({SCHEDULER}), or give its address, tcp://HOST:8786"
        ) from None
    try:
        client.wait_for_workers(1, timeout=ANSWER_S)
    except TimeoutError:
        client.close()
        raise input_error(address, "no worker has joined the scheduler", f"start one: {_worker(address)}") from None
    return client


def _rendered(task: Task, device: str, wanted: dict[str, str]) -> Any:
    """Render a task, on a worker."""
    from distributed import get_worker

    name = f"worker {get_worker().address}"
    if pixel_versions() != wanted:
        theirs = ", ".join(f"{key} {value}" for key, value in pixel_versions().items())
        ours = ", ".join(f"{key} {value}" for key, value in wanted.items())
        raise input_error(name, f"has {theirs}, asked for {ours}", "install the same Lippmann everywhere")
    # Garbage that another thread collects meanwhile may be Dr.Jit's, whose lock this one holds.
    with _rendering, garbage_kept():
        start_mitsuba(device)
        _check_scene(name, task.scene, task.digest)
        return task.render()


@functools.lru_cache(maxsize=8)
def _check_scene(worker: str, path: Path, digest: str) -> None:
    """Refuse a scene that is missing or different on a worker's machine."""
    try:
        own = digest_of(path)
    except InputError as error:
        raise InputError(f"{worker}: {error}; a cluster's machines must share the scene's folder") from None
    if own != digest:
        raise input_error(worker, f"{path} differs there", "share the scene's folder between the cluster's machines")
