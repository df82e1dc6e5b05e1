"""scan_out with a panel's real timing: edges of the sync signals, and the CRC of a whole frame."""

import zlib

import cocotb
from cocotb.triggers import FallingEdge, RisingEdge
from cocotb.utils import get_sim_time
from streams import start_and_reset

T = {name: int(value) for name, value in cocotb.plusargs.items() if name[0] in "HVW"}
LINE = T["HSync"] + T["HBack"] + T["Width"] + T["HFront"]
LINES = T["VSync"] + T["VBack"] + T["Height"] + T["VFront"]


async def watch(signal, begins, ends, positive=1):
    """Clocks of a signal's edges, to its active level and from it."""
    begin, end = (RisingEdge, FallingEdge) if positive else (FallingEdge, RisingEdge)
    while True:
        await begin(signal)
        begins.append(round(get_sim_time("ns")) // 2)
        await end(signal)
        ends.append(round(get_sim_time("ns")) // 2)


@cocotb.test()
async def a_whole_frame_with_the_panels_timing(dut):
    dut.swap_i.value = dut.fill_i.value = dut.view_i.value = dut.scene_i.value = dut.key_i.value = 0
    dut.brightness_i.value, dut.kind_i.value = 255, 5
    await start_and_reset(dut)
    edges = {}
    for name in ("de", "hsync", "vsync", "frame_start"):
        edges[name] = [], []
        positive = {"hsync": T["HPositive"], "vsync": T["VPositive"]}.get(name, 1)
        cocotb.start_soon(watch(getattr(dut, f"{name}_o"), *edges[name], positive))
    for _ in range(2):
        await (RisingEdge if T["VPositive"] else FallingEdge)(dut.vsync_o)
    await FallingEdge(dut.clk_i)
    (de, blank), (hsync, hsync_end), (vsync, vsync_end), (start, _) = edges.values()

    assert vsync == [vsync[0], vsync[0] + LINE * LINES]
    assert vsync_end == [vsync[0] + LINE * T["VSync"]]
    assert hsync == [vsync[0] + LINE * y for y in range(LINES + 1)]
    assert hsync_end == [rise + T["HSync"] for rise in hsync[:-1]]
    first = vsync[0] + LINE * (T["VSync"] + T["VBack"]) + T["HSync"] + T["HBack"]
    assert de == [first + LINE * y for y in range(T["Height"])]
    assert blank == [rise + T["Width"] for rise in de]
    assert start == [first]

    ramp = b"".join(bytes([column % 256] * 3) for column in range(T["Width"]))
    assert int(dut.shown_crc_o.value) == zlib.crc32(ramp * T["Height"])
    assert int(dut.frames_o.value) == 1
