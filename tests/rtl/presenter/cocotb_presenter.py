import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge
from pins import Pins
from rtl_coverage import Coverage
from streams import hold_reset

OK, STALE, FRAME_CRC = 0, 4, 6
EPOCHS = 1 << 16
SEEN: list[str] = []


class Bench:
    """Counts what presenter asked of its neighbours; `back_crc` is what the back buffer holds."""

    def __init__(self, dut):
        self.dut, self.edge, self.back_crc = Pins(dut), FallingEdge(dut.clk_i), 0
        Clock(dut.clk_i, 2, unit="ns").start()
        self.checks = self.swaps = self.failures = 0

    async def reset(self):
        dut = self.dut
        dut.start_i.value = dut.check_done_i.value = dut.swapped_i.value = 0
        await hold_reset(dut, self.edge)
        self.is_quiet()
        assert int(dut.epoch_o.value) == 0

    def is_quiet(self):
        for name in ("done_o", "failed_o", "check_start_o", "swap_o"):
            assert not getattr(self.dut, name).value, name

    async def present(self, epoch, crc, wait):
        """Ask once; the status. The neighbours take up to `wait` clocks."""
        dut, quick = self.dut, wait == 0
        dut.start_i.value, dut.epoch_i.value, dut.crc_i.value = 1, epoch, crc
        # Clocks until the check or the swap is done; None: not under way.
        check = swap = None
        checks, failed, asked = 0, 0, False
        for _ in range(4 * wait + 12):
            await self.edge
            dut.start_i.value = 0
            if not quick:
                dut.epoch_i.value, dut.crc_i.value = random.getrandbits(16), random.getrandbits(32)
            failed += int(dut.failed_o.value)
            if dut.check_start_o.value:
                assert check is None
                checks, check = checks + 1, random.randint(0, wait)
            dut.check_done_i.value = check == 0
            if not quick:
                dut.check_crc_i.value = random.getrandbits(32)
            if check == 0:
                dut.check_crc_i.value = self.back_crc
            check = None if check in (None, 0) else check - 1
            # The request to swap is held until it was answered.
            swapping = bool(dut.swap_o.value)
            assert swapping or swap is None, "swap fell before the vertical sync"
            if swapping and swap is None:
                assert not asked, "swapped twice"
                asked, swap = True, random.randint(0, wait)
            # A vertical sync that nobody asked for means nothing.
            dut.swapped_i.value = swap == 0 or (not swapping and not quick and random.random() < 0.3)
            if swap == 0:
                self.swaps += 1
            swap = None if swap in (None, 0) else swap - 1
            if dut.done_o.value:
                break
        else:
            raise AssertionError("no answer")
        assert check is None
        assert not dut.swap_o.value
        self.checks += checks
        self.failures += failed
        return int(dut.status_o.value), int(dut.epoch_o.value)

    async def rests(self, clocks):
        """Nothing happens without a request."""
        for _ in range(clocks):
            self.dut.swapped_i.value = random.random() < 0.5
            await self.edge
            self.is_quiet()


def other(word, bits):
    """Another word: a random one, or one that differs in one bit."""
    return random.choice([word ^ 1 << random.randrange(bits), word ^ random.randrange(1, 1 << bits)])


@cocotb.test()
async def each_request_gets_what_it_deserves(dut):
    bench = Bench(dut)
    await bench.reset()
    epoch, shown = 0, None
    wanted_checks = wanted_swaps = wanted_failures = 0
    for _ in range(1500):
        bench.back_crc = random.choice([0, random.getrandbits(32), bench.back_crc])
        case = random.choice(["right", "wrong crc", "again", "again, other crc", "old", "next", "any"])
        asked, crc = {
            "right": (epoch, bench.back_crc),
            "wrong crc": (epoch, other(bench.back_crc, 32)),
            "again": (epoch - 1, shown or 0),
            "again, other crc": (epoch - 1, other(shown or 0, 32)),
            "old": (epoch - 2, shown or 0),
            "next": (epoch + 1, shown or 0),
            "any": (other(epoch, 16), random.choice([shown or 0, bench.back_crc])),
        }[case]
        asked %= EPOCHS
        status = OK
        if asked == epoch:
            wanted_checks += 1
            if crc == bench.back_crc:
                epoch, shown = (epoch + 1) % EPOCHS, crc
                wanted_swaps += 1
            else:
                status = FRAME_CRC
                wanted_failures += 1
        elif (asked + 1) % EPOCHS != epoch or crc != shown:
            status = STALE
        SEEN.append(f"{case}: {status}")
        assert await bench.present(asked, crc, random.choice([0, 1, 5, 40])) == (status, epoch), case
        assert (bench.checks, bench.swaps, bench.failures) == (wanted_checks, wanted_swaps, wanted_failures), case
        if random.random() < 0.3:
            bench.dut.check_done_i.value = 0
            await bench.edge
            await bench.rests(random.randint(0, 5))


@cocotb.test()
async def before_the_first_frame_nothing_is_a_repetition(dut):
    bench = Bench(dut)
    await bench.reset()
    for crc in (0, 0xFFFF_FFFF):
        assert await bench.present(EPOCHS - 1, crc, 3) == (STALE, 0)
    # Nor behind a reset.
    bench.back_crc = 77
    assert await bench.present(0, 77, 3) == (OK, 1)
    await bench.reset()
    for crc in (77, 0):
        assert await bench.present(EPOCHS - 1, crc, 3) == (STALE, 0)
    assert (bench.checks, bench.swaps) == (1, 1)


@cocotb.test()
async def the_epoch_wraps(dut):
    bench = Bench(dut)
    await bench.reset()
    bench.back_crc = 5
    assert await bench.present(0, 5, 0) == (OK, 1)
    dut.epoch_q.value = EPOCHS - 3
    for epoch in range(EPOCHS - 3, EPOCHS):
        assert await bench.present(epoch, 5, 0) == (OK, (epoch + 1) % EPOCHS)
    assert (bench.checks, bench.swaps) == (4, 4)
    assert await bench.present(EPOCHS - 1, 5, 9) == (OK, 0)
    assert await bench.present(EPOCHS - 1, 6, 9) == (STALE, 0)
    assert await bench.present(EPOCHS - 2, 5, 9) == (STALE, 0)
    assert (bench.checks, bench.swaps) == (4, 4)
    assert await bench.present(0, 5, 9) == (OK, 1)
    assert await bench.present(0, 5, 9) == (OK, 1)
    assert (bench.checks, bench.swaps) == (5, 5)


@cocotb.test()
async def coverage_is_complete(dut):
    seen = Coverage("presenter", "all")
    cases = [f"right: {OK}", f"wrong crc: {FRAME_CRC}", f"again: {OK}", f"again, other crc: {STALE}"]
    seen.values("case", SEEN, [*cases, f"old: {STALE}", f"next: {STALE}", f"any: {STALE}"])
    seen.close()
