"""Renders bands in this process, on new local workers, or on a Dask cluster."""

from __future__ import annotations

import contextlib
import itertools
import logging
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lippmann.base import interrupts
from lippmann.base.images import Radiance
from lippmann.base.programs import starting_python
from lippmann.base.variant import start_mitsuba
from lippmann.errors import InputError, MissingLibraryError, device_error, input_error, missing_library, whole_number
from lippmann.rendering.memory_estimate import check_band_memory
from lippmann.rendering.picture_hash import pixel_versions
from lippmann.rendering.plan import BandRenderer, Plan
from lippmann.rendering.shading import keep_garbage

if TYPE_CHECKING:
    from distributed import Client, Future, Scheduler, Security

    BandFuture = Future[tuple[Radiance, dict[str, str]]]

logger = logging.getLogger("lippmann")
#: Maximum wait for the scheduler's answer, and for a worker, s.
ANSWER_S = 10.0
#: Time until the log reports that no worker is left, s.
ALONE_S = 5.0
#: Time until other workers get the bands of a worker that sends no heartbeat, and
#: until a render ends if no local worker is left, s.
STOPPED_WORKER_S = 30.0
#: Bands submitted per worker thread: one is rendered, one waits.
AHEAD = 2
MAX_WORKERS = 64
#: Lock in a worker process, which renders one band at a time, on all cores.
_rendering = threading.Lock()


@dataclass(frozen=True)
class Band:
    """A band of a plan's picture."""

    plan: Plan
    number: int

    @property
    def rows(self) -> range:
        """The picture's rows in this band."""
        return self.plan.bands[self.number]

    def __str__(self) -> str:
        return f"band {self.number} of {self.plan.name}"


class RenderedBand(NamedTuple):
    """A rendered band: radiance (rows, width, 3), the renderer's choices, compilation time in s."""

    band: Band
    radiance: Radiance
    choices: dict[str, str]
    prepare_seconds: float = 0.0


#: Function that renders bands in any order; it may report a band's finished rows.
Executor = Callable[[Sequence[Band], Callable[[int], None]], Iterator[RenderedBand]]


def render_here(bands: Sequence[Band], report_rows: Callable[[int], None]) -> Iterator[RenderedBand]:
    """Render bands in this process. Raises errors of `Plan.start`."""
    for _, bands_of_one in itertools.groupby(bands, lambda band: id(band.plan)):
        renderer: BandRenderer | None = None
        for band in bands_of_one:
            seconds = 0.0
            if renderer is None:
                renderer = band.plan.start()
                seconds = renderer.prepare()
            radiance, _ = renderer.render(band.number, report_rows)
            yield RenderedBand(band, radiance, dict(renderer.choices), seconds)


def choose_executor(workers: int | None = None, scheduler: str | None = None, device: str = "auto") -> Executor:
    """Return the executor for new local workers, for a Dask scheduler, or for this process.

    Workers render on `device`. Raises InputError if `workers` and `scheduler` are both
    given, if `workers` is out of range, or if no scheduler or worker answers.
    """
    if workers is not None and scheduler is not None:
        raise InputError("workers and scheduler are both given; give only one")
    if workers is not None:
        count = whole_number("workers", workers, 1, MAX_WORKERS)
        return lambda bands, _: render_by_workers(count, device, bands)
    if scheduler is not None:
        if not scheduler or not isinstance(scheduler, str):
            raise InputError(f"scheduler {scheduler!r} is not an address; give tcp://HOST:8786")
        _connect(scheduler).close()
        return lambda bands, _: render_on_cluster(scheduler, device, bands)
    return render_here


def render_by_workers(count: int, device: str, bands: Sequence[Band]) -> Iterator[RenderedBand]:
    """Render bands on new local workers; raise InputError if they exceed the memory limit."""
    if not bands:  # all bands are stored already
        return
    plan, workers = bands[0].plan, min(count, len(bands))
    check_band_memory(plan.display, plan.bands, plan.options.settings, workers)
    if workers < count:
        logger.info("of %d workers, only %d render, one for each band", count, workers)
    with local_workers(workers) as (address, security):
        yield from render_on_cluster(address, device, bands, security)


def render_on_cluster(
    address: str, device: str, bands: Sequence[Band], security: Security | None = None
) -> Iterator[RenderedBand]:
    """Render bands on a cluster; yield each finished band. Workers read the scene from the plan's path.

    `address` is the scheduler's, such as tcp://127.0.0.1:8786; `security` is from
    `local_workers`. Workers render on `device` ("auto", "llvm" or "cuda"). Raises
    InputError if no scheduler or worker answers, or a worker's scene or versions
    differ. Raises DeviceError if the scheduler or all local workers are lost, or a band
    crashes workers. Raises MissingLibraryError if Dask or a worker's module is missing.
    """
    if not bands:
        return
    client = _connect(address, security)
    where, remedy = (address, f" ({_worker_command(address)})") if security is None else ("--workers", "")
    try:
        yield from _distribute(client, device, bands, where, remedy)
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"{address}: a worker lacks the module {error.name}; start the worker in Lippmann's environment"
        ) from None
    except (OSError, CancelledError) as error:  # Dask has lost the scheduler
        what = f"the scheduler is lost ({type(error).__name__})"
        remedy = "start it, then render again; stored bands are kept"
        raise device_error(address, what, remedy) from None
    finally:
        client.close()


def _distribute(client: Client, device: str, bands: Sequence[Band], where: str, remedy: str) -> Iterator[RenderedBand]:
    from distributed import KilledWorker, wait

    waiting = iter(bands)
    running: dict[BandFuture, Band] = {}
    alone = time.monotonic()
    heartbeats: dict[str, tuple[float, float]] = {}
    patience_s = STOPPED_WORKER_S
    while True:
        threads = sum(client.nthreads().values())
        room = max(1, AHEAD * threads) - len(running)
        for band in itertools.islice(waiting, max(0, room)):
            running[client.submit(_render_on_worker, band, device, pixel_versions(), pure=False)] = band
        if not running:
            return
        finished: set[BandFuture] = set()
        with contextlib.suppress(TimeoutError):
            finished = wait(list(running), timeout=1.0, return_when="FIRST_COMPLETED").done
        _give_up_stopped_workers(client, heartbeats, where)
        for future in finished:
            band = running[future]
            try:
                radiance, choices = future.result(timeout=patience_s)
            except TimeoutError:  # the worker may have stopped; if the network is slow, wait longer
                patience_s *= 2.0
                break
            except KilledWorker:
                cause = f"they may lack memory: {'see their logs' if remedy else 'use fewer workers'}"
                raise device_error(where, f"{band} crashed several workers", cause) from None
            del running[future]
            future.release()
            yield RenderedBand(band, radiance, choices)
        if threads:
            alone = time.monotonic()
        elif not remedy and time.monotonic() - alone > STOPPED_WORKER_S:
            raise device_error(where, "no worker is left", "run the command again")
        elif remedy and time.monotonic() - alone > ALONE_S:
            logger.warning("%s: no worker is left; waiting for a worker%s", where, remedy)
            alone = float("inf")


def _give_up_stopped_workers(client: Client, heartbeats: dict[str, tuple[float, float]], where: str) -> None:
    # `heartbeats` maps a worker's address to its last heartbeat and the local time.
    now = time.monotonic()
    for address, state in client.scheduler_info(n_workers=-1)["workers"].items():
        last, since = heartbeats.get(address, (None, now))
        if last != state["last_seen"]:
            heartbeats[address] = state["last_seen"], now
        elif now - since > STOPPED_WORKER_S:

            async def remove(dask_scheduler: Scheduler | None = None, address: str = address) -> None:
                # Dask sends this function's code, so the scheduler needs no Lippmann.
                assert dask_scheduler is not None
                await dask_scheduler.remove_worker(address, stimulus_id="lippmann-stopped-worker")

            client.run_on_scheduler(remove)
            del heartbeats[address]
            message = "worker %s has not answered for %.0f s; others render its bands"
            logger.warning(f"%s: {message}", where, address, STOPPED_WORKER_S)


@contextlib.contextmanager
def local_workers(count: int) -> Iterator[tuple[str, Security]]:
    """Start local workers; yield the scheduler's address and TLS keys. Raises MissingLibraryError."""
    # Dask runs any code that it receives, so it listens only on loopback, with TLS.
    try:
        import dask
        from distributed import LocalCluster, Security

        security = Security.temporary()
    except ImportError as error:
        raise missing_library(error, "cluster") from None
    no_pages = {f"distributed.{one}.http.routes": list[str]() for one in ("scheduler", "worker")}
    with starting_python(), dask.config.set(no_pages):
        with interrupts.blocked_in_children():
            # No memory limit is set, because Dask pauses workers near a limit for ever.
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address=None,
                security=security,
                memory_limit=0,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                silence_logs=logging.CRITICAL,
            )
        with cluster:
            yield cluster.scheduler_address, security


def _worker_command(address: str) -> str:
    loopback = re.search(r"//(127\.|localhost|\[::1\])", address)
    return f"dask worker {address}{' --host 127.0.0.1' if loopback else ''} --no-dashboard"


def _connect(address: str, security: Security | None = None) -> Client:
    try:
        import distributed
    except ImportError as error:
        raise missing_library(error) from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # Lippmann reports failures itself
    try:
        with keep_garbage():  # freeing an old client would hang
            client = distributed.Client(address, timeout=ANSWER_S, security=security)
    except (OSError, ValueError, TypeError):
        remedy = "start one (dask scheduler --host 127.0.0.1 --no-dashboard), or give its address, tcp://HOST:8786"
        raise input_error(address, "no scheduler answers there", remedy) from None
    try:
        client.wait_for_workers(1, timeout=ANSWER_S)
    except TimeoutError:
        client.close()
        remedy = f"start one: {_worker_command(address)}"
        raise input_error(address, "no worker has joined the scheduler", remedy) from None
    return client


def _render_on_worker(band: Band, device: str, expected: dict[str, str]) -> tuple[Radiance, dict[str, str]]:
    from distributed import get_worker

    name = f"worker {get_worker().address}"
    if pixel_versions() != expected:
        versions = pixel_versions(), expected
        theirs, ours = (", ".join(f"{key} {value}" for key, value in one.items()) for one in versions)
        raise input_error(name, f"has {theirs}, but {ours} is needed", "install equal versions")
    # If another thread freed Dr.Jit's garbage now, both threads could hang.
    with _rendering, keep_garbage():
        start_mitsuba(device)
        return render_band(band, name)


def render_band(band: Band, worker: str = "this process") -> tuple[Radiance, dict[str, str]]:
    """Return a band's radiance and the renderer's choices. Raises errors of `Plan.start`."""
    identity = band.plan.identity
    if identity not in _kept_renderers:
        _kept_renderers.clear()  # free the last plan's scene before compiling
        _kept_renderers[identity] = band.plan.start(worker)
    renderer = _kept_renderers[identity]
    radiance, _ = renderer.render(band.number)
    # Other threads need a copy (see `radiance_of`).
    return np.require(radiance, requirements="O"), dict(renderer.choices)


#: The renderer of a worker's last plan, keyed by the plan's identity.
_kept_renderers: dict[str, BandRenderer] = {}
