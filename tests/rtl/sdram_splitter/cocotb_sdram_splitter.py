"""sdram_splitter in the simulator: a request's words, each once and in order, in legal transactions that are paid."""

import random

import cocotb
from cocotb.triggers import FallingEdge
from streams import pattern, start_and_reset

WIDTH, HEIGHT, BLOCK = (int(cocotb.plusargs[name]) for name in ("Width", "Height", "Block"))
BUDGET, MAX_BUDGET = (int(cocotb.plusargs[name]) for name in ("Budget", "MaxBudget"))
ROW = 512


def words_of(buffer, first, count):
    """Bank, row and column of each word of a request, from the layout that the store's page gives."""
    rows = -(-WIDTH * HEIGHT // 2 * 3 // ROW)
    for word in range(first // 2 * 3, (first + count) // 2 * 3):
        number = buffer * rows + word // ROW
        yield number % 4, number // 4, word % ROW


def fields(value):
    """row 13, bank 2, column 9, count 10, last 1."""
    return value >> 20 & 3, value >> 22, value >> 11 & 511, value >> 1 & 1023, value & 1


async def start(dut):
    dut.valid_i.value = dut.ready_i.value = dut.pair_i.value = 0
    await start_and_reset(dut)
    await FallingEdge(dut.clk_i)


def requests():
    pixels = WIDTH * HEIGHT
    yield 0, 0, pixels
    yield 1, pixels - 2, 2
    for _ in range(25):
        count = 2 * random.randint(1, min(pixels // 2, random.choice([2, 16, 400])))
        yield random.getrandbits(1), 2 * random.randint(0, (pixels - count) // 2), count


@cocotb.test()
@cocotb.parametrize(pace=["always", "light", "heavy", "bursts"])
async def every_word_once(dut, pace):
    await start(dut)
    budget, active, pairs = BUDGET, pattern(pace, random, 8), pattern(random.choice(["light", "heavy"]), random, 8)
    largest = 0
    for buffer, first, count in requests():
        assert dut.ready_o.value
        dut.valid_i.value, dut.buffer_i.value, dut.first_i.value, dut.count_i.value = 1, buffer, first, count
        await FallingEdge(dut.clk_i)
        dut.valid_i.value, dut.first_i.value, dut.count_i.value = 0, 0, 0
        got, done, held, waited = [], False, None, 0
        while not done:
            assert not dut.ready_o.value
            valid, ready = bool(dut.valid_o.value), next(active)
            pair = next(pairs) and budget + 3 <= MAX_BUDGET
            dut.ready_i.value, dut.pair_i.value = ready, pair
            if held is not None:
                assert valid
                assert int(dut.transaction_o.value) == held
            held = int(dut.transaction_o.value) if valid and not ready else None
            if valid:
                bank, row, column, size, last = fields(int(dut.transaction_o.value))
                assert 1 <= size <= min(BLOCK, ROW - column)
                assert size <= budget
            if valid and ready:
                got += [(bank, row, column + k) for k in range(size)]
                budget -= size
                largest = max(largest, size)
                done = bool(last)
                waited = 0
            budget += 3 * pair
            waited += 1
            assert waited < 3000
            await FallingEdge(dut.clk_i)
        dut.ready_i.value = dut.pair_i.value = 0
        assert got == list(words_of(buffer, first, count))
        await FallingEdge(dut.clk_i)
    assert largest == BLOCK or BLOCK > WIDTH * HEIGHT // 2 * 3


@cocotb.test()
async def it_offers_in_three_clocks(dut):
    """With words in the budget and a ready memory."""
    await start(dut)
    dut.pair_i.value = 1  # more than there are
    for _ in range((MAX_BUDGET - BUDGET) // 3):
        await FallingEdge(dut.clk_i)
    dut.pair_i.value, dut.ready_i.value = 0, 1
    dut.valid_i.value, dut.buffer_i.value, dut.first_i.value, dut.count_i.value = 1, 0, 0, WIDTH * HEIGHT
    gap, gaps, paid = 0, [], MAX_BUDGET // 3 * 3
    while paid >= 2 * BLOCK:
        await FallingEdge(dut.clk_i)
        dut.valid_i.value = 0
        gap += 1
        if dut.valid_o.value:
            gaps.append(gap)
            gap = 0
            paid -= fields(int(dut.transaction_o.value))[3]
    assert gaps
    assert set(gaps) == {3}
