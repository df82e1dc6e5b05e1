"""lipp_wishbone_to_apb: cycles of any kind, back to back, with pauses, and given up at any clock.

sim/checks/lipp_wishbone_to_apb_checks.sv judges each clock beside it.
"""

import os
import random

import cocotb
from buses import WORDS, WishboneMaster, merged, wrong
from rtl_coverage import Coverage
from streams import start_and_reset

TRANSFERS = int(os.environ["TRANSFERS"])


async def begin(dut, clocks):
    dut.clocks_i.value = clocks
    master = WishboneMaster(dut)
    await start_and_reset(dut)
    await master.idle(1)
    return master


@cocotb.test()
async def each_cycle_ends_once(dut):
    master, seen = await begin(dut, 0), Coverage("wishbone_to_apb", "random")
    # What each word may hold: a write that was given up may have taken effect or not.
    held = [{0} for _ in range(WORDS)]
    for word in range(WORDS):
        assert (await master.cycle(word, 0))[1] == wrong(word)
    strobes, given_up = [], []
    for _ in range(TRANSFERS):
        word, select = random.randrange(WORDS), random.choice([0xF, random.randrange(16)])
        data = random.getrandbits(32) if random.random() < 0.5 else None
        patience = random.randint(1, 8) if random.random() < 0.1 else 100
        answer = await master.cycle(word, data, select, patience)
        kind = "read" if data is None else "write"
        if answer is None:
            given_up.append(kind)
            if data is not None and not wrong(word):
                held[word] |= {merged(old, data, select) for old in held[word]}
        else:
            got, error = answer
            assert error == wrong(word)
            if data is not None and not error:
                strobes.append(select)
                held[word] = {merged(old, data, select) for old in held[word]}
            elif not error:  # beside ERR the data mean nothing
                assert got in held[word]
                held[word] = {got}
            seen.point(f"{kind}, error {error}", 1)
        if random.random() < 0.3:
            await master.idle(random.choice([1, 1, 2, 5]))
    seen.values("select of a write", strobes, range(16))
    seen.values("given up", given_up, ["read", "write"])
    seen.close()


@cocotb.test()
async def a_cycle_takes_the_clocks_that_are_said(dut):
    master = await begin(dut, 1)
    for n in (1, 2, 5, 16):
        dut.clocks_i.value = n
        for data in (random.getrandbits(32), None):
            for _ in range(3):  # back to back
                answer = await master.cycle(3, data)
                assert answer is not None
                assert master.clocks == n + 2
            await master.idle(3)


@cocotb.test()
async def reset_ends_a_cycle(dut):
    master = await begin(dut, 16)
    for clocks in range(1, 8):
        assert await master.cycle(5, 0xFFFFFFFF, patience=clocks) is None
        dut.rst_ni.value = 0
        await master.idle(2)
        dut.rst_ni.value = 1
        await master.idle(20)
        assert await master.cycle(6, 0x1908) is not None
        assert await master.cycle(6) == (0x1908, False)
