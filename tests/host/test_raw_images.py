"""Images of other programs, as numbers: right ones, and those that claim more than they hold."""

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from lippmann.base.images import read_numbers
from lippmann.errors import InputError
from PIL import Image

WORDS = "is not what is wanted", "give another"


def chunk(kind, data=b"", length=None):
    length = len(data) if length is None else length
    return struct.pack(">I", length) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, *chunks, colour_type=2):
    """Return a PNG of 8 bits, RGB if no other type is given, by the standard: signature, IHDR, and these chunks."""
    head = struct.pack(">IIBBBBB", width, height, 8, colour_type, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + b"".join(chunks)


def chunks(path):
    data, at, found = path.read_bytes(), 8, {}
    while at < len(data):
        size, name = struct.unpack(">I4s", data[at : at + 8])
        found.setdefault(name, data[at + 8 : at + 8 + size])
        at += 12 + size
    return found


def peak_mb():
    (most,) = (line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
    return int(most) / 1024


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("channels", [1, 3])
def test_numbers_are_those_of_the_file(tmp_path, suffix, bits, channels):
    if suffix == ".bmp" and bits == 16:
        bits = 8
    shape = (5, 7, 3)[: 2 + (channels > 1)]
    wanted = np.random.default_rng(1).integers(0, 1 << bits, shape, f"u{bits // 8}")
    assert cv2.imwrite(str(tmp_path / f"a{suffix}"), wanted)
    assert np.array_equal(read_numbers(tmp_path / f"a{suffix}", 35, *WORDS), wanted)


def test_a_picture_of_more_pixels_is_refused_by_its_claim(tmp_path):
    Image.new("L", (6, 6)).save(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"a\.png: has more than 3\.5e-05 megapixels; give a smaller image"):
        read_numbers(tmp_path / "a.png", 35, *WORDS)
    (tmp_path / "b.png").write_bytes(png(60_000, 60_000, chunk(b"IDAT", zlib.compress(bytes(100))), chunk(b"IEND")))
    with pytest.raises(InputError, match=r"b\.png: has more than 64 megapixels"):
        read_numbers(tmp_path / "b.png", 64_000_000, *WORDS)


def test_a_chunk_that_claims_gigabytes_takes_none(tmp_path, capfd):
    """OpenCV takes the memory of a chunk's length before it reads it."""
    row = zlib.compress(bytes(1 + 3 * 8) * 8)
    (tmp_path / "a.png").write_bytes(png(8, 8, chunk(b"IDAT", row, length=1_500_000_000)))
    before = peak_mb()
    with pytest.raises(InputError, match=r"a\.png: is not what is wanted; give another$"):
        read_numbers(tmp_path / "a.png", 1000, *WORDS)
    assert peak_mb() < before + 100.0
    assert capfd.readouterr().err == ""
    (tmp_path / "a.png").write_bytes(png(8, 8, chunk(b"IDAT", row), chunk(b"IEND")) + b"more bytes behind the end")
    assert read_numbers(tmp_path / "a.png", 1000, *WORDS).shape == (8, 8, 3)


@pytest.mark.parametrize("content", [b"", b"text", b"\x89PNG\r\n\x1a\n", b"P6 2 2 255 " + bytes(12)])
def test_what_is_no_picture_of_a_known_kind(tmp_path, content, capfd):
    """A portable pixmap is one of OpenCV's many, and none that is checked here."""
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError, match="is not what is wanted"):
        read_numbers(tmp_path / "a.png", 1000, *WORDS)
    os.mkfifo(tmp_path / "pipe.png")
    for name, why in (("b.png", "no such file"), ("pipe.png", "is not a plain file"), (".", "is a folder")):
        with pytest.raises(InputError, match=why):
            read_numbers(tmp_path / name, 1000, *WORDS)
    assert capfd.readouterr().err == ""
