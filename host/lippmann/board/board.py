"""A board with a panel: show images, and compare its rays with the twin's."""

from __future__ import annotations

import contextlib
import struct
import time
import warnings
import zlib
from dataclasses import dataclass

import numpy as np

from lippmann.base.progress_protocol import Progress
from lippmann.board.packets import RESET_VERSION, SCENE_VERSION, Kind, ReplyStatus
from lippmann.board.panel_frames import image_frame
from lippmann.board.retries import BUSY_REPLY, THIS_RUNS
from lippmann.board.session import REGISTERS, SLOWEST_HZ, Session
from lippmann.board.streaming import BoardSink, Sent, send_frame
from lippmann.display.description import Display
from lippmann.errors import InputError, LippmannError, LippmannWarning, check_type
from lippmann.fixed.build import Build
from lippmann.fixed.configuration import configuration
from lippmann.fixed.raster import TABLE_ENTRIES, Raster, raster
from lippmann.fixed.ray_pipeline import FixedRays, ray_pipeline
from lippmann.fixed.registers import build_of, optics_writes, raster_writes, write
from lippmann.fixed.words import Ints
from lippmann.rendering.executors import Executor, render_here
from lippmann.rendering.integral_image import IntegralImage
from lippmann.rendering.plan import Plan
from lippmann.rendering.sinks import render_into

#: Time-out for two scanned-out frames, s; a simulated panel is slow.
FRAME_SECONDS = 120.0
#: Pause between two status queries, s.
QUERY_S = 0.02
#: Clock cycles per ray of a SIGN request: nine words and one spare cycle.
SIGN_CLOCKS = 10
#: Clock cycles per tile of a RESET request, which clears two table entries per tile;
#: the table's size is rounded up to a power of two.
RESET_CLOCKS = 8
#: Maximum rays in a TRACE request.
MAX_RAYS = 64
#: Maximum rays that the twin traces at once.
CHUNK_RAYS = 1 << 20

SIGNATURE = struct.Struct("<II")


class Board(Session):
    """An open connection to a board with a panel; requests raise the errors of `Session`.

    Examples
    --------
    >>> with Board.open("socket://127.0.0.1:4000") as board:  # doctest: +SKIP
    ...     board.show(image)
    """

    def optics_build(self) -> Build:
        """Return the build parameters of the board's optics block.

        Raises InputError if this host does not know the block's version.
        """
        return build_of({name: self.word(f"optics.{name}") for name in ("identity", "version", "build")})

    def trace(self, u: Ints, v: Ints, a: Ints, b: Ints) -> FixedRays:
        """Trace rays (N,) on the board; the words have the formats of `lippmann.fixed.ray_pipeline`."""
        rays = np.stack([u, v, a, b], axis=1).astype("<i4")
        out = np.empty((len(rays), len(FixedRays._fields)), np.int64)
        for first in range(0, len(rays), MAX_RAYS):
            some = rays[first : first + MAX_RAYS]
            body = self.ask(Kind.TRACE, some.tobytes(), 4 * out.shape[1] * len(some))
            out[first : first + MAX_RAYS] = np.frombuffer(body, "<i4").reshape(len(some), -1)
        return FixedRays(*out.T)

    def sign(self, rays: int) -> tuple[int, int]:
        """Trace a frame of roughly `rays` rays; return their exact number and CRC-32.

        A time-out or Ctrl-C aborts the frame.
        """
        work_s = SIGN_CLOCKS * rays / SLOWEST_HZ
        seq, until = self.next_seq(), time.monotonic() + work_s + self.patience_s
        try:
            while True:
                status, body = self.request(Kind.SIGN, b"", work_s if self.info.version == 1 else 0.0, seq)
                runs = BUSY_REPLY.unpack(body) if status == ReplyStatus.BUSY else (0, 0)
                if runs[0] != THIS_RUNS:
                    return SIGNATURE.unpack(self.checked(Kind.SIGN, status, body, SIGNATURE.size))
                if time.monotonic() > until:
                    break
                time.sleep(QUERY_S)
        except KeyboardInterrupt:
            with contextlib.suppress(LippmannError):
                self.abort()
            raise
        self.abort()
        what = f"aborted a traced frame that had not ended after {runs[1]} rays; {rays} were expected"
        raise self.error(what, "write the raster's registers first")

    def frame_runs(self) -> bool:
        """Return whether the optics block traces a frame, or has a frame start pending."""
        return bool(self.fields("optics.status")["running"])

    def abort(self) -> None:
        """Stop tracing a frame, cancel a pending start, and wait until the pipeline is empty."""
        self._needs_version_2(Kind.ABORT)
        self.ask(Kind.ABORT, b"", 0)

    def reset(self) -> None:
        """Reset the board except its serial line; frames, tiles and registers are lost."""
        self._needs_version_2(Kind.RESET)
        self.ask(Kind.RESET, b"", 0, RESET_CLOCKS * self.info.grid.count / SLOWEST_HZ)
        self.hello()

    def _needs_version_2(self, kind: Kind) -> None:
        if self.info.version < RESET_VERSION:
            what = f"the board has protocol version {self.info.version}, which has no {kind.name}"
            raise self.error(what, "update the board, or press its reset button")

    def show(self, image: IntegralImage, progress: Progress | None = None, force: bool = False) -> Sent:
        """Show an image, encoded for its display's panel; return the counts of the transfer.

        The panel keeps its frame until the new frame is complete and its CRC-32 is correct.
        While the board draws a scene, the frame is stored but not shown (LippmannWarning).
        `progress` counts tiles.

        Raises the errors of `image_frame`, and DeviceError when the board does not
        answer, shows a test pattern, or refuses the frame.
        """
        self.check_panel()
        return send_frame(self, image_frame(image, self.info, force), progress)

    def show_render(
        self, plan: Plan, executor: Executor = render_here, progress: Progress | None = None, force: bool = False
    ) -> Sent:
        """Render a plan and show the image; complete tiles are sent after each rendered band.

        `progress` counts rows. Raises the errors of `show` and `executor`; after an
        error, the panel keeps its frame.
        """
        if not hasattr(plan, "bands"):
            raise InputError(f"plan must be a plan of a render, such as Job(...).plan(), not {plan!r}")
        self.check_panel()
        sink = BoardSink(self, plan, force)
        render_into(sink, executor, progress)
        return sink.finish()

    def write_optics(self, display: Display) -> int:
        """Write and apply a display's optics; return the number of written registers.

        Raises InputError for an unsupported display.
        """
        check_type("display", display, Display, "a lippmann.Display")
        build = self.optics_build()
        writes = optics_writes(configuration(display, build, build.model))
        self.write_all([*writes, write("control", apply=1)])
        return len(writes)

    def check_no_pattern(self) -> None:
        """Raise DeviceError while the panel shows a test pattern."""
        if number := self.fields("display")["pattern"]:
            name = dict(REGISTERS["display"].fields["pattern"].names).get(number, "unknown")
            what = f"the panel shows test pattern {number} ({name}), not the frame"
            raise self.error(what, "end the pattern with lippmann board write display pattern=0")

    def draws_scene(self) -> bool:
        """Return whether the panel shows a drawn scene."""
        return self.info.version >= SCENE_VERSION and bool(self.fields("scene.status")["shown"])

    def check_panel(self) -> None:
        """Raise DeviceError if the panel shows a test pattern; warn if it shows a drawn scene."""
        self.check_no_pattern()
        if self.draws_scene():
            what = "the panel shows a drawn scene; the frame is stored, and shown when the scene ends"
            warnings.warn(what, LippmannWarning, stacklevel=3)

    def panel_crc(self) -> int:
        """Return the CRC-32 of the next complete scanned-out frame.

        Raises DeviceError if no frame is complete within `FRAME_SECONDS`.
        """
        first = self.word("frames")
        until = time.monotonic() + FRAME_SECONDS
        # The first frame may have begun before this call, so wait for two frames.
        while (self.word("frames") - first) & 0xFFFFFFFF < 2:
            if time.monotonic() > until:
                raise self.error("the board scans out no frame", "check the board's clock and cable")
            time.sleep(QUERY_S)
        return self.word("shown_crc")

    def verify(self, crc: int) -> None:
        """Raise DeviceError unless the next scanned-out frame has this CRC-32."""
        scanned = self.panel_crc()
        if scanned == crc:
            return
        remedy = "end a drawn scene (scene.source) or test pattern (button), or stream the frame again"
        if self.word("display") != REGISTERS["display"].fields["brightness"].reset:
            remedy = "set brightness=255 pattern=0 to verify (lippmann board write display)"
        what = f"the panel shows a frame of CRC-32 {scanned:08x}, but the sent frame has {crc:08x}"
        raise self.error(what, remedy)


@dataclass(frozen=True)
class Check:
    """Result of `check_rays`: number of rays, and the CRC-32 of the board's and of the twin's rays."""

    rays: int
    board_crc: int
    twin_crc: int

    @property
    def equal(self) -> bool:
        """Whether the two CRC-32 values are equal."""
        return self.board_crc == self.twin_crc


def check_rays(board: Board, display: Display, columns: tuple[int, int], rows: tuple[int, int]) -> Check:
    """Write a display's optics, and compare the board's chief rays in a region with the twin's.

    `columns` and `rows` give the region's first and last pixel, counted from the
    panel's top left. Raises InputError for a region outside the panel, and for a
    display that the board does not support.
    """
    panel = display.panel
    frame = Raster(*panel.size_px, columns, rows)
    build = board.optics_build()
    config = configuration(display, build, build.model)
    board.write_all([*optics_writes(config), *raster_writes(frame)])
    rays, board_crc = board.sign(frame.rays)
    twin_crc = 0
    band = max(1, CHUNK_RAYS // (columns[1] - columns[0] + 1))
    for first in range(rows[0], rows[1] + 1, band):
        part = Raster(*panel.size_px, columns, (first, min(first + band - 1, rows[1])))
        words = raster(part, np.zeros(TABLE_ENTRIES, np.int64), build.fraction_bits)
        traced = ray_pipeline(words.u, words.v, words.a, words.b, config, build)
        twin_crc = zlib.crc32(np.stack(traced, axis=1).astype("<i4").tobytes(), twin_crc)
    return Check(rays, board_crc, twin_crc)
