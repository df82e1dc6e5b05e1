"""The cocotb side of bench.py: stream words, compare each word that comes out."""

import json
import os
from pathlib import Path

import cocotb
from bench import unpack
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge


@cocotb.test()
async def every_word_is_the_twins(dut):
    plan = json.loads(Path(os.environ["LIPPMANN_PLAN"]).read_text())
    dut.select_i.value = 0
    dut.config_i.value = 0
    dut.word_i.value = 0
    Clock(dut.clk_i, 2, unit="ns").start()
    edge = FallingEdge(dut.clk_i)
    port_in, port_out = dut.word_i, dut.word_o
    compared = 0
    for segment in plan:
        # The optics change only when no ray is on the way.
        dut.select_i.value = segment["select"]
        dut.config_i.value = int(segment["config"], 16)
        words = [int(word, 16) for word in segment["words"]]
        expected = [int(word, 16) for word in segment["expected"]]
        await edge
        # Two more for the bench's own registers, before and behind the module.
        latency = int(dut.latency_o.value) + 2
        for _ in range(latency):
            await edge
        got = []
        for word in words + words[:1] * latency:
            got.append(port_out.value)
            port_in.value = word
            await edge
        got.append(port_out.value)
        got = [int(word) for word in got[latency : latency + len(words)]]
        for k, (g, e) in enumerate(zip(got, expected, strict=True)):
            assert g == e, (
                f"{segment['name']}, config {segment['config']}, word {k}: {unpack(segment['inputs'], words[k])}\n"
                f"RTL  {unpack(segment['outputs'], g)}\ntwin {unpack(segment['outputs'], e)}"
            )
        compared += len(got)
    assert compared == sum(len(segment["words"]) for segment in plan) > 0
    dut._log.info("%d words compared", compared)
