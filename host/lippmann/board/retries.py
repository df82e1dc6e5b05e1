"""Requests that are sent again until their replies arrive: the time-out, one request at a time, a window of many."""

from __future__ import annotations

import secrets
import struct
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from itertools import takewhile
from typing import NamedTuple

from lippmann.base.progress import Progress
from lippmann.board.packets import MAX_PACKET, REPLY, VERSIONS, Kind, Packet, ReplyStatus, packed
from lippmann.board.port import SEND_S, Line
from lippmann.errors import DeviceError, InputError, LippmannError, NoBoardError

#: Time-out before the first reply, shortest and longest time-out, s.
FIRST_S = 0.25
SHORTEST_S = 0.05
LONGEST_S = 5.0
#: Factor of a time-out after each missing reply. TCP doubles it, as losses there mean congestion; here they mean
#: noise, and more attempts are better than longer ones.
GROWTH = 1.5

#: Maximum of rounds of a frame or of a load, before it fails.
MAX_ROUNDS = 8

#: What runs, in the reply of a busy board: a frame that a write started, the SIGN that is answered, the drawing of
#: the panel; or the slot of a BLOCK is shown.
FRAME_RUNS, THIS_RUNS, SCENE_RUNS, SLOT_SHOWN = 1, 3, 4, 5
BUSY_REPLY = struct.Struct("<BI")

UPDATE = "update the board or this host"
#: Remedy where the scene that the board draws is in the way.
END_SCENE = "end the scene first: lippmann board write scene.source scene=0"
#: Cause and remedy of each refusal.
REFUSALS = {
    ReplyStatus.UNKNOWN_TYPE: ("it does not know this request", "update the board"),
    ReplyStatus.WRONG_LENGTH: ("the request has the wrong length", UPDATE),
    ReplyStatus.NO_SUCH_ADDRESS: (
        "the address is in no block of registers, or cannot be written",
        "see docs/reference/board-registers.md, and scene-registers.md of a board that draws",
    ),
    ReplyStatus.STALE_EPOCH: ("its buffers were swapped during the transfer", "stream the frame again"),
    ReplyStatus.BAD_TILE_DATA: ("it cannot decode a tile", UPDATE),
    ReplyStatus.FRAME_CRC_DIFFERS: ("its frame differs from the one sent", "stream the frame again"),
    ReplyStatus.NO_SUCH_TILE: ("it has no such tile", "render the image for this panel"),
    ReplyStatus.WRONG_VERSION: (
        f"it does not support version {' or '.join(map(str, sorted(VERSIONS, reverse=True)))} of the protocol",
        UPDATE,
    ),
    ReplyStatus.OPTICS_REFUSED: ("its optics block refuses the window", "write the raster's registers first"),
}
#: Status STALE_EPOCH of a request that is executed once: its number is older than that of the last one.
OLD_NUMBER = ("another program has used it since the connection", "connect again, and let one program at a time use it")
#: Requests that are executed once, in the order of their numbers.
ONCE = (Kind.WRITE, Kind.SIGN, Kind.ABORT, Kind.RESET)


class RoundTrip:
    """Smoothed round-trip time and its deviation, and the time-out of a reply that follows from them.

    The estimate is that of TCP (RFC 6298), with a smaller back-off.
    """

    def __init__(self) -> None:
        self._smoothed: float | None = None
        self._deviation = 0.0
        self.time_out_s = FIRST_S

    def sample(self, seconds: float) -> None:
        """Add a measured time from a request to its reply, s."""
        if self._smoothed is None:
            self._smoothed = seconds
            self._deviation = seconds / 2.0
        else:
            self._deviation += (abs(self._smoothed - seconds) - self._deviation) / 4.0
            self._smoothed += (seconds - self._smoothed) / 8.0
        self.time_out_s = self._estimate()

    def back_off(self) -> None:
        """Lengthen the time-out after a missing reply."""
        self.time_out_s = min(GROWTH * self.time_out_s, LONGEST_S)

    def ease(self) -> None:
        """Shorten the time-out after the reply to a repeated request, which cannot be timed."""
        self.time_out_s = max(self.time_out_s / GROWTH, self._estimate())

    def give_up(self) -> None:
        """Forget the back-off after a request without a reply: the next one is repeated as often as the first was."""
        self.time_out_s = self._estimate()

    def _estimate(self) -> float:
        """Return the time-out of the samples."""
        if self._smoothed is None:
            return FIRST_S
        return min(max(self._smoothed + 4.0 * self._deviation, SHORTEST_S), LONGEST_S)


class Requests:
    """Requests over an open line, one at a time: each is sent again until its reply arrives.

    A request raises `DeviceError` when the board refuses it, and `NoBoardError` when the board does not answer for
    `patience_s` seconds.
    """

    def __init__(self, line: Line, patience_s: float) -> None:
        self.line = line
        self.patience_s = patience_s
        # Random, so that late replies to another program match no request of this one.
        self._seq = secrets.randbits(16)
        self._round_trip = RoundTrip()

    def next_seq(self) -> int:
        """Return the next sequence number."""
        self._seq = (self._seq + 1) & 0xFFFF
        return self._seq

    def ask(self, kind: Kind, body: bytes, size: int, work_s: float = 0.0) -> bytes:
        """Send a request; return the `size` bytes behind the reply's status. Raises for a status other than OK."""
        status, answer = self.request(kind, body, work_s)
        return self.checked(kind, status, answer, size)

    def checked(self, kind: Kind, status: int, body: bytes, size: int) -> bytes:
        """Return the body of a reply; raise for a status other than OK, and for another size than `size` bytes."""
        if status != ReplyStatus.OK:
            raise self.refusal(kind, status, body)
        if len(body) != size:
            raise self.error(f"the board's reply to {kind.name} has {len(body)} bytes, not {size}", UPDATE)
        return body

    def request(self, kind: Kind, body: bytes, work_s: float = 0.0, seq: int | None = None) -> tuple[int, bytes]:
        """Send a request until its reply arrives; return the status and the rest of the reply's body.

        The sequence number, a new one unless it is given, stays the same, so the board executes a repeated request
        once. Fails `patience_s` after the time of the board's work, or later by one send that the line does not accept.
        """
        seq = self.next_seq() if seq is None else seq
        packet = packed(kind, seq, body)
        end = time.monotonic() + work_s + self.patience_s
        again = False
        while True:
            self.line.send(packet, min(SEND_S, self.patience_s))
            sent_at = time.monotonic()
            until = min(end, sent_at + self._round_trip.time_out_s + self.line.seconds(len(packet) + MAX_PACKET))
            # Bounded by time: a line may deliver other packets without end.
            while time.monotonic() < until:
                reply = self.line.receive(until - time.monotonic())
                if reply and reply.kind == kind | REPLY and reply.seq == seq and reply.body:
                    if again:
                        self._round_trip.ease()
                    elif not work_s:
                        self._round_trip.sample(time.monotonic() - sent_at)
                    return reply.body[0], reply.body[1:]
            if time.monotonic() >= end:
                self._round_trip.give_up()
                raise self.silence()
            self._round_trip.back_off()
            again = True

    def silence(self) -> NoBoardError:
        """Return the error of a board that does not answer; the received bytes suggest the cause."""
        counts = self.line.reader.counts
        what, remedy = "nothing answers", "check the board's power, the cable, the port and the baud rate"
        if counts.accepted:
            what = f"the board has not answered for {self.patience_s:g} s"
            remedy = "check its power and the cable; of a virtual board, that its machine is not overloaded"
        elif counts.bytes:
            what = f"{counts.bytes} bytes came, but no packet: no board, or one at another baud rate"
            what, remedy = f"{what} than {self.line.baud}", "give the board's rate"
        return NoBoardError.at(self.line.url, what, remedy)

    def refusal(self, kind: int, status: int, body: bytes = b"") -> LippmannError:
        """Return the error of a reply whose status is not OK; `body` follows the status."""
        name = Kind(kind).name
        if status == ReplyStatus.BUSY and len(body) == BUSY_REPLY.size:
            return self._busy(name, *BUSY_REPLY.unpack(body))
        if status not in REFUSALS:
            return self.error(f"the board answers {name} with status {status}", UPDATE)
        is_old = status == ReplyStatus.STALE_EPOCH and kind in ONCE
        what, remedy = OLD_NUMBER if is_old else REFUSALS[ReplyStatus(status)]
        kind_of_error = InputError if status == ReplyStatus.NO_SUCH_ADDRESS else DeviceError
        return kind_of_error.at(self.line.url, f"the board refuses {name}: {what}", remedy)

    def _busy(self, name: str, runs: int, rays: int) -> DeviceError:
        """Return the error of a busy board: `runs` says with what, `rays` how many rays it has traced."""
        if runs == SCENE_RUNS:
            return self.error(f"the board refuses {name} while its optics draw a scene", END_SCENE)
        if runs == SLOT_SHOWN:
            what = f"the board refuses {name}: the slot is shown, or a written layer is about to show it"
            return self.error(what, "load another slot, or hide the layer first")
        by = "a frame that a register write started" if runs == FRAME_RUNS else f"a signature ({rays} rays so far)"
        remedy = "wait, or end it with lippmann board abort"
        if runs == FRAME_RUNS:
            # No stream enters over the line, so such a frame waits for ever.
            remedy += ", the only way if its source is the stream"
        return self.error(f"the board refuses {name} while {by} runs", remedy)

    def error(self, what: str, remedy: str) -> DeviceError:
        """Return an error of the board at this line."""
        return DeviceError.at(self.line.url, what, remedy)


class Flight(NamedTuple):
    """A packet without a reply yet: its item, its body, its length on the line, and the time of sending."""

    item: int
    body: bytes
    length: int
    time: float


class Window(ABC):
    """Sends items, indices of what a board lacks, each in a request of its own, until the board has them.

    Each packet has its own sequence number, a repeated item too, so a reply identifies its packet. The line keeps the
    order: earlier packets that are still unanswered are lost, or their replies are. At most `window_bytes` are sent and
    not yet acknowledged.
    """

    def __init__(self, requests: Requests, kind: Kind, window_bytes: int) -> None:
        self.requests = requests
        self.kind = kind
        self.window_bytes = window_bytes
        self.arrived: set[int] = set()
        self._queue: deque[int] = deque()
        # By sequence number, in the order of sending: unanswered, and given up (a late reply may come).
        self._flights: dict[int, Flight] = {}
        self._lost: dict[int, Flight] = {}
        self._bytes = 0
        self._round_trip = RoundTrip()

    @abstractmethod
    def body(self, item: int) -> bytes:
        """Return the body of an item's request."""

    @abstractmethod
    def judge(self, item: int, body: bytes, status: ReplyStatus, reply: bytes) -> bool:
        """Return whether an item, sent as `body`, has arrived. It may raise, or send the item again (`again`)."""

    def again(self, item: int) -> None:
        """Send an item next."""
        self._queue.appendleft(item)

    def run(
        self, items: Sequence[int], total: int, progress: Progress | None = None, ends: ReplyStatus | None = None
    ) -> ReplyStatus:
        """Send items until the board has them and return OK, or until it answers `ends`, and return that.

        `progress` counts the items of `total` that the board has. Raises NoBoardError when none has arrived for
        `patience_s`.
        """
        self._queue.extend(items)
        line = self.requests.line
        last_gain = last_reply = time.monotonic()
        while self._queue or self._flights:
            self._fill()
            if not self._flights:
                # The queue held only items that had arrived meanwhile.
                continue
            oldest = next(iter(self._flights.values()))
            due = max(oldest.time, last_reply) + self._round_trip.time_out_s + line.seconds(oldest.length)
            end = last_gain + self.requests.patience_s
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
                raise self.requests.silence()
            elif status is None and now >= due:
                # Send one packet again; its reply shows which of the others are lost.
                self._round_trip.back_off()
                self._give_up([next(iter(self._flights))])
        return ReplyStatus.OK

    def _fill(self) -> None:
        """Send items while the window has room. Replies are read before more is sent: they decide what to send."""
        line = self.requests.line
        while self._queue and (not self._flights or (not line.waiting and self._bytes < self.window_bytes)):
            item = self._queue.popleft()
            if item not in self.arrived and not self._send(item):
                return

    def _send(self, item: int) -> bool:
        """Send an item; return False when the line accepts no more."""
        body = self.body(item)
        seq = self.requests.next_seq()
        packet = packed(self.kind, seq, body)
        # A sequence number that is used again belongs to the new packet.
        self._lost.pop(seq, None)
        accepted = self.requests.line.send(packet, min(SEND_S, self.requests.patience_s))
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
        # Late replies are timed too: the first one shows that the line is slower than expected.
        self._round_trip.sample(time.monotonic() - flight.time)
        try:
            status = ReplyStatus(reply.body[0])
        except ValueError:
            raise self.requests.refusal(self.kind, reply.body[0]) from None
        if self.judge(flight.item, flight.body, status, reply.body[1:]):
            self.arrived.add(flight.item)
        return status

    def _give_up(self, numbers: list[int]) -> None:
        """Treat packets as lost: their items are sent next."""
        for seq in reversed(numbers):
            flight = self._flights.pop(seq)
            self._bytes -= flight.length
            self._lost[seq] = flight
            self._queue.appendleft(flight.item)
