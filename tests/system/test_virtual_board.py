"""The virtual board: what the host says over each kind of line, and what then leaves for the panel."""

import contextlib
import dataclasses
import json
import os
import select
import signal
import socket
import struct
import threading
import time
import tty
import zlib
from pathlib import Path

import numpy as np
import pytest
from board_scenes import HEIGHT, WIDTH, display_of
from cobs import cobs
from fault_line import NO_FAULTS, Faults, Proxy
from lippmann.board.board import Board, check_rays
from lippmann.board.packets import BACK, Kind, PacketReader, ReplyStatus, packed
from lippmann.board.panel_frames import load_frame
from lippmann.board.port import token_of
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import capturing
from lippmann.cli import run
from lippmann.display.description import display_text
from lippmann.errors import DeviceError, InputError
from lippmann.eye.test_patterns import ON_BOARD, draw
from lippmann.fixed.configuration import configuration
from lippmann.fixed.registers import BOARD_REGISTERS, optics_writes, write
from lippmann.rendering.integral_image import IntegralImage
from lippmann.simulation import virtual_board

SEED = int(os.environ.get("LIPPMANN_SEED", np.random.SeedSequence().entropy % (1 << 32)))

BAUD = 18_000_000  # the fastest: fewest clocks
#: Lines: how the host reaches the board, and what the RTL is given.
LINES = {
    "socket-bytes": ("tcp", None),
    "pty-bytes": ("pty", None),
    "socket-bits": ("tcp", BAUD),
    "pty-bits": ("pty", BAUD),
    "sdram-bytes": ("tcp", None),
    "sdram-bits": ("tcp", BAUD),
}


def small(grid="square", eye=None):
    """A display whose tiles are clipped on both edges."""
    return dataclasses.replace(display_of(grid), viewing_distance_mm=eye)


#: The grid of the boards over each kind of line: each is compiled, so that the two with a UART are also those of the
#: other grid.
GRID = {None: "square", BAUD: "hex"}
BAUD_OF = {grid: baud for baud, grid in GRID.items()}


def often_over(*often):
    """At every commit over some lines only: what another test asks over the others has to do with the same faults."""
    rows = [pytest.param(line, marks=() if line in often else pytest.mark.full) for line in LINES]
    return pytest.mark.parametrize("virtual", rows, indirect=True)


#: What the simulator's process does is the same for a line of bytes and one of bits.
over_bytes = often_over("socket-bytes", "pty-bytes")
#: A fault of the pty shows with bytes, one of the wires over TCP.
over_usual_lines = often_over("socket-bytes", "pty-bytes", "socket-bits")
#: Whether a board answers and shows frames.
over_all_lines = often_over(*(set(LINES) - {"sdram-bits"}))


@pytest.fixture
def virtual(request, tmp_path):
    """A running board over each kind of line; frames that it scans out are in its folder."""
    print(f"seed {SEED}")
    port, baud = LINES[request.param]
    folder = tmp_path / "frames"
    folder.mkdir()
    display = small(GRID[baud])
    memory = "sdram" if request.param.startswith("sdram") else "block"
    with virtual_board.running(
        display, port=port, baud=baud, capture=folder, memory=memory, clock_hz=virtual_board.CLOCK_HZ
    ) as board:
        board.folder, board.baud, board.display = folder, baud, display
        yield board
        if board.process.poll() is None:
            assert board.stop()["memory_violations"] == 0


@pytest.fixture
def quick(tmp_path):
    """A board on a byte line, on a Unix socket."""
    folder = tmp_path / "frames"
    folder.mkdir()
    with virtual_board.running(small(), capture=folder) as board:
        board.folder = folder
        yield board


def random_image(seed=0):
    """Noise, tiles that are better as QOI, and many of one colour, as a simulated UART takes its time."""
    image = np.full((HEIGHT, WIDTH, 3), seed & 0xFF, np.uint8)
    image[:, :44] = np.random.default_rng([SEED, seed]).integers(0, 256, (HEIGHT, 44, 3))
    return image


def captured(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.glob("frame-*.rgb"))]


def wait_for(folder: Path, image: np.ndarray) -> None:
    """Wait until the last frame that left for the panel is the image."""
    until = time.monotonic() + 20
    while time.monotonic() < until:
        frames = captured(folder)
        if frames and frames[-1] == image.tobytes():
            return
        time.sleep(0.02)
    raise AssertionError("the panel does not show the image")


def assert_only(folder: Path, images) -> None:
    """Nothing but these frames, whole, was ever scanned out, and black before the first after a reset."""
    allowed = {image.tobytes() for image in images} | {bytes(3 * WIDTH * HEIGHT)}
    frames = captured(folder)
    assert all(frame in allowed for frame in frames), f"{sum(f not in allowed for f in frames)} torn or wrong frames"


@over_all_lines
def test_what_a_board_says_of_itself(virtual):
    with Board.open(virtual.url) as board:
        hello = board.info
        assert f"{hello.identity:016x}" == virtual.display.identity
        assert (hello.width, hello.height, hello.tile, hello.max_packet) == (WIDTH, HEIGHT, 32, 3200)
        assert (hello.clock_hz, hello.epoch) == (virtual_board.CLOCK_HZ, 0)
        assert board.read(0x0, 2) == [0x4C495042, 0x00010001]
        assert board.read(0x200) == [0x4C495050]
        low, high = board.read(BOARD_REGISTERS["display_low"].address, 2)
        assert high << 32 | low == int(virtual.display.identity, 16)


@pytest.mark.parametrize("virtual", ["sdram-bytes"], indirect=True)
def test_a_frame_that_the_memory_lost_is_black_and_told(virtual):
    """The panel turns black within two frames, the board says so, and the next frame is shown."""
    first, second = random_image(3), random_image(4)
    names = [*BOARD_REGISTERS["state"].fields]
    with Board.open(virtual.url) as board:
        assert board.read(BOARD_REGISTERS["state"].address) == [0]
        send_frame(board, first)
        wait_for(virtual.folder, first)
        assert board.read(BOARD_REGISTERS["state"].address) == [1 << names.index("shown")]
        virtual.process.send_signal(signal.SIGUSR2)  # the chip of SDRAM forgets, as after a loss of its supply
        wait_for(virtual.folder, np.zeros_like(first))
        assert board.read(BOARD_REGISTERS["state"].address) == [1 << names.index("frame_lost")]
        send_frame(board, second)
        wait_for(virtual.folder, second)
        assert board.read(BOARD_REGISTERS["state"].address) == [1 << names.index("shown")]
        assert board.read(BOARD_REGISTERS["counters_late"].address) == [0]
    # The frame that was on its way when the memory was lost, and the one that showed it.
    wrong = set(captured(virtual.folder)) - {first.tobytes(), second.tobytes(), bytes(first.nbytes)}
    assert len(wrong) <= 2


@over_all_lines
def test_the_panel_shows_what_was_sent(virtual):
    first, second = random_image(1), random_image(2)
    third = second.copy()
    third[70:, 100:] ^= 255
    with Board.open(virtual.url) as board:
        for image in (first, second, third):
            sent = send_frame(board, image)
            assert sent.crc == zlib.crc32(image.tobytes())
            wait_for(virtual.folder, image)
        assert (sent.raw + sent.qoi, sent.copied + sent.skipped) == (1, 11)
        again = send_frame(board, third)
        assert again.unchanged
        assert again.sends == 0
        assert board.read(BOARD_REGISTERS["shown_crc"].address) == [sent.crc]
        counts = board.read(BOARD_REGISTERS["counters_framing"].address, 9)
        assert counts == [0] * 9
    assert_only(virtual.folder, (first, second, third))


def ask(board, kind, body, seq=None):
    """Send one packet and return status and body of its reply."""
    seq = board.next_seq() if seq is None else seq
    board.line.send(packed(kind, seq, body), 2.0)
    until = time.monotonic() + 5
    while (reply := board.line.receive(until - time.monotonic())) is not None:
        if reply.seq == seq and reply.kind == kind | 0x80:
            return reply.body[0], reply.body[1:]
    raise AssertionError("no reply")


#: Requests that are refused: of each kind, for each reason, the bodies.
BAD_REQUESTS = {
    (0x3F, ReplyStatus.UNKNOWN_TYPE): (b"", bytes(500)),
    (Kind.HELLO, ReplyStatus.WRONG_LENGTH): (b"", bytes([1, 0, 0, 0]), bytes([1, 0, 0, 0, 0, 0])),
    (Kind.HELLO, ReplyStatus.WRONG_VERSION): (bytes([1, 0, 0, 0, 0]),),
    (Kind.READ, ReplyStatus.WRONG_LENGTH): (struct.pack("<HB", 0, 0), struct.pack("<HB", 0, 65)),
    (Kind.READ, ReplyStatus.NO_SUCH_ADDRESS): (struct.pack("<HB", 2, 1), struct.pack("<HB", 0x100, 1),
        struct.pack("<HB", 0xFC, 2), struct.pack("<HB", 0x400, 1), struct.pack("<HB", 0xFFFC, 64)),
    (Kind.WRITE, ReplyStatus.WRONG_LENGTH): (struct.pack("<H", 0x18), struct.pack("<HI", 0x18, 1)[:-1],
        struct.pack("<H65I", 0x200, *range(65))),
    (Kind.WRITE, ReplyStatus.NO_SUCH_ADDRESS): (struct.pack("<HI", 0x180, 1), struct.pack("<HII", 0xFC, 1, 1)),
    (Kind.TILE, ReplyStatus.STALE_EPOCH): (struct.pack("<HHB", 1, 0, 0), struct.pack("<HHB", 1, 0, 0) + bytes(3072)),
    (Kind.TILE, ReplyStatus.NO_SUCH_TILE): (struct.pack("<HHB", 0, 12, 1) + bytes(3),),
    (Kind.TILE, ReplyStatus.BAD_TILE_DATA): (struct.pack("<HHB", 0, 0, 0), struct.pack("<HHB", 0, 0, 0) + bytes(3071),
        struct.pack("<HHB", 0, 0, 0) + bytes(3073), struct.pack("<HHB", 0, 3, 0) + bytes(3072),
        struct.pack("<HHB", 0, 0, 4) + bytes(3), struct.pack("<HHB", 0, 0, 2) + b"\xfd" * 20,
        struct.pack("<HHB", 0, 0, 3) + b"\0"),
    (Kind.PRESENT, ReplyStatus.STALE_EPOCH): (struct.pack("<HI", 5, 0), struct.pack("<HI", 0xFFFF, 0)),
    (Kind.PRESENT, ReplyStatus.FRAME_CRC_DIFFERS): (struct.pack("<HI", 0, 12345),),
    (Kind.PRESENT, ReplyStatus.WRONG_LENGTH): (struct.pack("<HIB", 0, 0, 0),),
    (Kind.TILES, ReplyStatus.WRONG_LENGTH): (struct.pack("<BHH", 0, 0, 0), struct.pack("<BHH", 0, 0, 513)),
    (Kind.TILES, ReplyStatus.NO_SUCH_TILE): (struct.pack("<BHH", 2, 0, 1), struct.pack("<BHH", 0, 10, 3)),
    (Kind.TRACE, ReplyStatus.WRONG_LENGTH): (b"", bytes(20), bytes(16 * 65)),
    (Kind.SIGN, ReplyStatus.WRONG_LENGTH): (b"x",),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "body", "status"),
    [(kind, body, status) for (kind, status), bodies in BAD_REQUESTS.items() for body in bodies],
)
def test_bad_requests_are_refused_and_change_nothing(shared, kind, body, status):
    with Board.open(shared.url) as board:
        display = board.read(0x18)
        assert ask(board, kind, body) == (status, b"")
        assert board.read(0x18) == display
        assert board.read(BOARD_REGISTERS["epoch"].address) == [0]
        if kind == Kind.TILE and status == ReplyStatus.BAD_TILE_DATA:
            tile = struct.unpack("<H", body[2:4])[0]
            assert board.tiles(BACK).crcs[tile] == 0


@pytest.fixture(scope="module")
def shared():
    """One board for the tests that leave it as it was."""
    with virtual_board.running(small()) as board:
        yield board


@over_usual_lines
def test_packets_that_are_not_good_are_counted_and_not_answered(virtual):
    good = packed(Kind.READ, 7, struct.pack("<HB", 0, 1))
    flipped = bytes([good[0], good[1] ^ 4]) + good[2:]
    with Board.open(virtual.url) as board:
        names = ["packets", "dropped_cobs", "dropped_crc", "dropped_long", "dropped_short"]

        def counts():
            return np.array([board.read(BOARD_REGISTERS[f"counters_{name}"].address)[0] for name in names])

        before = counts()
        for bad in (flipped, b"\x09abc\0", b"\x03ab\0", cobs.encode(bytes(3201)) + b"\0", b"\0\0\0"):
            board.line.send(bad, 1.0)
            assert board.line.receive(0.2) is None
        change = counts() - before
        # Each count was read by five good packets itself.
        assert change.tolist() == [5, 1, 1, 1, 1]
        # The longest that is good.
        assert ask(board, Kind.TILE, bytes(3193), 8)[0] == ReplyStatus.BAD_TILE_DATA


def test_a_write_is_executed_once(quick):
    with Board.open(quick.url) as board:
        address = BOARD_REGISTERS["lens"].address
        assert ask(board, Kind.WRITE, struct.pack("<HI", address, 1), 100) == (0, b"")
        assert ask(board, Kind.WRITE, struct.pack("<HI", address, 2), 101) == (0, b"")
        # The same number again: whatever it says, it is the reply that was lost.
        assert ask(board, Kind.WRITE, struct.pack("<HI", address, 3), 101) == (0, b"")
        assert board.read(address) == [2]
        assert ask(board, Kind.WRITE, struct.pack("<HI", address, 3), 102) == (0, b"")
        assert board.read(address) == [3]
        board.hello()
        assert ask(board, Kind.WRITE, struct.pack("<HI", address, 4), 102) == (0, b"")
        assert board.read(address) == [4]


@pytest.mark.parametrize(
    ("grid", "eye"), [("square", None), ("hex", None), pytest.param("hex", 30.0, marks=pytest.mark.full)]
)
def test_the_boards_rays_and_patterns_are_those_of_the_command(tmp_path, grid, eye):
    """Rays of the board's frames are the twin's; patterns byte by byte, in the words of the board's optics."""
    display, folder = small(grid, eye), tmp_path / "frames"
    folder.mkdir()
    running = virtual_board.running(display, baud=BAUD_OF[grid], capture=folder)
    with running as virtual, Board.open(virtual.url) as board:
        for window in (((0, WIDTH - 1), (0, HEIGHT - 1)), ((5, 5), (7, 7)), ((3, 60), (10, 20))):
            assert check_rays(board, display, *window).equal
        build = board.optics_build()
        board.write_all([*optics_writes(configuration(display, build, build.model)), write("control", apply=1)])
        for value, kind in enumerate(ON_BOARD, 1):
            draw(display, kind, fraction_bits=build.fraction_bits).save(tmp_path / f"{kind}.png")
            frame = load_frame(tmp_path / f"{kind}.png", board.info)
            assert np.ptp(frame) == (255 if kind != "ramp" else WIDTH - 1), kind
            board.write(BOARD_REGISTERS["display"].address, [value << 8 | 0xFF])
            wait_for(folder, frame)


def levels_by_hand(light, transfer, bits):
    """Levels of a panel by its curve, 0 to 2^bits - 1, in double and not rounded."""
    light = light.astype(np.float64)
    curve = {
        "linear": light,
        "srgb": np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055),
        "gamma2.2": light ** (1 / 2.2),
    }
    return curve[transfer] * (2**bits - 1)


@pytest.mark.parametrize("suffix", [".exr", ".png"])
@pytest.mark.parametrize(("transfer", "bits"), [("linear", 8), ("srgb", 6), ("gamma2.2", 6), ("linear", 6)])
def test_the_panel_gets_the_tones_that_the_display_asks_for(looped, tmp_path, capsys, transfer, bits, suffix):
    """From a file by the command, and from an image in Python: 0 bytes differ, and a wrong curve is refused."""
    display = small()
    display = dataclasses.replace(display, panel=dataclasses.replace(display.panel, transfer=transfer, bits=bits))
    # Half floats, which an EXR holds exactly; none so near a half level that float32 may round it the other way.
    light = np.random.default_rng([SEED, bits]).random((HEIGHT, WIDTH, 3)).astype(np.float16).astype(np.float32)
    light[np.abs(levels_by_hand(light, transfer, bits) % 1 - 0.5) < 1e-3] = 0
    wanted = np.rint(np.rint(levels_by_hand(light, transfer, bits)) * 255 / (2**bits - 1)).astype(np.uint8)
    path = tmp_path / f"image{suffix}"
    image = IntegralImage(light, display)
    image.save(path)
    (tmp_path / "display.toml").write_text(display_text(display))
    stream = ["stream", str(path), "--port", looped.url]
    assert run([*stream, "--display", str(tmp_path / "display.toml"), "--verify", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"][0]["verified"]
    wait_for(looped.folder, wanted)
    other = next(curve for curve in ("srgb", "linear") if curve != transfer)
    assert run([*stream, "--transfer", other]) == 2
    line = capsys.readouterr().err
    assert f"transfer is {transfer} in the file, {other} in --transfer" in line
    with Board.open(looped.url) as board:
        assert board.show(image).unchanged
        assert board.show(IntegralImage.load(path, display)).unchanged
        assert board.panel_crc() == zlib.crc32(wanted.tobytes())
        image.metadata["bits"] = "7"
        with pytest.raises(InputError, match=f"bits is 7 in its metadata, {bits} in its display"):
            board.show(image)
    assert captured(looped.folder)[-1] == wanted.tobytes()


@pytest.fixture(scope="module")
def looped(tmp_path_factory):
    """One board for the images of several displays that differ in their tones only."""
    folder = tmp_path_factory.mktemp("frames")
    with virtual_board.running(small(), capture=folder) as board:
        board.folder = folder
        yield board


#: Chances a byte or a packet, such that a frame of this size meets several of them.
FAULTS = {
    **{name: Faults(**{name: 3e-5}) for name in ("flip", "drop", "insert", "duplicate")},
    "garble": Faults(garble=3e-4),
    "reorder": Faults(reorder=2e-5),
    "cut": Faults(cut=2e-5, run=200),
    "stall": Faults(stall=2e-5, stall_s=0.3),
    "lose": Faults(lose=0.1),
    "repeat": Faults(repeat=0.2),
    "swap": Faults(swap=0.1),
    "delay": Faults(delay_s=0.01),
}


#: For every commit: all faults over one line, some over each.
OFTEN = {
    "socket-bytes": FAULTS, "pty-bytes": ("flip", "lose"), "socket-bits": ("flip",), "pty-bits": (),
    "sdram-bytes": ("cut",), "sdram-bits": (),
}  # fmt: skip


@pytest.mark.parametrize(
    ("virtual", "fault"),
    [
        pytest.param(line, fault, marks=() if fault in OFTEN[line] else pytest.mark.full)
        for line in LINES
        for fault in FAULTS
    ],
    indirect=["virtual"],
)
def test_a_bad_line_never_shows_a_wrong_frame(virtual, fault):
    """Frames go over a line with faults; when it is good again the last one is shown, and nothing else ever was."""
    images = [random_image(5), random_image(6), random_image(7)]
    faults = FAULTS[fault]
    begun = time.monotonic()
    with (
        Proxy(virtual.url, SEED, pty=virtual.url.startswith("/dev")) as line,
        Board.open(line.url, virtual.baud or BAUD, patience_s=15.0 if virtual.baud else 3.0) as board,
    ):
        line.down, line.up = faults, faults
        for image in images[:2]:
            try:
                send_frame(board, image)
            except DeviceError as error:
                print(f"{fault}: {error}")
        line.down, line.up = NO_FAULTS, NO_FAULTS
        board.hello()
        send_frame(board, images[2])
    wait_for(virtual.folder, images[2])
    assert_only(virtual.folder, images)
    # Two frames, each given up after its patience at the latest, and one over a good line.
    assert time.monotonic() - begun < 300


@pytest.mark.parametrize(
    ("port", "host_baud"),
    [
        ("tcp", 9_000_000),
        *(pytest.param(p, b, marks=pytest.mark.full) for p in ("tcp", "pty") for b in (12_000_000, 16_500_000)),
    ],
)
def test_bits_at_a_wrong_rate_harm_nothing(tmp_path, port, host_baud):
    """The far end of the wires sends and samples at another rate than the board's UART."""
    display = small(GRID[BAUD])
    with virtual_board.running(display, port=port, baud=BAUD, host_baud=host_baud, capture=tmp_path) as board:
        begun = time.monotonic()
        with pytest.raises(DeviceError, match=r"baud rate"):
            Board.open(board.url, patience_s=4.0)
        assert time.monotonic() - begun < 20
        assert not [frame for frame in captured(tmp_path) if any(frame)]


def test_the_whole_loop():
    image, display = random_image(15), small()
    with capturing(display) as loop:
        check = check_rays(loop.board, display, (5, 60), (10, 20))
        sent = send_frame(loop.board, image)
        assert loop.board.panel_crc() == sent.crc == zlib.crc32(image.tobytes())
    np.testing.assert_array_equal(loop.frames[-1], image)
    assert (check.rays, check.equal) == (56 * 11, True)
    assert min(loop.counts["clocks"], loop.counts["bytes_in"]) > 0
    assert loop.counts["broken_frames"] == 0


# A UART is given bytes that are wrong in test_a_bad_line_never_shows_a_wrong_frame.
@often_over("socket-bytes", "pty-bytes")
def test_random_and_mutated_bytes_harm_nothing(virtual):
    random = np.random.default_rng([SEED, 13])
    image = random_image(13)
    packets = [packed(int(random.integers(1, 9)), k, random.bytes(int(random.integers(0, 90)))) for k in range(200)]
    with Board.open(virtual.url) as board:
        send_frame(board, image)
        for packet in packets:
            mutated = bytearray(packet)
            for _ in range(int(random.integers(1, 4))):
                mutated[int(random.integers(len(mutated)))] ^= int(random.integers(1, 256))
            board.line.send(bytes(mutated) + random.bytes(int(random.integers(0, 40))), 5.0)
        board.line.send(b"\0", 1.0)
        # In step again at the next delimiter, and not a pixel has changed.
        board.hello()
        assert send_frame(board, image).sends == 0
    wait_for(virtual.folder, image)
    assert_only(virtual.folder, [image])


def raw_line(url):
    """A file descriptor of the line, its buffer small where it can be."""
    if url.startswith("/dev"):
        file = os.open(url, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(file)
        return file
    line = socket.socket()
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line.connect(("127.0.0.1", int(url.rsplit(":", 1)[1])))
    line.sendall(token_of(url))
    return line.detach()


@over_bytes
def test_a_slow_reader_loses_nothing(virtual):
    """More replies than all buffers hold wait until they are read."""
    count = 400 if virtual.baud else 3_000
    asked = b"".join(packed(Kind.READ, k, struct.pack("<HB", 0, 64)) for k in range(count))
    reader = PacketReader()
    numbers = []
    file = raw_line(virtual.url)

    left = asked

    def write():
        nonlocal left
        while left:
            left = left[os.write(file, left) :]

    sender = threading.Thread(target=write)
    try:
        sender.start()
        # All buffers are full, or all requests are on their way, once nothing more is taken for a while.
        before = None
        while before != len(left):
            before = len(left)
            time.sleep(0.2)
        while len(numbers) < count and select.select([file], [], [], 20.0)[0]:
            numbers += [packet.seq for packet in reader.feed(os.read(file, 65536))]
        sender.join()
    finally:
        os.close(file)
    assert numbers == list(range(count))


@often_over("socket-bytes")
def test_a_board_that_stalls_is_waited_for(virtual):
    image = random_image(14)
    with Board.open(virtual.url, patience_s=15.0) as board:
        virtual.process.send_signal(signal.SIGSTOP)
        threading.Timer(1.5, virtual.process.send_signal, [signal.SIGCONT]).start()
        send_frame(board, image)
    wait_for(virtual.folder, image)
    with Board.open(virtual.url, patience_s=2.0) as board:
        virtual.process.send_signal(signal.SIGSTOP)
        begun = time.monotonic()
        with pytest.raises(DeviceError, match="not answered"):
            board.read(0)
        assert time.monotonic() - begun < 10
        virtual.process.send_signal(signal.SIGCONT)


@pytest.mark.full  # a board of its own is compiled
def test_waveforms_of_a_window(tmp_path):
    file = tmp_path / "board.fst"
    with virtual_board.running(small(), trace=file, trace_clocks=(100, 2000)) as board, Board.open(board.url) as link:
        while link.read(BOARD_REGISTERS["clocks"].address)[0] < 2000:
            pass
    assert file.stat().st_size > 1000


def test_an_idle_board_needs_no_processor_and_wakes_at_once(quick):
    """Once what it was asked for is done; it shows the frame first."""
    image = random_image(21)
    with Board.open(quick.url) as board:
        send_frame(board, image)
        wait_for(quick.folder, image)
        clocks = BOARD_REGISTERS["clocks"].address

        def used():
            """Processor seconds of the board so far."""
            user, system = Path(f"/proc/{quick.process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
            return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

        until = time.monotonic() + 60.0
        share = 1.0
        while share > 0.3 and time.monotonic() < until:
            before, begun = used(), time.monotonic()
            time.sleep(0.5)
            share = (used() - before) / (time.monotonic() - begun)
        assert share <= 0.3
        first = board.read(clocks)[0]
        assert board.read(clocks)[0] > first
        send_frame(board, random_image(22))
    wait_for(quick.folder, random_image(22))


@over_bytes
def test_a_power_cycle_in_the_middle(virtual):
    before, image = random_image(9), random_image(8)
    with Board.open(virtual.url) as board:
        send_frame(board, before)
        seen = []

        def progress(done, total):
            seen.append(done)
            if done == 4:
                virtual.reset()

        try:
            send_frame(board, image, progress)
        except DeviceError as error:
            print(error)
        board.hello()
        send_frame(board, image)
    wait_for(virtual.folder, image)
    assert_only(virtual.folder, [before, image])


def test_an_interrupted_frame_goes_on_from_what_the_board_holds(quick):
    image = np.random.default_rng([SEED, 10]).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)

    class UnpluggedError(Exception):
        pass

    def progress(done, total):
        if done == 5:
            raise UnpluggedError

    with Board.open(quick.url) as board, pytest.raises(UnpluggedError):
        send_frame(board, image, progress, window_bytes=4000)
    with Board.open(quick.url) as board:
        sent = send_frame(board, image)
    # One tile was under way when the line broke.
    assert sent.sends <= 12 - 5 + 1
    assert sent.skipped >= 5
    wait_for(quick.folder, image)


def test_a_host_that_goes_makes_way_for_the_next(quick):
    """The board sees one host go and the next one come in the same moment, as on a machine under load."""
    for _ in range(5):
        before = Board.open(quick.url)
        address = BOARD_REGISTERS["lens"].address
        value = before.read(address)[0] ^ 1
        quick.process.send_signal(signal.SIGSTOP)
        before.line.send(packed(Kind.WRITE, before.next_seq(), struct.pack("<HI", address, value)), 1.0)
        before.close()
        threading.Timer(0.1, quick.process.send_signal, [signal.SIGCONT]).start()
        with Board.open(quick.url) as board:
            assert board.read(address) == [value]


def test_frames_that_cannot_be_kept_end_the_board(tmp_path):
    folder = tmp_path / "gone"
    folder.mkdir()
    board = virtual_board.start(small(), capture=folder)
    with Board.open(board.url) as link:
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()
        link.patience_s = 2.0
        with contextlib.suppress(DeviceError):
            send_frame(link, random_image(11))
        _, said = board.process.communicate(timeout=20)
    assert board.process.returncode == 3
    assert "gone" in said
