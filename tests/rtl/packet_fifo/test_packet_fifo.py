"""packet_fifo: its fates and order; behind cobs_decoder, all that can come over a line."""

import itertools
import random
from pathlib import Path

import pytest
from packets import CUT, TAKEN, fates, traffic
from runner import compiled, run_cocotb, simulate

FUZZ_BENCH = Path(__file__).with_name("fuzz_bench.sv")


@pytest.mark.parametrize("bits", [12, pytest.param(13, marks=pytest.mark.full)])
def test_packet_fifo(bits):
    run_cocotb("packet_fifo", {"AddressBits": bits})


@pytest.mark.parametrize("count", [200_000, pytest.param(10_000_000, marks=pytest.mark.full)])
def test_only_whole_packets_come_through(count, tmp_path, seed, seen):
    wire = traffic(random.Random(seed), count) + b"\0"
    files = {name: tmp_path / name for name in ("wire", "out", "fates")}
    files["wire"].write_bytes(wire)
    program = compiled("fuzz_bench", bench=FUZZ_BENCH.read_text())
    simulate(program, "fuzz_bench", "cocotb_fuzz", seed, plusargs={**files, "clocks": 4 * len(wire) + 100_000})
    wanted = fates(wire)
    assert files["fates"].read_text() == "".join(each.cause for each in wanted)
    assert files["out"].read_text().split() == [each.body.hex() for each in wanted if each.cause == TAKEN]
    causes = [each.cause for each in wanted]
    seen.values("fate", causes, "alcsr")
    # The delimiter mends it: what comes behind a frame that was cut short is whole.
    seen.point("whole behind cut", sum(pair == (CUT, TAKEN) for pair in itertools.pairwise(causes)))
