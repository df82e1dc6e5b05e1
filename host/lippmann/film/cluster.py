"""Renders shots across processes and machines, by Dask distributed.

The scheduler hands out shots and keeps track; whatever a worker had in hand when it is lost goes to another. Workers
read the scene from the same path as this process: the machines share its folder.
"""

from __future__ import annotations

import functools
import itertools
import logging
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from importlib import metadata
from pathlib import Path
from typing import Any

from lippmann import __version__
from lippmann.errors import InputError, MissingLibraryError, device_error, input_error
from lippmann.film.shot import Shot, render_shot
from lippmann.images import Image
from lippmann.rendering.scene import digest_of
from lippmann.variant import start_mitsuba

#: Seconds in which the scheduler must answer, and a first worker join.
ANSWER_S = 10.0
#: Seconds after which a film without any worker says so.
ALONE_S = 5.0
#: Shots in hand for each thread of the workers: one to render, one to follow.
AHEAD = 2

#: A worker renders one frame at a time, with all of its processor's cores, however many threads it has.
_rendering = threading.Lock()


def versions() -> dict[str, str]:
    """Return the versions that pixels depend on."""
    return {"lippmann": __version__, **{name: metadata.version(name) for name in ("mitsuba", "drjit")}}


def render_on_cluster(
    address: str, device: str, shots: Sequence[Shot], log: Any = lambda text: None
) -> Iterator[tuple[Shot, Image, dict[str, str]]]:
    """Render shots on the workers of a cluster, and give each as it comes, with radiance and what its file carries.

    Parameters
    ----------
    address
        The scheduler's, such as tcp://127.0.0.1:8786.
    device
        "auto", "llvm" or "cuda": where each worker renders.
    shots
        In the order in which they are handed out.
    log
        Told when no worker is left.

    Raises
    ------
    InputError
        When nobody answers at the address, no worker has joined, one cannot read the scene or has another, or has other
        versions.
    DeviceError
        When the scheduler is lost, or a shot ends one worker after the other.
    MissingLibraryError
        When Dask is missing here, or Lippmann on a worker.
    """
    if not shots:
        return
    client = _connected(address)
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
            for future in _finished(list(running)):
                shot = running.pop(future)
                radiance, carried = _result(address, future, shot)
                future.release()
                yield shot, radiance, carried
            if threads:
                alone = time.monotonic()
            elif time.monotonic() - alone > ALONE_S:
                log(f"{address}: no worker is left; waiting for one (dask worker {address})")
                alone = float("inf")
    except (OSError, CancelledError) as error:  # what Dask's lines raise, and what waits on them
        what = f"the scheduler is lost ({type(error).__name__})"
        remedy = "start it and say the same again: frames that are there are kept"
        raise device_error(address, what, remedy) from None
    finally:
        client.close()


def _connected(address: str) -> Any:
    """Return a client of the cluster, with a worker at least."""
    try:
        import distributed
    except ImportError as error:
        raise MissingLibraryError(
            f"distributed cannot be imported ({error}); pip install 'lippmann[cluster]'"
        ) from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # we say in a line what they say in pages
    try:
        client = distributed.Client(address, timeout=ANSWER_S)
    except (OSError, ValueError, TypeError):
        raise input_error(
            address, "no scheduler answers there", "start one (dask scheduler), or give its address, tcp://HOST:8786"
        ) from None
    try:
        client.wait_for_workers(1, timeout=ANSWER_S)
    except TimeoutError:
        client.close()
        raise input_error(address, "no worker has joined the scheduler", f"start one: dask worker {address}") from None
    return client


def _finished(futures: list[Any]) -> list[Any]:
    """Return the futures that are done; none when that takes long."""
    from distributed import wait

    try:
        return list(wait(futures, timeout=1.0, return_when="FIRST_COMPLETED").done)
    except TimeoutError:
        return []


def _result(address: str, future: Any, shot: Shot) -> tuple[Image, dict[str, str]]:
    """Return what a worker gave for a shot."""
    from distributed import KilledWorker

    try:
        result: tuple[Image, dict[str, str]] = future.result()
        return result
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"{address}: a worker lacks {error.name}; run its dask worker in an environment with Lippmann"
        ) from None
    except KilledWorker:
        what = f"frame {shot.frame} ended one worker after the other"
        raise device_error(address, what, "see what they say; they may lack memory") from None


def _rendered(shot: Shot, device: str, wanted: dict[str, str]) -> tuple[Image, dict[str, str]]:
    """Render a shot; runs on a worker."""
    from distributed import get_worker

    name = f"worker {get_worker().address}"
    if versions() != wanted:
        theirs = ", ".join(f"{key} {value}" for key, value in versions().items())
        ours = ", ".join(f"{key} {value}" for key, value in wanted.items())
        raise input_error(name, f"has {theirs}, asked for {ours}", "install the same versions everywhere")
    with _rendering:
        start_mitsuba(device)
        _check_scene(name, shot.scene, shot.digest)
        return render_shot(shot)


@functools.lru_cache(maxsize=8)
def _check_scene(worker: str, path: Path, digest: str) -> None:
    """Refuse a scene that is not there, or not the same, on a worker's machine."""
    try:
        own = digest_of(path)
    except InputError as error:
        raise InputError(f"{worker}: {error}; a cluster's machines must share the scene's folder") from None
    if own != digest:
        what = f"{path} is not the same there"
        raise input_error(worker, what, "let the cluster's machines share the scene's folder")
