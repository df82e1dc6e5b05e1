import random
import struct

import cocotb
import rules
from cocotb.clock import Clock
from neighbours import Neighbours
from packets import marked
from protocol import ABORT, HELLO, KINDS, READ, RESET, SIGN, TILE, TILES, TRACE, WRITE, Reference, request
from requests_fuzz import BODIES, traffic
from rtl_coverage import Coverage
from streams import PAIRS, hold_reset, pattern

WIDTH, HEIGHT, CLOCK_HZ = (int(cocotb.plusargs[name]) for name in ("Width", "Height", "ClockHz"))
IDENTITY = 0x0123_4567_89AB_CDEF
OK, LENGTH, STALE, OPTICS, BUSY = 0, 2, 4, 9, 10
#: Type and status of the replies that were seen to be right.
SEEN: list[tuple[int, int]] = []


async def start(dut, epoch=0, slow=10, first=True):
    """Reset the device, and the clock begins if this is the test's `first` reset."""
    if first:
        Clock(dut.clk_i, 2, unit="ns").start()
    dut.identity_i.value = IDENTITY
    monitor = Neighbours(dut, epoch, slow)
    await hold_reset(dut)
    assert not dut.out_valid_o.value
    return monitor, Reference(WIDTH, HEIGHT, CLOCK_HZ, IDENTITY, epoch)


def packets(words):
    """Packets of a stream whose last bytes are marked."""
    found, packet = [], bytearray()
    for word in words:
        packet.append(word & 0xFF)
        if word & 0x100:
            found.append(bytes(packet))
            packet.clear()
    assert not packet, "a reply without an end"
    return found


async def converse(monitor, reference, requests, wanted, idle="always", pressure="always", rest=None):
    """Send requests; their replies must be those wanted, and all else as the reference has it.

    Nothing follows in `rest` clocks.
    """
    already = len(monitor.got)
    words = [word for packet in requests for word in marked(packet)]
    count = sum(map(len, wanted))
    await monitor.run(words, pattern(idle, random, 200), pattern(pressure, random, 200), 2000, count, rest)
    for packet, got, reply in zip(requests, packets(monitor.got[already:]), wanted, strict=True):
        assert got == reply, f"{packet[:12].hex()} ({len(packet)} bytes): {got[:50].hex()}, not {reply[:50].hex()}"
        SEEN.append((packet[0], reply[3]))
    assert monitor.log == reference.log
    assert monitor.registers == reference.registers
    assert vars(monitor.optics) == vars(reference.optics)
    assert vars(monitor.drawing) == vars(reference.drawing)
    assert [words for words in monitor.updates if words] == reference.updates
    told = ("stale", "tile_bad", "epoch")
    assert [getattr(monitor, name) for name in told] == [getattr(reference, name) for name in told]


async def ask(monitor, reference, *requests):
    """Send requests, and expect the reference's replies; their statuses. What came later would be in the next ones."""
    wanted = [reference.reply(packet) for packet in requests]
    await converse(monitor, reference, requests, wanted, rest=50)
    return [reply[3] for reply in wanted]


@cocotb.test()
@cocotb.parametrize((("idle", "pressure"), PAIRS))
async def replies_as_the_protocol_says(dut, idle, pressure):
    slow = random.choice([0, 3, 40])
    monitor, reference = await start(dut, random.choice([0, 0xFFFE, random.getrandbits(16)]), slow)
    count = 8 if "heavy" in (idle, pressure) else 35
    requests, wanted = zip(*traffic(reference, count), strict=True)
    await converse(monitor, reference, requests, wanted, idle, pressure)


@cocotb.test()
async def replies_by_hand(dut):
    monitor, reference = await start(dut, epoch=0x1234, slow=3)
    # What is said is written out here, and the reference must say it too.
    build = rules.at_reset()[rules.BUILD]
    size = struct.pack("<HH", WIDTH, HEIGHT).hex()
    version = f"{rules.VERSION:02x}"
    older = f"{rules.VERSION - 1:02x}"
    unknown = f"{KINDS[-1] + 1:02x}"
    zero = next(at for at in range(0, 0x100, 4) if not rules.can_read(at))
    fixed = next(at for at in range(0, 0x100, 4) if not rules.can_write(at))
    good = next(bytes([k]) for k in range(256) if rules.tile_is_good(1, 0, bytes([k])))
    bad = next(bytes([k]) for k in range(256) if not rules.tile_is_good(1, 0, bytes([k])))
    last = reference.tiles.to_bytes(2, "little").hex()
    ray = tuple(range(1, 5))
    edge = next(at for _, at in rules.WRITABLE if rules.can_read(at) and at not in (rules.SOURCE, 0x3FC))
    edge = edge.to_bytes(2, "little").hex()
    by_hand = [
        (f"01 0201 {version} 0d0c0b0a", f"81 0201 00 {version} 0d0c0b0a efcdab8967452301 {size} 20 800c 20eed908 3412"
         + build.to_bytes(4, "little").hex()),
        (f"01 0201 {older} 0d0c0b0a", "81 0201 08"),
        (f"01 0201 {version} 0d0c0b", "81 0201 02"),
        (f"{unknown} ffff", f"{0x80 | KINDS[-1] + 1:02x} ffff 01"),
        ("00 0000 01", "80 0000 01"),
        ("03 0500 2003 78563412 44332211", "83 0500 00"),
        ("03 0500 2003 00000000", "83 0500 00"),
        ("02 0600 2003 02", "82 0600 00 78563412 44332211"),
        (f"02 0600 {zero:02x}00 01", "82 0600 00 00000000"),
        (f"03 0600 {fixed:02x}00 00000000", "83 0600 03"),
        ("02 0600 fc00 02", "82 0600 03"),
        ("02 0600 0100 01", "82 0600 03"),
        ("02 0600 0200 01", "82 0600 03"),
        ("03 0600 0200 00000000", "83 0600 03"),
        ("02 0600 0001 01", "82 0600 03"),
        ("02 0600 fc01 02", "82 0600 03"),
        ("02 0600 fc03 02", "82 0600 03"),
        ("02 0600 0008 01" if rules.LAYERS else "02 0600 0004 01", "82 0600 03"),
        ("02 0600 fc03 41", "82 0600 02"),
        (f"04 0700 3412 0100 00 {good.hex()}", "84 0700 00 0100"),
        (f"04 0700 3412 0100 00 {bad.hex()}", "84 0700 05"),
        (f"04 0700 3512 0100 00 {good.hex()}", "84 0700 04"),
        (f"04 0700 3412 {last} 00 {good.hex()}", "84 0700 07"),
        ("05 0800 3412 02000000", "85 0800 00 3512"),
        ("05 0800 3512 00000000", "85 0800 06"),
        ("05 0800 3412 01000000", "85 0800 04"),
        ("06 0900 01 0100 0200", "86 0900 00 3512 0100"
         + struct.pack("<II", rules.table_crc(True, 1), rules.table_crc(True, 2)).hex()),
        (f"06 0900 00 {last} 0100", "86 0900 07"),
        ("06 0900 00 0000 0000", "86 0900 02"),
        ("07 0a00 01000000 02000000 03000000 04000000", "87 0a00 00" + struct.pack("<9I", *rules.exit_ray(ray)).hex()),
        # It runs while some requests are answered, then it has its result.
        *[("08 0b00", "88 0b00 0a 03" + struct.pack("<I", rules.so_far(1)).hex())] * (1 + rules.lasts(1)),
        *[("08 0b00", "88 0b00 00" + struct.pack("<II", *rules.signature(1)).hex())] * 2,
        ("03 0c00 0003 01000000", "83 0c00 00"),
        ("08 0b00", "88 0b00 04"),
        ("08 0d00", "88 0d00 09"),
        ("08 0d00", "88 0d00 09"),
        # A frame that waits for its source keeps all else from the optics until it is ended.
        ("03 0b01 0003 00000000", "83 0b01 00"),
        ("07 0d02 01000000 02000000 03000000 04000000", "87 0d02 00" + struct.pack("<9I", *rules.exit_ray(ray)).hex()),
        ("07 0d02 01000000 00000200 03000000 04000000", "87 0d02 02"),
        ("07 0d02 fffffdff 02000000 03000000 04000000", "87 0d02 02"),
        ("02 0d02 1402 01", "82 0d02 00 00000000"),
        ("03 0c01 1402 01000000", "83 0c01 00"),
        ("03 0d01 0c02 01000000", "83 0d01 00"),
        ("03 0e01 0c02 02000000", "83 0e01 00"),
        ("03 0e01 0c02 02000000", "83 0e01 00"),
        ("03 0f01 0c02 02000000", "83 0f01 0a 01 00000000"),
        ("03 0f01 fc03 02000000", "83 0f01 0a 01 00000000"),
        ("03 0f01 1c00 02000000", "83 0f01 00"),
        ("07 0d02 01000000 02000000 03000000 04000000", "87 0d02 0a 01 00000000"),
        ("08 1001", "88 1001 0a 01 00000000"),
        ("02 1001 1002 01", "82 1001 00 02000000"),
        ("09 1101 00", "89 1101 02"),
        ("09 1101", "89 1101 00"),
        ("09 1101", "89 1101 00"),
        ("08 1001", "88 1001 04"),
        ("02 1001 1002 01", "82 1001 00 00000000"),
        # An abort comes again, late: the sign goes on.
        ("08 1201", "88 1201 0a 03" + struct.pack("<I", rules.so_far(4)).hex()),
        ("09 1101", "89 1101 04"),
        ("09 1301", "89 1301 00"),
        ("0a 1401 00", "8a 1401 02"),
        ("0a 1401", "8a 1401 00"),
        ("0a 1401", "8a 1401 00"),
        (f"04 1501 0000 0100 00 {good.hex()}", "84 1501 00 0100"),
        ("02 1601 2003 01", "82 1601 00" + rules.at_reset()[0x320].to_bytes(4, "little").hex()),
        # All words or none: the second, which is fixed, keeps the first from being written.
        ("03 1e02 fc03 0a000000", "83 1e02 00"),
        (f"03 1f02 {edge} 0b000000 0c000000", "83 1f02 03"),
        (f"03 2002 {edge} 0d000000", "83 2002 00"),
        (f"03 1f02 {edge} 0b000000", "83 1f02 04"),
        (f"02 2102 {edge} 01", "82 2102 00 0d000000"),
        ("0a 1401", "8a 1401 04"),
    ]  # fmt: skip
    await by_hand_and_board(monitor, reference, by_hand)


async def by_hand_and_board(monitor, reference, by_hand):
    requests = [bytes.fromhex(asked) for asked, _ in by_hand]
    wanted = [bytes.fromhex(said) for _, said in by_hand]
    for packet, said in zip(requests, wanted, strict=True):
        assert reference.reply(packet) == said, packet.hex()
    await converse(monitor, reference, requests, wanted)


@cocotb.test()
async def the_scene_by_hand(dut):
    if not rules.LAYERS:
        return
    monitor, reference = await start(dut, slow=3)
    data = random.randbytes(1024).hex()
    last, count = rules.BLOCKS - 1, rules.BLOCKS
    # A register of the last layer, and the one behind it.
    there, beyond = (struct.pack("<H", 0x600 + 32 * layers - 4 * part).hex()
                     for layers, part in ((rules.LAYERS, 1), (rules.LAYERS, 0)))  # fmt: skip
    free, shown = (next(word for word in range(1000) if rules.slots(word, True) & 1 == bit) for bit in (0, 1))
    ray = "01000000 02000000 03000000 04000000"
    crcs = struct.pack(f"<{count}I", *(rules.block_crc(0, k) for k in range(count))).hex()
    scene_runs, slot_runs = "0a 04 00000000", "0a 05 00000000"
    await by_hand_and_board(monitor, reference, [
        ("01 0101 03 0d0c0b0a", f"81 0101 00 03 0d0c0b0a efcdab8967452301 {struct.pack('<HH', WIDTH, HEIGHT).hex()} "
         "20 800c 20eed908 0000" + rules.at_reset()[rules.BUILD].to_bytes(4, "little").hex()),
        # Blocks: the last of a slot and of the curve, and those behind them.
        (f"0b 0200 00 {last:02x} {data}", f"8b 0200 00 00 {last:02x}"),
        (f"0b 0200 00 {last + 1:02x} {data}", "8b 0200 07"),
        (f"0b 0200 0f 07 {data}", "8b 0200 00 0f 07"),
        (f"0b 0200 0f 08 {data}", "8b 0200 07"),
        (f"0b 0200 {rules.SLOTS if rules.SLOTS < 15 else 17:02x} 00 {data}", "8b 0200 07"),
        (f"0b 0200 10 00 {data}", "8b 0200 07"),
        (f"0b 0200 00 00 {data[:-2]}", "8b 0200 02"),
        (f"0b 0200 00 00 {data} 00", "8b 0200 02"),
        (f"0b 0200 00 00 {data} 00000000", "8b 0200 02"),
        ("0b 0200 00 00", "8b 0200 02"),
        ("0b 0200 00", "8b 0200 02"),
        (f"0c 0200 00 00 {count:02x}", f"8c 0200 00 00 00 {crcs}"),
        (f"0c 0200 00 01 {count:02x}", "8c 0200 07"),
        ("0c 0200 0f 07 01", "8c 0200 00 0f 07" + struct.pack("<I", rules.block_crc(15, 7)).hex()),
        ("0c 0200 0f 07 02", "8c 0200 07"),
        ("0c 0200 00 00 00", "8c 0200 02"),
        ("0c 0200 00 00 01 00", "8c 0200 02"),
        # Registers end with the last layer's.
        (f"03 0300 {there} 01000000", "83 0300 00"),
        (f"03 0400 {there} 01000000 02000000", "83 0400 03"),
        (f"03 0500 {beyond} 02000000", "83 0500 03"),
        (f"02 0600 {beyond} 01", "82 0600 00" + (rules.at_reset()[0x600 + 32 * rules.LAYERS] if
         rules.can_read(0x600 + 32 * rules.LAYERS) else 0).to_bytes(4, "little").hex()),
        ("02 0600 fc07 02", "82 0600 03"),
        ("02 0600 fc03 02", "82 0600 03"),
        # Drawn: the optics are taken, and their stream is the source; its slots are shown.
        (f"03 0700 1c06 {struct.pack('<I', free).hex()}", "83 0700 00"),
        ("03 0800 0c04 01000000", "83 0800 00"),
        ("02 0900 1402 01", "82 0900 00 01000000"),
        (f"07 0900 {ray}", f"87 0900 {scene_runs}"),
        ("08 0900", f"88 0900 {scene_runs}"),
        ("03 0900 1402 00000000", f"83 0900 {scene_runs}"),
        ("03 0900 0c02 02000000", f"83 0900 {scene_runs}"),
        ("03 0900 1800 ff000000", "83 0900 00"),
        (f"0b 0900 00 00 {data}", "8b 0900 00 00 00"),
        (f"0b 0900 0f 00 {data}", f"8b 0900 {slot_runs}"),
        (f"03 0a00 1c06 {struct.pack('<I', shown).hex()}", "83 0a00 00"),
        (f"0b 0b00 00 00 {data}", f"8b 0b00 {slot_runs}"),
        ("0c 0b00 00 00 01", "8c 0b00 00 00 00" + struct.pack("<I", rules.block_crc(0, 0)).hex()),
        # An abort has nothing to end; a write of 1 again finds it done.
        ("09 0c00", "89 0c00 00"),
        ("03 0d00 0c04 03000000 04000000", "83 0d00 00"),
        ("03 0e00 0c04 00000000", "83 0e00 00"),
        *[("0c 0f00 00 00 00", "8c 0f00 02")] * 3,
        # Its source is the stream still; a sign takes the raster.
        ("02 0f00 1402 01", "82 0f00 00 01000000"),
        ("08 0f00", "88 0f00 0a 03" + struct.pack("<I", rules.so_far(1)).hex()),
        *[("03 1000 0c04 01000000", "83 1000 0a 02" + struct.pack("<I", rules.so_far(1)).hex())]
        * (rules.lasts(1) and 1),
        ("03 1100 0c04 02000000", "83 1100 00"),
        ("09 1200", "89 1200 00"),
        ("03 1300 0c04 01000000", "83 1300 00"),
        (f"07 1300 {ray}", f"87 1300 {scene_runs}"),
        ("0a 1400", "8a 1400 00"),
        (f"07 1400 {ray}", "87 1400 00" + struct.pack("<9I", *rules.exit_ray((1, 2, 3, 4))).hex()),
    ])  # fmt: skip


@cocotb.test()
async def the_longest_of_each(dut):
    monitor, reference = await start(dut, slow=2)
    count = min(reference.tiles, 512)
    statuses = await ask(
        monitor, reference,
        request(WRITE, 1, struct.pack("<H64I", 0, *(random.getrandbits(32) for _ in range(64)))),
        request(READ, 2, struct.pack("<HB", 0, 64)),
        request(READ, 2, struct.pack("<HB", 0x300, 64)),
        request(TILE, 3, struct.pack("<HHB", 0, 0, 0) + random.randbytes(3200 - 4 - 8)),
        request(TILES, 4, struct.pack("<BHH", 1, reference.tiles - count, count)),
        request(TRACE, 5, (bytes([0xFF, 0xFF, 1, 0, 0, 0, 0xFE, 0xFF]) + random.randbytes(8)) * 64),
        request(TRACE, 6, random.randbytes(3192)),
        request(WRITE, 7, random.randbytes(3193)),
        request(SIGN, 8, random.randbytes(3193)),
        request(0x55, 9, random.randbytes(3193)),
    )  # fmt: skip
    assert statuses[6:] == [LENGTH, LENGTH, LENGTH, 1]


@cocotb.test()
async def executes_once(dut):
    monitor, reference = await start(dut, slow=5)

    def write(number, word=1):
        return request(WRITE, number, struct.pack("<HI", 0x304, word))

    def hello(nonce, version=rules.VERSION):
        return request(HELLO, 9, struct.pack("<BI", version, nonce))

    def read(number):
        return request(READ, number, struct.pack("<HB", 0x304, 1))

    async def done(*requests):
        before = len(monitor.log)
        statuses = await ask(monitor, reference, *requests)
        return [what[0] for what in monitor.log[before:]], statuses

    assert await done(write(7), write(7), write(7)) == (["write"], [OK, OK, OK])
    assert await done(write(8), write(8), read(7), write(8)) == (["write"], [OK] * 4)
    # An old one that comes late does not undo a newer one.
    assert await done(write(7, 5), write(8)) == ([], [STALE, OK])
    # What was refused for its length was not executed, and is not remembered.
    assert await done(request(WRITE, 9, struct.pack("<H", 0x304)), write(8)) == ([], [LENGTH, OK])
    # A new session begins with a new nonce only, in a version that both speak.
    assert await done(hello(5), write(8)) == (["write"], [OK, OK])
    assert await done(hello(5), write(7)) == ([], [OK, STALE])
    assert await done(hello(6, version=1), write(7)) == ([], [8, STALE])

    def sign(number, frame):
        """A sign, until its frame has ended; once more then."""
        return [request(SIGN, number)] * (3 + rules.lasts(frame)), [BUSY] * (1 + rules.lasts(frame)) + [OK] * 2

    have, begin = ["write"] * 2, ["write"]
    requests, statuses = sign(9, 1)
    assert await done(*requests, read(7), request(SIGN, 9)) == (have + begin, [*statuses, OK, OK])
    # The number says how old it is, whatever the type.
    assert await done(write(9), write(10), request(SIGN, 9)) == (["write"], [STALE, OK, STALE])
    # One that the optics refused was executed too.
    refuse = request(WRITE, 11, struct.pack("<HI", rules.WINDOW, 1))
    refused = [OK, OPTICS, OPTICS]
    assert await done(refuse, request(SIGN, 12), request(SIGN, 12)) == (["write", *have, *begin], refused)
    assert await done(request(WRITE, 13, struct.pack("<HI", rules.WINDOW, 0))) == (["write"], [OK])
    # One that the optics cannot take now is not executed: it may come again.
    frame = request(WRITE, 14, struct.pack("<HI", rules.CONTROL, rules.START))
    stream = request(TRACE, 0, bytes(16))
    assert (await done(stream, frame, frame, request(SIGN, 15), write(16)))[1] == [OK, OK, OK, BUSY, BUSY]
    assert (await done(frame, request(ABORT, 15), request(ABORT, 15), write(16), frame))[1] == [OK] * 4 + [STALE]
    requests, statuses = sign(17, 4)
    assert (await done(*requests))[1] == statuses
    # A reset forgets what the board holds, not which requests were executed.
    assert await done(request(RESET, 18), request(RESET, 18), write(17)) == (["reset"], [OK, OK, STALE])
    # Numbers come round; those of other requests count too, so that none seems old that is not.
    for number in range(18, 0x20010, 0x1FFF):
        await ask(monitor, reference, read(number % (1 << 16)))
    assert await done(write(0x0009), write(0x0008)) == (["write"], [OK, STALE])
    for number in range(0x0009, 0x10000, 0x1FFF):
        assert (await done(write(number), write(number)))[1] == [OK, OK]
    assert await done(write(0x0003), write(0xFFFE)) == (["write"], [OK, STALE])


@cocotb.test()
async def a_byte_each_clock(dut):
    monitor, reference = await start(dut, slow=0)
    for packet in (request(0x33, 1, bytes(50)), request(TRACE, 1, bytes(160)), request(WRITE, 1, bytes(202))):
        already = len(monitor.accepted)
        await ask(monitor, reference, packet)
        first = monitor.accepted[already]
        assert monitor.accepted[already:] == list(range(first, first + len(packet)))


@cocotb.test()
async def waits_for_the_table(dut):
    monitor, reference = await start(dut)
    monitor.dut.table_busy_i.value = 1
    packet = request(TILES, 1, struct.pack("<BHH", 0, 0, 3))
    for _ in range(50):
        assert not await monitor.clock(packet[0], True)
    monitor.dut.table_busy_i.value = 0
    await ask(monitor, reference, packet)


@cocotb.test()
async def forgets_all_at_reset(dut):
    first = True
    for cut in range(0, 12, 2) if random.getrandbits(1) else range(1, 12, 2):
        # Within a request, or behind it.
        monitor, reference = await start(dut, slow=30, first=first)
        first = False
        (packet, _), *_ = traffic(reference, 1)
        words = marked(packet)[: 3 * cut + 1]
        clocks = 0
        while words and clocks < 300:
            clocks += 1
            if await monitor.clock(words[0], random.random() < 0.5):
                words.pop(0)
        for _ in range(random.randrange(20)):
            await monitor.clock(None, random.random() < 0.5)
        monitor, reference = await start(dut, first=False)
        write = request(WRITE, 1, struct.pack("<HI", 0x304, cut))
        await ask(monitor, reference, request(HELLO, 1, bytes([rules.VERSION, 0, 0, 0, 0])), write)
        monitor, reference = await start(dut, first=False)
        await ask(monitor, reference, write, request(READ, 1, struct.pack("<HB", 0x304, 1)))


@cocotb.test()
async def refuses_wrong_lengths(dut):
    """Each kind, a byte too long or, where any byte more is data, too short."""
    monitor, reference = await start(dut)
    for number, kind in enumerate(KINDS):
        body = b"1234" if kind == TILE else BODIES[kind](reference) + b"\1"
        await ask(monitor, reference, request(kind, number, body))


@cocotb.test()
async def coverage_is_complete(dut):
    seen = Coverage("dispatcher", f"{WIDTH}x{HEIGHT}, {rules.LAYERS} layers")
    statuses = (
        (0, 2, 8), (0, 2, 3), (0, 2, 3, 4, 10), (0, 2, 4, 5, 7), (0, 2, 4, 6), (0, 2, 7), (0, 2, 10), (0, 2, 4, 9, 10),
        (0, 2, 4), (0, 2, 4), (0, 2, 7, 10), (0, 2, 7),
    )  # fmt: skip
    cases = [(kind, status) for kind in KINDS for status in statuses[kind - 1]]
    for kind, status in [*cases, (0x33, 1)]:
        seen.point(f"type {kind}, status {status}", SEEN.count((kind, status)))
    seen.close()
