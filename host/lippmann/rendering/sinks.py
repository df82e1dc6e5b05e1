"""Stores the bands of a picture in memory, or in files from which a later render continues."""

from __future__ import annotations

import contextlib
import errno
import io
import logging
import math
import re
import shutil
import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from lippmann.base.files import FolderLock, remove_stale, replacing
from lippmann.base.images import Radiance, write_picture
from lippmann.base.progress_protocol import Progress, RowProgress
from lippmann.errors import NoSpaceError, input_error, path_of, warn_user
from lippmann.rendering.executors import Band, Executor, RenderedBand, render_here
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.memory_estimate import check_band_memory
from lippmann.rendering.plan import Plan
from lippmann.rendering.renderer import finite_radiance

logger = logging.getLogger("lippmann")
#: Pattern of a kept band's file name: the picture's identity and the first row.
BAND_NAME = re.compile(r"([0-9a-f]{16})-([0-9]{5})\.npy")
#: Bytes of the CRC-32 after the rows in a kept band's file.
CRC_BYTES = 4


class Sink(Protocol):
    """Stores rendered bands."""

    @property
    def bands(self) -> Sequence[Band]:
        """All bands of the sink's pictures."""

    def missing_bands(self) -> Sequence[Band]:
        """Return the bands that must be rendered, in rendering order."""

    def take(self, rendered: RenderedBand) -> None:
        """Store a rendered band."""

    def stop(self, done_rows: int) -> None:
        """Clean up after an error or an interruption, when `done_rows` rows are stored."""


class RenderTimes(NamedTuple):
    """A render's cost: times of rendering and compilation in s, numbers of rays and bands."""

    seconds: float
    prepare_seconds: float
    rays: int
    bands: int
    kept_bands: int

    def measured(self, keeps_bands: bool = False) -> dict[str, float]:
        """Return `IntegralImage.measured`, with numbers of bands if the sink keeps bands."""
        bands = {"bands": self.bands, "bands_kept": self.kept_bands} if keeps_bands else {}
        rate = self.rays / max(self.seconds, 1e-9)
        return {"seconds": self.seconds, "prepare_seconds": self.prepare_seconds, "samples_per_second": rate, **bands}


def render_into(sink: Sink, executor: Executor = render_here, progress: Progress | None = None) -> RenderTimes:
    """Render missing bands; `progress` gets (rows done, all rows). Raises errors of executor and sink."""
    total = sum(len(band.rows) for band in sink.bands)
    report = RowProgress(progress, total)
    rays, prepare_s = 0, 0.0
    try:
        missing = sink.missing_bands()
        report.add(total - sum(len(band.rows) for band in missing))
        planning_s = missing[0].plan.prepare_seconds if missing else 0.0
        is_black = len(missing) == len(sink.bands)
        started = time.perf_counter()
        for rendered in executor(missing, report):
            sink.take(rendered._replace(radiance=finite_radiance(rendered.radiance, rendered.band)))
            is_black = is_black and not rendered.radiance.any()
            rows = len(rendered.band.rows)
            report.add(rows)
            rays += rows * rendered.band.plan.display.panel.width_px * rendered.band.plan.rays
            prepare_s += rendered.prepare_seconds
    except BaseException:
        sink.stop(report.done)
        raise
    seconds = time.perf_counter() - started - prepare_s
    if is_black:
        warn_user("the whole picture is black: the scene may be out of view, unlit or all black")
    prepare_s += planning_s
    return RenderTimes(seconds, prepare_s, rays, len(sink.bands), len(sink.bands) - len(missing))


def bands_of_plan(plan: Plan) -> list[Band]:
    """Return all bands of a plan."""
    return [Band(plan, number) for number in range(len(plan.bands))]


class MemorySink:
    """A sink that stores a picture in memory, (height, width, 3) float32."""

    def __init__(self, plan: Plan) -> None:
        self.bands, self.plan = bands_of_plan(plan), plan
        self._missing = dict(enumerate(self.bands))
        self.radiance = np.empty(plan.display.panel.shape, np.float32)
        self.metadata = plan.metadata

    def missing_bands(self) -> Sequence[Band]:
        """Return the bands that are not stored yet."""
        return list(self._missing.values())

    def take(self, rendered: RenderedBand) -> None:
        """Copy a band into the picture."""
        rows = rendered.band.rows
        self.radiance[rows.start : rows.stop] = rendered.radiance
        self.metadata |= rendered.choices
        self._missing.pop(rendered.band.number, None)

    def stop(self, done_rows: int) -> None:
        """Do nothing, because the picture is lost with the process."""

    def write(self, path: Path) -> None:
        """Write the picture; raise InputError or NoSpaceError if writing fails."""
        panel = self.plan.display.panel
        write_picture(path, self.radiance, self.metadata, panel.transfer, panel.bits)

    def image(self, times: RenderTimes) -> IntegralImage:
        """Return the picture with its render times."""
        return IntegralImage(self.radiance, self.plan.display, self.metadata, times.measured())


class KeptBands:
    """A sink that stores a picture's bands as files in a folder. `release` unlocks the folder."""

    def __init__(self, folder: Path, plan: Plan, remedy: str = "choose another place for the picture") -> None:
        """Lock the folder. Raises InputError for a locked folder or too large bands, NoSpaceError for a full disk."""
        check_band_memory(plan.display, plan.bands, plan.options.settings)
        self._lock = FolderLock(folder, remedy)
        self.folder, self.plan, self.bands = folder, plan, bands_of_plan(plan)
        try:
            _check_disk_space(folder, plan, remedy)
        except NoSpaceError:
            self.release()
            raise
        self.shape = plan.display.panel.shape
        self.metadata = plan.metadata
        self._checked: set[int] = set()

        own = {self._path(band.number).name for band in self.bands}
        names = [path.name for path in folder.glob("[!.]*") if path.name not in own]
        others = [folder / name for name in names if BAND_NAME.fullmatch(name)]
        if foreign := len(names) - len(others):
            warn_user(f"{folder}: has {foreign} other files or folders, which stay there")
        for path in others:
            path.unlink(missing_ok=True)
        if others:
            logger.info("%s: removed %d bands left by a different render", folder, len(others))

    def missing_bands(self) -> list[Band]:
        """Return the bands that are missing or damaged; warn of damaged bands."""
        return [band for band in self.bands if self._read(band.number, warn=True) is None]

    def take(self, rendered: RenderedBand) -> None:
        """Store a band; raise NoSpaceError if the disk is full."""
        radiance = np.ascontiguousarray(rendered.radiance, np.dtype("<f4"))
        with replacing(self._path(rendered.band.number)) as partial, partial.open("wb") as stream:
            np.save(stream, radiance)
            stream.write(zlib.crc32(radiance.data).to_bytes(CRC_BYTES, "little"))
        self._checked.add(rendered.band.number)

    def stop(self, done_rows: int) -> None:
        """Keep the bands for the next command, and log their folder."""
        self.release()
        if done_rows:
            message = "%d of %d rows are kept in %s: the same command goes on from there"
            logger.info(message, done_rows, self.shape[0], self.folder)

    def __getitem__(self, rows: slice) -> Radiance:
        first, stop, _ = rows.indices(self.shape[0])
        for band in self.bands:
            if first in band.rows:
                radiance = self._read(band.number)
                if radiance is None:
                    raise input_error(self._path(band.number), "is missing or broken", "render again")
                return np.array(radiance[first - band.rows.start : stop - band.rows.start])
        return np.empty((0, *self.shape[1:]), np.float32)

    def write(self, path: Path) -> None:
        """Write the picture, then remove the bands. If writing fails, the bands stay."""
        panel = self.plan.display.panel
        try:
            write_picture(path, self, self.metadata, panel.transfer, panel.bits)
        except BaseException:
            self.stop(panel.height_px)
            raise
        self.remove()

    def image(self, times: RenderTimes) -> IntegralImage:
        """Return the picture with its render times; the bands stay."""
        radiance = np.concatenate([self[band.rows.start : band.rows.stop] for band in self.bands])
        self.release()
        return IntegralImage(radiance, self.plan.display, self.metadata, times.measured(keeps_bands=True))

    def release(self) -> None:
        """Unlock the folder for other commands, and remove it if empty."""
        with contextlib.suppress(OSError):
            self.folder.rmdir()
        self._lock.close()

    def remove(self) -> None:
        """Remove the bands, and the folder unless it contains other files."""
        for band in self.bands:
            self._path(band.number).unlink(missing_ok=True)
        remove_stale(self.folder)
        self.release()

    def _path(self, number: int) -> Path:
        return self.folder / f"{self.plan.identity}-{self.plan.bands[number].start:05d}.npy"

    def _read(self, number: int, warn: bool = False) -> Radiance | None:
        # A band must have the header that numpy writes. Its checksum is compared only once.
        shape = (len(self.plan.bands[number]), *self.shape[1:])
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": shape})
        path, begin = self._path(number), header.getvalue()
        size = len(begin) + 4 * math.prod(shape)
        try:
            with path.open("rb") as stream:
                is_complete = stream.read(len(begin)) == begin and path.stat().st_size == size + CRC_BYTES
                if is_complete:
                    stream.seek(size)
                    crc = int.from_bytes(stream.read(CRC_BYTES), "little")
            if is_complete:
                radiance = np.memmap(path, np.dtype("<f4"), "r", len(begin), shape)
                if number in self._checked or zlib.crc32(radiance.data) == crc:
                    self._checked.add(number)
                    return radiance
        except OSError as error:
            if error.errno == errno.ENOMEM:  # the file exists, but memory is short
                raise MemoryError from None
            return None
        if warn:
            warn_user(f"{path}: this band is damaged and will be rendered again")
        return None


def render_picture(
    plan: Plan,
    executor: Executor = render_here,
    folder: str | Path | None = None,
    progress: Progress | None = None,
) -> IntegralImage:
    """Render a plan's picture; `folder` keeps finished bands. Raises errors of `render_into`."""
    path = None if folder is None else path_of(folder, "a folder for kept bands")
    if path is None:
        sink: MemorySink | KeptBands = MemorySink(plan)
    else:
        sink = KeptBands(path, plan, "give another folder as kept")
        if len(plan.bands) == 1:
            logger.info("%s: the picture is one band, so it is kept only when complete", path)
    return sink.image(render_into(sink, executor, progress))


def _check_disk_space(folder: Path, plan: Plan, remedy: str) -> None:
    there = sum(path.stat().st_size for path in folder.glob(f"{plan.identity}-*.npy"))
    needed = plan.display.panel.width_px * plan.display.panel.height_px * 3 * 4 - there
    free = shutil.disk_usage(folder).free
    if needed > free:
        what = f"needs {needed / 1e6:.0f} MB on the disk, {free / 1e6:.0f} MB are free"
        raise NoSpaceError.at(folder, what, f"free disk space, or {remedy}")


def bands_folder(path: Path) -> Path:
    """Return the folder for a picture file's bands."""
    return path.with_name(f"{path.name}.bands")


def log_remaining_bands(path: Path) -> None:
    """Log how many bands of an unfinished render remain beside the written picture."""
    folder = bands_folder(path)
    count = len([one for one in folder.glob("*") if BAND_NAME.fullmatch(one.name)])
    if count:
        why = "remove the folder, unless a command still needs it"
        logger.info("%s: has %d bands of an unfinished render; %s", folder, count, why)
