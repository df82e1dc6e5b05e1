"""A large picture, rendered band by band: on disk instead of in memory, by this process or by many workers.

The bands that are finished stay in a folder beside the picture until it is whole: an interrupted render goes on.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import io
import math
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from lippmann.base.files import FolderLock, remove_stale, replacing
from lippmann.base.images import Radiance, write_picture
from lippmann.base.progress import Progress
from lippmann.display.description import Display
from lippmann.errors import NoSpaceError, input_error
from lippmann.optics.model_choice import TOLERANCE
from lippmann.rendering.integral import RenderOptions, chosen_model, image_metadata, pixels_identity, renderer_of
from lippmann.rendering.integral_image import metadata_of
from lippmann.rendering.renderer import Renderer, bands_of, check_memory_mb, memory_mb
from lippmann.rendering.samples import colours_of
from lippmann.scenes.arrange import load_placed
from lippmann.scenes.placement import Arrange, Placement
from lippmann.scenes.scene import Scene, digest_of, load_scene

#: A picture of more pixels than these, or more rays, is rendered by bands that are kept.
KEPT_PIXELS, KEPT_RAYS = 1 << 25, 1 << 27
#: The name of a kept band: its picture's identity and its number.
BAND_NAME = re.compile(r"([0-9a-f]{16})-([0-9]{5})\.npy")

#: What is said when a render ends before its picture is written.
GOES_ON = "{} of {} rows are kept in {}: the same command goes on from there"

#: The radiance of a band, and its numbers of lost samples by reason.
Rendered = tuple[Radiance, list[int]]


@dataclass(frozen=True)
class Still:
    """A picture with everything that its pixels depend on, so that any process can render its bands."""

    scene: Path
    digest: str
    placement: Placement
    display: Display
    #: With a lens model, not "auto".
    options: RenderOptions

    #: The rows of its bands: chosen once, for a worker's device may prefer others.
    bands: tuple[range, ...]

    @cached_property
    def identity(self) -> str:
        """Hash of everything that the pixels depend on, 16 hexadecimal digits."""
        starts = [rows.start for rows in self.bands]
        return pixels_identity(self.digest, self.placement, self.display, self.options, bands=starts)

    def renderer(self, scene: Scene | None = None) -> Renderer:
        """Return what renders its bands; the scene is loaded when it is not given."""
        if scene is None:
            scene = load_scene(self.scene, self.placement)
        return renderer_of(scene, self.display, self.options, self.bands)

    @property
    def rays(self) -> int:
        """Rays for each pixel."""
        return _rays(self.options, self.display)

    @property
    def metadata(self) -> dict[str, str]:
        """What its file carries."""
        options = self.options
        assert options.model != "auto"
        made = image_metadata(options.model, options.settings, self.scene, options.engine, options.fraction_bits)
        return {**made, **metadata_of(self.display)}


def _rays(options: RenderOptions, display: Display) -> int:
    """Return the rays for each pixel."""
    return options.settings.samples * colours_of(display.panel)


def still_of(
    options: RenderOptions,
    scene: Path,
    display: Display,
    placement: Placement,
    arrange: Arrange | None,
    note: Callable[[str], None],
) -> tuple[Still, Scene]:
    """Return a still, and its scene, loaded by the variant that is set; parameters and errors as for `api.render`."""
    loaded = load_placed(scene, display, placement, arrange, note)
    # No tolerance is left when the model is chosen.
    chosen = replace(options, model=chosen_model(loaded, display, options, note), tolerance=TOLERANCE)
    bands = tuple(bands_of(display.panel.width_px, display.panel.height_px, _rays(chosen, display)))
    path = loaded.path.absolute()  # workers have folders of their own; the files of a link are those beside it
    still = Still(path, digest_of(path), loaded.placement, display, chosen, bands)
    renderer = still.renderer(loaded)
    # As for the model: every worker does what was chosen here.
    settings = renderer.decide()
    if renderer.remark is not None:
        note(renderer.remark)
    return replace(still, options=replace(chosen, settings=settings)), loaded


@dataclass(frozen=True)
class Band:
    """A band of a still, for a worker."""

    still: Still
    number: int

    @property
    def scene(self) -> Path:
        """The scene's file."""
        return self.still.scene

    @property
    def digest(self) -> str:
        """The scene's hash."""
        return self.still.digest

    def __str__(self) -> str:
        """Return its name for messages."""
        return f"band {self.number}"

    def render(self) -> Rendered:
        """Render it, on a worker."""
        radiance, lost = _renderer(self.still).render(self.number)
        return np.require(radiance, requirements="O"), lost  # for other threads, as `render_image` does


@functools.lru_cache(maxsize=1)
def _renderer(still: Still) -> Renderer:
    """Return a still's renderer, whose scene and program are kept for the next band."""
    return still.renderer()


class KeptBands:
    """The finished bands of a still in a folder; like an array of rows to what writes the picture.

    One command has them, until it lets go of them (`release`) or ends.
    """

    def __init__(self, folder: Path, still: Still) -> None:
        """Make the folder, and remove the bands of another still from it.

        InputError when it cannot be made, or another command has it.
        """
        self._lock = FolderLock(folder, "choose another place with -o")
        self.folder, self._still = folder, still
        panel = still.display.panel
        self.shape = panel.height_px, panel.width_px, 3
        #: Number of bands of another still that were there.
        self.removed = 0
        for path in folder.iterdir():
            found = BAND_NAME.fullmatch(path.name)
            if found is not None and found[1] != still.identity:
                path.unlink(missing_ok=True)
                self.removed += 1

    def missing(self) -> list[Band]:
        """Return the bands that are not there, or not whole."""
        return [Band(self._still, k) for k in range(len(self._still.bands)) if self._read(k) is None]

    def keep(self, band: Band, radiance: Radiance) -> None:
        """Store a band; NoSpaceError when the disk is full."""
        with replacing(self._path(band.number)) as partial, partial.open("wb") as stream:
            np.save(stream, radiance)

    def __getitem__(self, rows: slice) -> Radiance:
        """Return some rows, which belong to one band."""
        first, stop, _ = rows.indices(self.shape[0])
        for number, band in enumerate(self._still.bands):
            if first in band:
                found = self._read(number)
                if found is None:
                    raise input_error(str(self._path(number)), "is gone or broken", "render again")
                return np.array(found[first - band.start : stop - band.start])
        return np.empty((0, *self.shape[1:]), np.float32)

    def release(self) -> None:
        """Let another command have the folder; it goes, unless bands are in it."""
        with contextlib.suppress(OSError):
            self.folder.rmdir()
        self._lock.close()

    def remove(self) -> None:
        """Remove the bands, and the folder when nothing else is in it."""
        for number in range(len(self._still.bands)):
            self._path(number).unlink(missing_ok=True)
        remove_stale(self.folder)
        self.release()

    def _path(self, number: int) -> Path:
        return self.folder / f"{self._still.identity}-{number:05d}.npy"

    def _read(self, number: int) -> Radiance | None:
        """Return a band that is there and whole; what numpy would write is compared, and nothing else is read."""
        shape = (len(self._still.bands[number]), *self.shape[1:])
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": shape})
        path, begin = self._path(number), header.getvalue()
        try:
            with path.open("rb") as stream:
                if stream.read(len(begin)) != begin or path.stat().st_size != len(begin) + 4 * math.prod(shape):
                    return None
            return np.memmap(path, np.dtype("<f4"), "r", len(begin), shape)
        except OSError as error:
            if error.errno == errno.ENOMEM:  # it is there
                raise MemoryError from None
            return None


#: Renders bands, in any order. It may tell how many rows of the band that it renders are done.
Work = Callable[[Sequence[Band], Callable[[int], None]], Iterable[tuple[Band, Rendered]]]


def here(still: Still, scene: Scene) -> Work:
    """Return the work that renders bands in this process, with a scene that is loaded."""

    def work(bands: Sequence[Band], told: Callable[[int], None]) -> Iterator[tuple[Band, Rendered]]:
        if not bands:
            return
        renderer = still.renderer(scene)
        for band in bands:
            rows, tiles, done = len(still.bands[band.number]), renderer.tiles_of(band.number), 0

            def part(count: int, rows: int = rows, tiles: int = tiles) -> None:
                nonlocal done
                done += count
                told(rows * done // tiles)

            yield band, renderer.render(band.number, part)

    return work


def render_bands(
    path: Path, still: Still, work: Work, progress: Progress, note: Callable[[str], None] = lambda remark: None
) -> tuple[KeptBands, list[int]]:
    """Render the bands of a still that its folder, PATH.bands, lacks; return all, and the numbers of the new ones.

    `progress` is called with (rows rendered, rows in all), `note` when bands of another still are removed, or those of
    this one stay after an error or an interruption.

    Raises InputError and NoSpaceError when a file cannot be written, or a band exceeds the memory limit, and what
    `work` raises; the finished bands are kept.
    """
    panel = still.display.panel
    check_band_memory(still)
    folder = path.with_name(f"{path.name}.bands")
    _check_disk(folder, still)
    kept = KeptBands(folder, still)
    if kept.removed:
        note(f"{folder}: bands are removed, {kept.removed} of another scene, display, options, version or code")
    missing = kept.missing()
    done = panel.height_px - sum(len(still.bands[band.number]) for band in missing)
    progress(done, panel.height_px)

    def within(rows: int) -> None:
        progress(done + rows, panel.height_px)

    try:
        for band, (radiance, _) in work(missing, within):
            kept.keep(band, radiance)
            done += len(radiance)
            progress(done, panel.height_px)
    except BaseException:
        kept.release()
        if done:
            note(GOES_ON.format(done, panel.height_px, folder))
        raise
    return kept, [band.number for band in missing]


def write_still(path: Path, still: Still, kept: KeptBands, note: Callable[[str], None] = lambda remark: None) -> None:
    """Write the picture of all its bands, and remove their folder; InputError and NoSpaceError when that fails.

    The bands stay then, and `note` says so.
    """
    panel = still.display.panel
    try:
        write_picture(path, kept, still.metadata, panel.transfer, panel.bits)
    except BaseException:
        kept.release()
        note(GOES_ON.format(panel.height_px, panel.height_px, kept.folder))
        raise
    kept.remove()


def _check_disk(folder: Path, still: Still) -> None:
    """Raise NoSpaceError when a disk has no room for the bands of a still that are not there yet."""
    there = sum(path.stat().st_size for path in folder.glob(f"{still.identity}-*.npy")) if folder.is_dir() else 0
    needed = still.display.panel.width_px * still.display.panel.height_px * 3 * 4 - there
    free = shutil.disk_usage(folder.parent).free
    if needed > free:
        what = f"needs {needed / 1e6:.0f} MB on the disk, {free / 1e6:.0f} MB are free"
        raise NoSpaceError.at(str(folder), what, "free space or choose another place with -o")


def left_over(path: Path) -> str | None:
    """Return a remark where bands of an unfinished render lie beside a picture that was just written, else None."""
    folder = path.with_name(f"{path.name}.bands")
    try:
        count = sum(BAND_NAME.fullmatch(one.name) is not None for one in folder.iterdir())
    except OSError:  # no such folder, usually
        return None
    why = "remove it, unless another command is at work on them or is to go on"
    return f"{folder}: has {count} bands of a render that is not done; {why}" if count else None


def check_band_memory(still: Still, workers: int = 1) -> None:
    """Raise InputError when a band for each of so many workers of this machine exceeds the memory limit."""
    rows, settings = max(len(rows) for rows in still.bands), still.options.settings
    panel = still.display.panel
    needed = memory_mb(panel.width_px, rows, settings.shading, settings.samples, colours_of(panel))
    what, remedy = f"a band of {rows} rows of {panel.width_px} pixels", "raise --memory-mb"
    if workers > 1:
        each = " or --shading each" if settings.shading == "shared" else ""
        what, remedy = f"{what} for each of {workers} workers", f"{remedy}, or give fewer --workers{each}"
    check_memory_mb(workers * needed, settings.memory_mb, what, remedy)


def is_kept(options: RenderOptions, display: Display) -> bool:
    """Tell whether a picture is so large, or takes so long, that its bands are kept."""
    pixels = display.panel.width_px * display.panel.height_px
    return pixels > KEPT_PIXELS or pixels * _rays(options, display) > KEPT_RAYS
