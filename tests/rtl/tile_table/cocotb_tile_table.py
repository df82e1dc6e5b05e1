"""tile_table in the simulator. `place`: (buffer, tile)."""

import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge

TILES = -(-int(cocotb.plusargs["Width"]) // 32) * -(-int(cocotb.plusargs["Height"]) // 32)


async def reset(dut, edge):
    dut.rst_ni.value = 0
    dut.write_i.value = 0
    for _ in range(3):
        await edge
    assert dut.busy_o.value
    dut.rst_ni.value = 1
    clocks = 0
    while dut.busy_o.value:
        await edge
        clocks += 1
    # It clears both buffers, one entry a clock.
    assert clocks == 2 << TILES.bit_length()


async def read(dut, edge, buffer, tile):
    dut.read_buffer_i.value, dut.read_tile_i.value = buffer, tile
    await edge
    await edge
    return int(dut.read_crc_o.value)


@cocotb.test()
async def holds_what_was_written_until_reset(dut):
    edge = FallingEdge(dut.clk_i)
    Clock(dut.clk_i, 2, unit="ns").start()
    for _ in range(3):
        await reset(dut, edge)
        table = {(buffer, tile): 0 for buffer in (0, 1) for tile in range(TILES)}
        for _ in range(6 * TILES):
            for place, crc in table.items():
                assert await read(dut, edge, *place) == crc, place
            place, crc = random.choice(list(table)), random.choice([0, random.getrandbits(32)])
            (dut.write_buffer_i.value, dut.write_tile_i.value), dut.write_crc_i.value = place, crc
            dut.write_i.value = 1
            table[place] = crc
            await edge
            dut.write_i.value = 0


@cocotb.test()
async def reads_while_writing(dut):
    edge = FallingEdge(dut.clk_i)
    Clock(dut.clk_i, 2, unit="ns").start()
    await reset(dut, edge)
    table, wanted = {}, []
    for _ in range(1000):
        place, other = ((random.getrandbits(1), random.randrange(TILES)) for _ in range(2))
        crc = random.getrandbits(32)
        if len(wanted) >= 2:
            assert int(dut.read_crc_o.value) == wanted[-2]
        dut.read_buffer_i.value, dut.read_tile_i.value = other
        (dut.write_buffer_i.value, dut.write_tile_i.value), dut.write_crc_i.value = place, crc
        dut.write_i.value = 1
        wanted.append(table.get(other, 0))
        table[place] = crc
        await edge
