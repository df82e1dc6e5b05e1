"""Valid/ready streams for cocotb: pauses at both ends, and a monitor of the contract.

A stream that is offered stays offered, unchanged, until it is taken; that is checked at every clock.
"""

import os
import random
from collections import Counter
from collections.abc import Callable, Iterator
from typing import ClassVar

from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, ReadOnly

#: How both ends of a stream behave: each yields whether it is active in the next clock.
PATTERNS = ("always", "light", "heavy", "bursts", "stuck")
_ALL = [(idle, pressure) for idle in PATTERNS for pressure in PATTERNS]
_PLAIN = [pair for pair in _ALL if pair[0] == pair[1] or "always" in pair]
_MIXED = [pair for pair in _ALL if pair not in _PLAIN]
#: Both ends alike, or one of them without pauses: full, empty, and all between in bursts at both; and two of the other
#: pairs, which the test's seed draws, so that none is left out for good.
PAIRS = [*_PLAIN, *random.Random(os.environ.get("LIPPMANN_SEED")).sample(_MIXED, 2)]


def pattern(name: str, random_: random.Random, stuck: int) -> Iterator[bool]:
    """Activity of one end: without pauses, few, many, in bursts of any length, or none for `stuck` clocks first."""
    if name == "stuck":
        for _ in range(stuck):
            yield False
        name = "always"
    if name == "bursts":
        while True:
            for active in (True, False):
                for _ in range(random_.choice([1, 2, 3, 5, 20, stuck])):
                    yield active
    share = {"always": 1.0, "light": 0.8, "heavy": 0.15}[name]
    while True:
        yield random_.random() < share


#: What a monitor infers from the numbers of words: nothing, where words in and words out are not the same ones.
INFERRED = {"empty", "into an empty device", "last word leaves"}


async def hold_reset(dut, edge=None) -> None:
    """Reset a module for three clocks; `edge` is its clock's, needed where `dut` is a `Pins`."""
    edge = FallingEdge(dut.clk_i) if edge is None else edge
    dut.rst_ni.value = 0
    for _ in range(3):
        await edge
    dut.rst_ni.value = 1


async def start_and_reset(dut) -> None:
    """Start a module's clock, and reset it."""
    Clock(dut.clk_i, 2, unit="ns").start()
    await hold_reset(dut)


class Monitor:
    """Drives both ends of a device between two streams, clock by clock, between the rising edges.

    Parameters
    ----------
    clock, valid_i, ready_o
        Handles; `ready_o` is None where whoever writes must know that there is room.
    valid_o, ready_i, data_o
        Handles of the output.
    put
        Sets the input's data to a word: a function, or the data's handle.
    room
        Words that the device holds, where there is no `ready_o`.
    through
        Whether `ready_o` depends on `ready_i` in the same clock.
    """

    #: How often each situation was seen, in all tests of the module.
    seen: ClassVar[Counter[str]] = Counter()

    def __init__(self, clock, valid_i, ready_o, valid_o, ready_i, data_o, put, room=0, through=False):
        self.edge, self.through = FallingEdge(clock), through
        self.valid_i, self.ready_o, self.room = valid_i, ready_o, room
        self.valid_o, self.ready_i, self.data_o = valid_o, ready_i, data_o
        self.put = put if isinstance(put, Callable) else lambda word: setattr(put, "value", word)
        self.clocks = 0
        #: Clock at which each word was taken in and out.
        self.accepted: list[int] = []
        self.left: list[int] = []
        self.got: list[int] = []
        #: What the valid of the input and the ready of the output were set to; None after anyone else set them.
        self.driven: tuple[bool, bool] | None = None
        self._stalled: int | None = None

    def count(self, name: str, seen: bool) -> None:
        self.seen[name] += bool(seen)

    def settled(self) -> None:
        """Look at handles that depend on inputs of the same clock, where `through` holds."""

    async def clock(self, word: int | None, take: bool) -> bool:
        """Offer a word, or none, and take what is there, or not, for one clock; return whether the word went in."""
        valid = bool(self.valid_o.value)
        data = int(self.data_o.value) if valid else None
        if self._stalled is not None:
            assert valid, f"clock {self.clocks}: valid fell before the word was taken"
            assert data == self._stalled, f"clock {self.clocks}: the word changed under stall"
        inside = len(self.accepted) - len(self.left)
        offered = word is not None and (self.ready_o is not None or inside < self.room)
        if word is not None:
            self.put(word)
        if (offered, take) != self.driven:  # cocotb takes microseconds to write a handle
            self.valid_i.value, self.ready_i.value = self.driven = offered, take
        if self.through:
            await ReadOnly()
            self.settled()
        ready = inside < self.room if self.ready_o is None else bool(self.ready_o.value)
        into = offered and ready
        if into:
            self.accepted.append(self.clocks)
        if valid and take:
            self.left.append(self.clocks)
            self.got.append(data)
        self._stalled = data if valid and not take else None
        self.count("in and out in one clock", into and valid and take)
        self.count("output stalled", valid and not take)
        self.count("output wanted, nothing there", take and not valid)
        self.count("input closed", word is not None and not ready)
        self.count("empty", inside == 0)
        self.count("into an empty device", into and inside == 0)
        self.count("last word leaves", valid and take and inside == 1 and not into)
        await self.edge
        self.clocks += 1
        return into

    async def run(
        self,
        words: list[int],
        idle: Iterator[bool],
        pressure: Iterator[bool],
        patience: int,
        count: int | None = None,
        rest: int | None = None,
    ) -> None:
        """Pass words through, and see that no further ones follow in `rest` clocks, a quarter of the patience.

        `count` words come out, where not one for each.
        """
        sent, waited, offered = 0, 0, False
        already = len(self.got)
        count = len(words) if count is None else count
        while len(self.got) - already < count or sent < len(words):
            # What was offered stays offered: that is the sender's side of the contract.
            offered = offered or (sent < len(words) and next(idle))
            before = sent, len(self.got)
            if await self.clock(words[sent] if offered else None, next(pressure)):
                sent, offered = sent + 1, False
            waited = 0 if (sent, len(self.got)) > before else waited + 1
            assert waited < patience, f"nothing moved for {patience} clocks; {len(self.got) - already} of {count} came"
            assert len(self.got) - already <= count, "more words came out than were due"
        for _ in range(patience // 4 if rest is None else rest):
            await self.clock(None, True)
        assert len(self.got) - already == count, "more words came out than were due"


def watched(dut, data_o=None, put=None, through=False) -> Monitor:
    """The monitor of a module with one stream in and one out, each with data unless others are given."""
    data_o = dut.out_data_o if data_o is None else data_o
    put = dut.in_data_i if put is None else put
    return Monitor(
        dut.clk_i, dut.in_valid_i, dut.in_ready_o, dut.out_valid_o, dut.out_ready_i, data_o, put, through=through
    )
