"""A window of requests in flight: what is lost is sent again, and replies may come in any order."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from itertools import takewhile
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from lippmann.board.packets import REPLY, Kind, Packet, ReplyStatus, packed
from lippmann.board.port import SEND_S
from lippmann.board.round_trip import RoundTrip

if TYPE_CHECKING:
    from lippmann.board.board import Board

#: What a request carries, as its sender notes it.
Note = TypeVar("Note")


class Flight(NamedTuple, Generic[Note]):
    """A packet without a reply yet: its item, the sender's note, its length on the line, and the time of sending."""

    item: int
    note: Note
    length: int
    time: float


class Window(ABC, Generic[Note]):
    """Sends items, numbers of what a board lacks, each in a request of its own, until the board has them.

    Each packet has its own sequence number, a repeated item too, so a reply identifies its packet. The line keeps the
    order: earlier packets that are still unanswered are lost, or their replies are. At most `window_bytes` are sent and
    not yet acknowledged.
    """

    def __init__(self, board: Board, kind: Kind, window_bytes: int) -> None:
        self.board = board
        self.kind = kind
        self.window_bytes = window_bytes
        self.arrived: set[int] = set()
        self._queue: deque[int] = deque()
        # By sequence number, in the order of sending: unanswered, and given up (a late reply may come).
        self._flights: dict[int, Flight[Note]] = {}
        self._lost: dict[int, Flight[Note]] = {}
        self._bytes = 0
        self._round_trip = RoundTrip()

    @abstractmethod
    def request(self, item: int) -> tuple[bytes, Note]:
        """Return the body of an item's request, and a note for its reply."""

    @abstractmethod
    def answered(self, flight: Flight[Note], status: ReplyStatus, body: bytes) -> bool:
        """Judge a reply: return whether the item has arrived. It may raise, or send an item again (`again`)."""

    def again(self, item: int) -> None:
        """Send an item next."""
        self._queue.appendleft(item)

    def run(
        self,
        items: Iterable[int],
        progress: Callable[[int], None] = lambda arrived: None,
        ends: ReplyStatus | None = None,
    ) -> ReplyStatus:
        """Send items until the board has them and return OK, or until it answers `ends`, and return that.

        `progress` is called with the number of items that have arrived. Raises NoBoardError when none has for
        `board.patience_s`.
        """
        self._queue.extend(items)
        line = self.board.line
        last_gain = last_reply = time.monotonic()
        while self._queue or self._flights:
            # Read replies before more is sent: they decide what to send.
            while self._queue and (not self._flights or (not line.waiting and self._bytes < self.window_bytes)):
                if not self._send(self._queue.popleft()):
                    break
            if not self._flights:
                # The queue held only items that had arrived meanwhile.
                continue
            oldest = next(iter(self._flights.values()))
            due = max(oldest.time, last_reply) + self._round_trip.time_out_s + line.seconds(oldest.length)
            end = last_gain + self.board.patience_s
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
                progress(len(self.arrived))
            elif now >= end:
                raise self.board.silence()
            elif status is None and now >= due:
                # Send one packet again; its reply shows which of the others are lost.
                self._round_trip.back_off()
                self._give_up([next(iter(self._flights))])
        return ReplyStatus.OK

    def _send(self, item: int) -> bool:
        """Send an item, unless it has arrived; return False when the line accepts no more."""
        if item in self.arrived:
            return True
        body, note = self.request(item)
        seq = self.board.next_seq()
        packet = packed(self.kind, seq, body)
        # A sequence number that is used again belongs to the new packet.
        self._lost.pop(seq, None)
        taken = self.board.line.send(packet, min(SEND_S, self.board.patience_s))
        self._flights[seq] = Flight(item, note, len(packet), time.monotonic())
        self._bytes += len(packet)
        return taken

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
            raise self.board.refusal(self.kind, reply.body[0]) from None
        if self.answered(flight, status, reply.body[1:]):
            self.arrived.add(flight.item)
        return status

    def _give_up(self, numbers: list[int]) -> None:
        """Treat packets as lost: their items are sent next."""
        for seq in reversed(numbers):
            flight = self._flights.pop(seq)
            self._bytes -= flight.length
            self._lost[seq] = flight
            self._queue.appendleft(flight.item)
