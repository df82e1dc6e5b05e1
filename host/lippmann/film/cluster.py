"""Renders shots across processes and machines, by Dask distributed.

The scheduler distributes the shots; when a worker is lost, its shots go to another. Workers read the scene from the
same path as this process, so the machines must share its folder.
"""

from __future__ import annotations

import functools
import itertools
import logging
import re
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from lippmann.errors import InputError, MissingLibraryError, device_error, input_error
from lippmann.film.shot import Shot, render_shot, versions
from lippmann.integral_image import IntegralImage
from lippmann.rendering.scene import digest_of
from lippmann.variant import start_mitsuba

#: Seconds in which the scheduler must answer, and a first worker must join.
ANSWER_S = 10.0
#: Seconds without any worker after which a message says so.
ALONE_S = 5.0
#: Shots submitted for each thread of the workers: one is rendered, one waits.
AHEAD = 2

#: The command that starts a scheduler on this machine alone.
SCHEDULER = "dask scheduler --host 127.0.0.1 --no-dashboard"

#: A worker renders one frame at a time on all cores, whatever its number of threads.
_rendering = threading.Lock()


def render_on_cluster(
    address: str, device: str, shots: Sequence[Shot], log: Any = lambda text: None
) -> Iterator[tuple[Shot, IntegralImage]]:
    """Render shots on the workers of a cluster; yield each with its image as it arrives.

    `address` is the scheduler's, such as tcp://127.0.0.1:8786; `device` each worker's, "auto", "llvm" or "cuda". The
    shots are distributed in their order. `log` is called with a message when no worker is left.

    Raises InputError when no scheduler answers at the address, no worker has joined, or a worker lacks the scene, has a
    different scene or different versions; DeviceError when the scheduler is lost, or a shot crashes several workers;
    MissingLibraryError when Dask is missing here, or Lippmann on a worker.
    """
    if not shots:
        return
    client = _connected(address)
    from distributed import KilledWorker, wait

    try:
        waiting = iter(shots)
        running: dict[Any, Shot] = {}
        alone = time.monotonic()
        while True:
            threads = sum(client.nthreads().values())
            room = max(1, AHEAD * threads) - len(running)
            for shot in itertools.islice(waiting, max(0, room)):
                running[client.submit(_rendered, shot, device, versions(), pure=False)] = shot
            if not running:
                return
            try:
                done = wait(list(running), timeout=1.0, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                done = ()
            for future in done:
                shot = running.pop(future)
                image = future.result()
                future.release()
                yield shot, image
            if threads:
                alone = time.monotonic()
            elif time.monotonic() - alone > ALONE_S:
                log(f"{address}: no worker is left; waiting for one ({_worker(address)})")
                alone = float("inf")
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"{address}: a worker lacks {error.name}; run its dask worker in an environment with Lippmann"
        ) from None
    except KilledWorker:
        what = f"frame {shot.frame} crashed several workers"
        raise device_error(address, what, "see their logs; they may lack memory") from None
    except (OSError, CancelledError) as error:  # of Dask's connections, and of waiting for them
        what = f"the scheduler is lost ({type(error).__name__})"
        remedy = "start it and run the command again: finished frames are kept"
        raise device_error(address, what, remedy) from None
    finally:
        client.close()


def _worker(address: str) -> str:
    """Return the command that starts a worker: on loopback when the scheduler is there, and without a web page."""
    loopback = re.search(r"//(127\.|localhost|\[::1\])", address)
    return f"dask worker {address}{' --host 127.0.0.1' if loopback else ''} --no-dashboard"


def _connected(address: str) -> Any:
    """Return a client of a cluster that has at least one worker."""
    try:
        import distributed
    except ImportError as error:
        raise MissingLibraryError(
            f"distributed cannot be imported ({error}); pip install 'lippmann[cluster]'"
        ) from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # our errors say the same in a line
    try:
        client = distributed.Client(address, timeout=ANSWER_S)
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


def _rendered(shot: Shot, device: str, wanted: dict[str, str]) -> IntegralImage:
    """Render a shot, on a worker."""
    from distributed import get_worker

    name = f"worker {get_worker().address}"
    if versions() != wanted:
        theirs = ", ".join(f"{key} {value}" for key, value in versions().items())
        ours = ", ".join(f"{key} {value}" for key, value in wanted.items())
        raise input_error(name, f"has {theirs}, asked for {ours}", "install the same versions everywhere")
    with _rendering:
        start_mitsuba(device)
        _check_scene(name, shot.film.scene, shot.digest)
        return render_shot(shot)


@functools.lru_cache(maxsize=8)
def _check_scene(worker: str, path: Path, digest: str) -> None:
    """Refuse a scene that is missing or different on a worker's machine."""
    try:
        own = digest_of(path)
    except InputError as error:
        raise InputError(f"{worker}: {error}; a cluster's machines must share the scene's folder") from None
    if own != digest:
        raise input_error(worker, f"{path} differs there", "share the scene's folder between the cluster's machines")
