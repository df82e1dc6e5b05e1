"""frame_gate in the simulator: any requests, a raster and a stream with frames of any length, a reader with pauses.

sim/checks/lipp_frame_gate_checks.sv judges each clock beside it. Here: each ray of both sources leaves once, and all
rays of a frame with the optics that this frame must have.
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
    stream_left = 0  # rays of the stream's frame
    # The optics: the number of the last take. A frame must see one number, and its start's applies.
    optics, asked, in_effect = 0, 0, 0  # takes; applies requested; applies in effect
    wanted, frame_needs = 0, 0  # applies before the last start, before the frame that has begun
    source, frame_optics, offered = 0, None, False
    busy = 0.5
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
        take, begin = bool(dut.take_o.value), bool(dut.begin_o.value)
        from_raster = raster.valid and bool(dut.raster_ready_o.value)
        from_stream = offered and bool(dut.stream_ready_o.value)
        out = bool(dut.valid_o.value) and bool(dut.ready_i.value)
        assert out == (from_raster or from_stream)
        assert not (from_raster and from_stream)
        assert not from_raster or source == 0
        assert not from_stream or source == 1
        if out:
            assert not take
            frame_optics = optics if frame_optics is None else frame_optics
            assert optics == frame_optics, "a frame is torn"
            if from_raster:
                assert in_effect >= frame_needs, "a frame began before an apply that came before its start"
            if (raster.left if from_raster else stream_left) == 1:
                frame_optics = None
        seen.point("apply within a frame", apply and frame_optics is not None)
        seen.point("apply and start together", apply and start)
        seen.point("start while the raster runs", start and raster.running)
        seen.point("the source changes", take and source != int(dut.stream_i.value))
        seen.point("apply as one takes effect", take and apply)
        seen.point("abort within a frame", abort and frame_optics is not None)
        seen.point("abort as a frame waits", abort and bool(dut.start_waits_o.value))
        seen.point("abort as a frame begins", abort and begin)
        seen.point("abort and start together", abort and start)
        seen.point("the raster waits for the stream's frame", raster.valid and source == 1)
        if begin:
            frame_needs = wanted
        if take:
            assert frame_optics is None
            assert asked > in_effect
            optics, in_effect, source = optics + 1, asked, int(dut.stream_i.value)
        asked += apply
        if start:
            wanted = asked
        stream_left -= from_stream
        offered = offered and not from_stream
        await FallingEdge(dut.clk_i)
        raster.clock(from_raster)
        if begin and not abort:
            assert not raster.running
            raster.begin()
        if abort:
            raster.stop()
            frame_optics = None
    assert in_effect == asked
    assert not dut.apply_waits_o.value
    assert not dut.start_waits_o.value
    assert not raster.running
    seen.point("frames", raster.frame)
    seen.close()
