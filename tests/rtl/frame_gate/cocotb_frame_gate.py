"""frame_gate in the simulator: any requests, a raster and a stream with frames of any length, a reader with pauses.

sim/checks/lipp_frame_gate_checks.sv judges each clock: each ray of both sources leaves once, and all rays of a frame
with the optics that this frame must have.
"""

import random

import cocotb
from cocotb.triggers import FallingEdge, ReadOnly
from rtl_coverage import Coverage
from streams import start_and_reset

CLOCKS = 12_000


class Raster:
    """A frame of 1 to 6 rays, or none (refused), from 3 clocks after its start on."""

    def __init__(self):
        self.wait, self.left, self.running, self.frame = 0, 0, False, 0

    def begin(self):
        self.running, self.frame = True, self.frame + 1
        self.left = random.choice([0, 1, 1, 2, 3, 6])
        self.wait = random.choice([2, 2, 3, 6])

    def clock(self, taken):
        """After an edge; `taken`: the edge took a ray."""
        self.left -= taken
        if self.wait:
            self.wait -= 1
        elif self.left == 0:
            self.running = False

    def stop(self):
        self.running, self.left, self.wait = False, 0, 0

    @property
    def valid(self):
        return self.running and self.wait == 0 and self.left > 0


@cocotb.test()
async def every_request_is_answered_between_two_frames(dut):
    for port in dut:
        if port._name.endswith("_i") and port._name != "clk_i":
            port.value = 0
    await start_and_reset(dut)
    seen = Coverage("frame_gate", "all")
    raster = Raster()
    stream_left, offered, within, busy = 0, False, False, 0.5  # rays of the stream's frame; whether a frame has begun
    for clock in range(CLOCKS):
        if clock % 500 == 0:
            busy = random.choice([0.02, 0.1, 0.4, 0.8])  # how often software asks
        quiet = clock > CLOCKS - 400
        apply, start = (not quiet and random.random() < busy for _ in range(2))
        apply = apply or clock == CLOCKS - 399  # the last one selects the raster, so that it can end
        abort = not quiet and random.random() < 0.05
        dut.apply_i.value, dut.start_i.value, dut.abort_i.value = apply, start, abort
        dut.stream_i.value = 0 if quiet else random.getrandbits(1)
        dut.ready_i.value = random.random() < 0.7
        dut.raster_running_i.value = raster.running
        dut.raster_valid_i.value = raster.valid
        dut.raster_last_i.value = raster.left == 1
        stream_left = stream_left or random.randrange(1, 6)
        offered = offered or random.random() < 0.7
        dut.stream_valid_i.value, dut.stream_last_i.value = offered, stream_left == 1
        await ReadOnly()  # the values that the next edge takes
        take, begin, source = (bool(handle.value) for handle in (dut.take_o, dut.begin_o, dut.stream_o))
        from_raster = raster.valid and bool(dut.raster_ready_o.value)
        from_stream = offered and bool(dut.stream_ready_o.value)
        if from_raster or from_stream:
            within = (raster.left if from_raster else stream_left) > 1
        seen.point("apply within a frame", apply and within)
        seen.point("apply and start together", apply and start)
        seen.point("start while the raster runs", start and raster.running)
        seen.point("the source changes", take and source != bool(dut.stream_i.value))
        seen.point("apply as one takes effect", take and apply)
        seen.point("abort within a frame", abort and within)
        seen.point("abort as a frame waits", abort and bool(dut.start_waits_o.value))
        seen.point("abort as a frame begins", abort and begin)
        seen.point("abort and start together", abort and start)
        seen.point("the raster waits for the stream's frame", raster.valid and source)
        stream_left -= from_stream
        offered = offered and not from_stream
        await FallingEdge(dut.clk_i)
        raster.clock(from_raster)
        if begin and not abort:
            raster.begin()
        if abort:
            raster.stop()
            within = False
    assert not dut.apply_waits_o.value
    assert not dut.start_waits_o.value
    assert not raster.running
    seen.point("frames", raster.frame)
    seen.close()
