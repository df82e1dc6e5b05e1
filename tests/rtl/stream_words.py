"""The cocotb side of bench.py: stream words, compare each word that comes out."""

import os

import cocotb
from bench import load_plan, unpack
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge


@cocotb.test()
async def every_word_is_the_twins(dut):
    plan = load_plan(os.environ["LIPPMANN_PLAN"])
    dut.select_i.value = plan["select"]
    dut.word_i.value = 0
    Clock(dut.clk_i, 2, unit="ns").start()
    edge = FallingEdge(dut.clk_i)
    await edge
    # Two more for the bench's own registers, before and behind the module.
    latency = int(dut.latency_o.value) + 2
    compared = 0
    for number, segment in enumerate(plan["segments"]):
        # The optics change only when no ray is on the way.
        dut.config_i.value = segment["config"]
        words = [int(word, 16) for word in segment["words"]]
        expected = [int(word, 16) for word in segment["expected"]]
        port_in, port_out = dut.word_i, dut.word_o
        got = []
        for _ in range(latency):
            await edge
        for word in words + words[:1] * latency:
            got.append(port_out.value)
            port_in.value = word
            await edge
        got.append(port_out.value)
        got = [int(word) for word in got[latency : latency + len(words)]]
        for k, (g, e) in enumerate(zip(got, expected, strict=True)):
            assert g == e, (
                f"segment {number}, word {k}: {unpack(plan['inputs'], words[k])}, config {segment['config']:x}\n"
                f"RTL  {unpack(plan['outputs'], g)}\ntwin {unpack(plan['outputs'], e)}"
            )
        compared += len(got)
    assert compared == sum(len(segment["words"]) for segment in plan["segments"])
    dut._log.info("%d words compared, latency %d", compared, latency - 2)
