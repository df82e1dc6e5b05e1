"""Hostile files: each is refused in one line, before it takes memory or time."""

import io
import os
import struct
import threading
import time
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest
from lippmann.base import file_limits, toml
from lippmann.base.images import read_picture
from lippmann.cli import run
from lippmann.display.description import load_display
from lippmann.errors import InputError
from lippmann.scenes.scene import load_scene
from scene_cases import small_toml
from test_raw_images import chunk, png

TINY = small_toml(64, 64, "dpi = 254")


def header(shape, kind="<f8"):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": kind, "fortran_order": False, "shape": shape})
    return stream.getvalue()


def archive(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            with file.open(f"{name}.npy", "w", force_zip64=True) as member:
                for part in data:
                    member.write(part)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(TINY)
    return tmp_path


def refused(capsys, *words, most_mb=20.0, seconds=20.0):
    """Return the line of a command that refuses a file, within this much of Python's memory and time."""
    tracemalloc.start()
    since = time.monotonic()
    try:
        code = run([*map(str, words), "--display", "tiny.toml"])
        peak = tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()
    lines = capsys.readouterr().err.splitlines()
    assert code == 2, lines
    assert len(lines) == 1
    assert peak < most_mb
    assert time.monotonic() - since < seconds
    return lines[0]


#: The pixels of 2.5 x 10^6 rays: 39 KB of zeros that expand to 40 MB.
ZEROS = [bytes(1 << 20)] * 38 + [bytes(40_000_000 - (38 << 20))]


@pytest.mark.parametrize("command", ["trace", "regress"])
def test_an_archive_is_counted_before_it_is_expanded(place, capsys, command, monkeypatch):
    archive("bomb.npz", pixel=[header((2_500_000, 2)), *ZEROS], direction=[header((2_500_000, 3))])
    assert (place / "bomb.npz").stat().st_size < 50_000
    monkeypatch.setattr(file_limits, "free_memory_mb", lambda: 500.0)
    words = ["trace", "-o", "r.npz", "--pixels"] if command == "trace" else ["regress", "--rays"]
    assert "bomb.npz: 2500000 rays: needs" in refused(capsys, *words, "bomb.npz")
    monkeypatch.setattr(file_limits, "free_memory_mb", lambda: 1e9)
    archive("more.npz", pixel=[header((file_limits.MAX_RAYS + 1, 2))], direction=[header((9, 3))])
    assert f"contains {file_limits.MAX_RAYS + 1} rays; give at most {file_limits.MAX_RAYS}" in refused(
        capsys, *words, "more.npz"
    )


def test_an_arrays_header_is_counted_before_it_is_read(place, capsys):
    """40 MB of spaces in a member of 40 KB; numpy's own limit looks at a header that it has read."""
    size = 40_000_000
    head = b"\x93NUMPY\x02\x00" + struct.pack("<I", size)
    archive("head.npz", pixel=[head, *[b" " * (1 << 20)] * 38], direction=[header((9, 3))])
    assert f"array header, expected {size} bytes" in refused(
        capsys, "trace", "-o", "r.npz", "--pixels", "head.npz", most_mb=5.0
    )


def test_an_errors_line_ends(capsys):
    assert run(["inspect", "x" * 5000]) == 2
    assert len(capsys.readouterr().err) < 1100


BROKEN = {
    "an object": header((3, 2), "|O"),
    "wide": header((3, 2), "|S2000000000"),
    "not real": header((3, 2), "<c16"),
    "records": header((3,), [("u", "<f8"), ("v", "<f8")]),
    "one row of all": header((1, 10**12)),
    "endless": header((10**30, 2)),
    "negative": header((-3, 2)),
    "cut": header((3, 2)) + bytes(5),
    "no numpy": b"nothing of use",
    "version": b"\x93NUMPY\x09\x00" + bytes(20),
    "code": b"\x93NUMPY\x01\x00\x40\x00__import__('os').system('touch harmed')".ljust(74) + bytes(40),
    "nest": b"\x93NUMPY\x02\x00" + struct.pack("<I", 2000) + b"(" * 2000,
}


@pytest.mark.parametrize("name", BROKEN)
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_broken_arrays(place, capsys, name, suffix):
    if suffix == ".npy":
        (place / "bad.npy").write_bytes(BROKEN[name])
    else:
        archive("bad.npz", pixel=[BROKEN[name]], direction=[header((3, 3)), bytes(72)])
        refused(capsys, "regress", "--rays", "bad.npz")
    assert "bad.np" in refused(capsys, "trace", "--pixels", f"bad{suffix}", "-o", "r.npz")
    assert not (place / "harmed").exists()


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, "a" + ".a" * 20_000 + " = 1", "[" + "a." * 20_000 + "a]", '"a"."b".' * 20_000 + "c = 1",
     "a = " + "9" * 100_000, "a = " + "{a=" * 5_000, "a" * 900_000, '"' * 900_000, "a=[" + "'',\n" * 200_000 + "]"],
    ids=range(9),
)  # fmt: skip
def test_hostile_toml(place, text):
    (place / "bad.toml").write_text(text if "=" in text else f"x = {text}")
    since = time.monotonic()
    with pytest.raises(InputError, match=r"^bad\.toml: [^\n]*$"):
        load_display("bad.toml")
    assert time.monotonic() - since < 10.0


def test_keys_of_some_parts_and_many_numbers_are_read():
    text = ".".join("k" * 30) + " = 1\nlist = [" + "0.5, 1.25, 2.125, " * 1000 + "]\ntext = 'a.b'\n"
    assert len(toml.parse(text, "here")["list"]) == 3000


@pytest.mark.parametrize("reader", [lambda: load_display("big.toml"), lambda: load_scene("big.xml")])
def test_endless_files_are_cut(place, reader, mi, monkeypatch):
    monkeypatch.setattr(file_limits, "MAX_XML_BYTES", 1 << 20)
    name = "big.toml" if "toml" in str(reader.__code__.co_consts) else "big.xml"
    os.mkfifo(name)
    monkeypatch.setattr("pathlib.Path.is_file", lambda self: True)
    written = [0]

    def feed():
        with open(name, "wb", buffering=0) as stream:
            try:
                while written[0] < 1 << 26:
                    written[0] += stream.write(b"# nothing\n" * 1000)
            except BrokenPipeError:
                pass

    feeder = threading.Thread(target=feed)
    feeder.start()
    with pytest.raises(InputError, match=rf"{name}: is larger than 1 MB; "):
        reader()
    feeder.join()
    assert written[0] < 1 << 22


def test_scenes_that_nest_too_deeply(place, mi):
    """Mitsuba's parser ends with a segmentation fault."""
    inside = '<shape type="sphere">' * 20_000 + "</shape>" * 20_000
    (place / "deep.xml").write_text(f'<scene version="3.0.0">{inside}</scene>')
    with pytest.raises(InputError, match=r"^deep\.xml: nests elements more than 500 deep \(line 1\); mend"):
        load_scene("deep.xml")
    (place / "outer.xml").write_text('<scene version="3.0.0"><include filename="deep.xml"/></scene>')
    with pytest.raises(InputError, match=r"deep\.xml: nests elements more than 500 deep"):
        load_scene("outer.xml")
    (place / "torn.xml").write_text(f'<scene version="3.0.0">&none;{inside}</scene>')
    with pytest.raises(InputError, match=r"torn\.xml: is not XML \("):
        load_scene("torn.xml")


def test_a_small_picture_of_a_large_size_is_not_expanded(place, monkeypatch):
    data = chunk(b"IDAT", zlib.compress(bytes(1 << 20)))
    (place / "bomb.png").write_bytes(png(16_000, 16_000, data, chunk(b"IEND")))
    monkeypatch.setattr(file_limits, "free_memory_mb", lambda: 1000.0)
    with pytest.raises(InputError, match=r"bomb\.png: 16000 x 16000 pixels: needs 6144 MB, the limit is 800 MB; use"):
        read_picture("bomb.png")


def test_tables_of_text(place, capsys, monkeypatch):
    monkeypatch.setattr("lippmann.cli.trace.MAX_TABLE_BYTES", 1 << 20)
    (place / "long.csv").write_text("1,2\n" * 300_000)
    assert "long.csv: is larger than 1 MB; give" in refused(capsys, "trace", "--pixels", "long.csv", "-o", "r.npz")
    (place / "wide.csv").write_text("1," * 200_000)
    refused(capsys, "trace", "--pixels", "wide.csv", "-o", "r.npz")
    (place / "digits.csv").write_text("9" * 500_000 + ",1\n")
    refused(capsys, "trace", "--pixels", "digits.csv", "-o", "r.npz")
    (place / "field.csv").write_text("9" * 500_000 + ",1\n")
    refused(capsys, "regress", "--rays", "field.csv")
    monkeypatch.setattr("lippmann.conformance.vector_files.MAX_TABLE_BYTES", 1 << 18)
    assert "is larger than 256 KB" in refused(capsys, "regress", "--rays", "field.csv")


@pytest.mark.parametrize("heading", ["", "u,v\n", " U , V # pixels\n", "# of the corner\n\nu,v\n"])
@pytest.mark.parametrize("end", ["\n", "\r\n", ""])
def test_tables_are_read_as_before(place, heading, end):
    (place / "few.csv").write_bytes((heading + "1,2\n\n3,4 # last" + end).encode())
    assert run(["trace", "--pixels", "few.csv", "--display", "tiny.toml", "-o", "r.npz"]) == 0
    assert np.load("r.npz")["pixel"].tolist() == [[1.5, 2.5], [3.5, 4.5]]
