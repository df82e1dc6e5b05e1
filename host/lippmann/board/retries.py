"""Repeat requests until their replies arrive: time-outs, refusals, windows of requests."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import takewhile
from typing import TYPE_CHECKING, NamedTuple

from lippmann.base.progress_protocol import Progress
from lippmann.board.packets import REPLY, VERSIONS, Kind, Packet, ReplyStatus, packed
from lippmann.board.port import SEND_S
from lippmann.errors import DeviceError, InputError, LippmannError, device_error

if TYPE_CHECKING:
    from lippmann.board.session import Session

#: Initial, minimum and maximum time-out for a reply, s.
FIRST_S = 0.25
SHORTEST_S = 0.05
LONGEST_S = 5.0
#: Factor by which a missing reply lengthens the time-out. TCP doubles its time-out,
#: because TCP's losses mean congestion; this link's losses mean noise.
GROWTH = 1.5

#: Maximum attempts to transfer a frame or textures.
MAX_ROUNDS = 8
#: Pause before another attempt to reconnect, s.
RETRY_S = 0.5

#: Causes in a BUSY reply: a frame that a register write started, a frame that SIGN
#: started, a drawn scene, and a shown slot.
FRAME_RUNS, THIS_RUNS, SCENE_RUNS, SLOT_SHOWN = 1, 3, 4, 5
BUSY_REPLY = struct.Struct("<BI")

UPDATE = "update the board or this host"
#: Remedy for a refusal that the drawn scene causes.
END_SCENE = "end the scene first: lippmann board write scene.source scene=0"
#: Cause and remedy for each status that means a refusal.
REFUSALS = {
    ReplyStatus.UNKNOWN_TYPE: ("it does not know this type of request", "update the board"),
    ReplyStatus.WRONG_LENGTH: ("the request has the wrong length", UPDATE),
    ReplyStatus.NO_SUCH_ADDRESS: (
        "the address is in no block of registers, or cannot be written",
        "see docs/generated/board-registers.md, and scene-registers.md of a board that draws",
    ),
    ReplyStatus.STALE_EPOCH: ("its buffers were swapped during the transfer", "stream the frame again"),
    ReplyStatus.BAD_TILE_DATA: ("it cannot decode a tile", UPDATE),
    ReplyStatus.FRAME_CRC_DIFFERS: ("its frame differs from the one sent", "stream the frame again"),
    ReplyStatus.NO_SUCH_TILE: ("it has no such tile", "render the image for this panel"),
    ReplyStatus.WRONG_VERSION: (
        f"it does not support protocol version {' or '.join(map(str, sorted(VERSIONS, reverse=True)))}",
        UPDATE,
    ),
    ReplyStatus.OPTICS_REFUSED: ("its optics block refuses the window", "write the raster's registers first"),
}
#: Cause and remedy when a request in `ONCE` has a sequence number that is too old.
OLD_NUMBER = ("another program has used the board meanwhile", "connect again, and let one program at a time use it")
#: Requests that the board executes only once, in the order of their sequence numbers.
ONCE = (Kind.WRITE, Kind.SIGN, Kind.ABORT, Kind.RESET)


def refusal(url: str, kind: int, status: int, body: bytes = b"") -> LippmannError:
    """Return the error for a reply whose status is not OK; `body` follows the status byte."""
    name = Kind(kind).name
    if status == ReplyStatus.BUSY and len(body) == BUSY_REPLY.size:
        return _busy(url, name, *BUSY_REPLY.unpack(body))
    if status not in REFUSALS:
        return device_error(url, f"the board answers {name} with unknown status {status}", UPDATE)
    is_old = status == ReplyStatus.STALE_EPOCH and kind in ONCE
    what, remedy = OLD_NUMBER if is_old else REFUSALS[ReplyStatus(status)]
    kind_of_error = InputError if status == ReplyStatus.NO_SUCH_ADDRESS else DeviceError
    return kind_of_error.at(url, f"the board refuses {name}: {what}", remedy)


def _busy(url: str, name: str, runs: int, rays: int) -> DeviceError:
    if runs == SCENE_RUNS:
        return device_error(url, f"the board refuses {name} while its optics draw a scene", END_SCENE)
    if runs == SLOT_SHOWN:
        what = f"the board refuses {name}: the slot is shown, or a written layer is about to show it"
        return device_error(url, what, "load another slot, or hide the layer first")
    by = "a frame that a register write started" if runs == FRAME_RUNS else f"a SIGN request ({rays} rays so far)"
    remedy = "wait, or end it with lippmann board abort"
    if runs == FRAME_RUNS:
        # A frame from the pixel stream never ends, because a board has no such stream.
        remedy += " (the only remedy if the frame's source is the stream)"
    return device_error(url, f"the board refuses {name} while {by} runs", remedy)


class RoundTrip:
    """Estimate of round-trip time and time-out, as in RFC 6298 with a smaller back-off."""

    def __init__(self) -> None:
        self._smoothed: float | None = None
        self._deviation = 0.0
        self._estimate_s = self.time_out_s = FIRST_S

    def sample(self, seconds: float) -> None:
        """Add a measured round-trip time, s."""
        if self._smoothed is None:
            self._smoothed, self._deviation = seconds, seconds / 2.0
        else:
            self._deviation += (abs(self._smoothed - seconds) - self._deviation) / 4.0
            self._smoothed += (seconds - self._smoothed) / 8.0
        self._estimate_s = min(max(self._smoothed + 4.0 * self._deviation, SHORTEST_S), LONGEST_S)
        self.time_out_s = self._estimate_s

    def back_off(self) -> None:
        """Lengthen the time-out after a missing reply."""
        self.time_out_s = min(GROWTH * self.time_out_s, LONGEST_S)

    def ease(self) -> None:
        """Shorten the time-out after a reply whose round trip cannot be timed."""
        self.time_out_s = max(self.time_out_s / GROWTH, self._estimate_s)

    def give_up(self) -> None:
        """Reset the back-off after a failed request."""
        self.time_out_s = self._estimate_s


class Flight(NamedTuple):
    """A sent packet without a reply yet: item, body, length in bytes, send time in s."""

    item: int
    body: bytes
    length: int
    time: float


#: Function that returns whether an item has arrived; if not, the item is sent again. The
#: arguments are the item, request body, reply status, and the rest of the reply.
Judge = Callable[[int, bytes, ReplyStatus, bytes], bool]


class Window:
    """Sends items, each in its own request, until the board has them.

    Each packet has a new sequence number, so a reply identifies its packet. The line
    keeps the order: if a reply arrives, earlier packets without a reply, or their
    replies, are lost. At most `window_bytes` bytes are unacknowledged.
    """

    def __init__(
        self, session: Session, kind: Kind, window_bytes: int, body: Callable[[int], bytes], judge: Judge
    ) -> None:
        self.session, self.kind, self.window_bytes = session, kind, window_bytes
        self._body, self._judge = body, judge
        self.arrived: set[int] = set()
        self._queue: deque[int] = deque()
        # Pending and given-up packets, keyed by sequence number, in order of sending.
        self._flights: dict[int, Flight] = {}
        self._lost: dict[int, Flight] = {}
        self._bytes = 0
        self._round_trip = RoundTrip()

    def run(
        self, items: Sequence[int], total: int, progress: Progress | None = None, ends: ReplyStatus | None = None
    ) -> ReplyStatus:
        """Send items until the board has them, and return OK; return `ends` if a reply has this status.

        `progress` counts the items of `total` that the board has. Raises NoBoardError
        when no item arrives for `patience_s`.
        """
        self._queue.extend(items)
        line = self.session.line
        last_gain = last_reply = time.monotonic()
        while self._queue or self._flights:
            self._fill()
            if not self._flights:
                continue  # all queued items had arrived meanwhile
            oldest = next(iter(self._flights.values()))
            due = max(oldest.time, last_reply) + self._round_trip.time_out_s + line.seconds(oldest.length)
            end = last_gain + self.session.patience_s
            reply = line.receive(min(due, end) - time.monotonic())
            gains = len(self.arrived)
            status = self._take(reply) if reply else None
            if ends is not None and status == ends:
                return ends
            now = time.monotonic()
            if status is not None:
                last_reply = now
            if len(self.arrived) > gains:
                last_gain = now
                if progress:
                    progress(total - len(items) + len(self.arrived), total)
            elif now >= end:
                raise self.session.silence()
            elif status is None and now >= due:
                # Send one packet again; its reply shows which other packets are lost.
                self._round_trip.back_off()
                self._give_up([next(iter(self._flights))])
        return ReplyStatus.OK

    def _fill(self) -> None:
        line = self.session.line
        while self._queue and (not self._flights or (not line.waiting and self._bytes < self.window_bytes)):
            item = self._queue.popleft()
            if item not in self.arrived and not self._send(item):
                return

    def _send(self, item: int) -> bool:
        body = self._body(item)
        seq = self.session.next_seq()
        packet = packed(self.kind, seq, body)
        # A reused sequence number belongs to the new packet only.
        self._lost.pop(seq, None)
        accepted = self.session.line.send(packet, min(SEND_S, self.session.patience_s))
        self._flights[seq] = Flight(item, body, len(packet), time.monotonic())
        self._bytes += len(packet)
        return accepted

    def _take(self, reply: Packet) -> ReplyStatus | None:
        """Process a reply; return its status, or None for a reply to another request."""
        if reply.kind != self.kind | REPLY or not reply.body:
            return None
        if reply.seq in self._flights:
            self._give_up(list(takewhile(lambda seq: seq != reply.seq, self._flights)))
            flight = self._flights.pop(reply.seq)
            self._bytes -= flight.length
        elif reply.seq in self._lost:
            flight = self._lost.pop(reply.seq)
        else:
            return None
        # Late replies are also timed, because they show a slow line.
        self._round_trip.sample(time.monotonic() - flight.time)
        try:
            status = ReplyStatus(reply.body[0])
        except ValueError:
            raise refusal(self.session.line.url, self.kind, reply.body[0]) from None
        if self._judge(flight.item, flight.body, status, reply.body[1:]):
            self.arrived.add(flight.item)
        else:
            self._queue.appendleft(flight.item)
        return status

    def _give_up(self, numbers: list[int]) -> None:
        for seq in reversed(numbers):
            flight = self._flights.pop(seq)
            self._bytes -= flight.length
            self._lost[seq] = flight
            self._queue.appendleft(flight.item)
