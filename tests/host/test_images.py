"""Image files: curves, round trips, metadata, and files that appear whole or not at all."""

import math
import os
import struct
import subprocess
import sys
import textwrap
import zlib
from functools import partial

import numpy as np
import OpenImageIO as oiio
import pytest
from lippmann.base.animation import FRAME_MS, write_animation, write_contact_sheet
from lippmann.base.images import StoredRows, check_output, read_picture, write_picture
from lippmann.base.tones import decode, encode
from lippmann.board.panel_frames import Target, load_frame
from lippmann.errors import InputError
from PIL import Image
from scene_cases import generator
from test_raw_images import chunk, chunks, png

SEED = 4404
META = {
    "display": "paper-square",
    "identity": "79ee8471d40b2533",
    "model": "exact",
    "seed": "7",
    "equation": "a = b; c",
    "version": "0.1.0",
}


def srgb_by_hand(light: float) -> float:
    """IEC 61966-2-1, in double."""
    return 12.92 * light if light <= 0.0031308 else 1.055 * math.pow(light, 1.0 / 2.4) - 0.055


def picture(*key, height=13, width=17):
    return generator(SEED, *key).random((height, width, 3), np.float32)


def test_srgb_values():
    light = np.concatenate([np.linspace(0.0, 0.01, 100), np.linspace(0.0, 1.0, 200)])
    np.testing.assert_allclose(encode(light, "srgb"), [srgb_by_hand(x) for x in light], atol=3e-7)
    # Table values everyone knows: 18 % grey is 118, half the light 188.
    assert [round(float(encode(np.array(x), "srgb")) * 255) for x in (0.18, 0.5, 1.0)] == [118, 188, 255]
    assert float(encode(np.array(0.5), "gamma2.2")) == pytest.approx(math.pow(0.5, 1.0 / 2.2), rel=1e-6)
    # Light out of range is clipped, but for one rounding of float32 in 1.055 - 0.055.
    np.testing.assert_allclose(encode(np.array([-1.0, 2.0, math.inf]), "srgb"), [0.0, 1.0, 1.0], atol=1e-7)


@pytest.mark.parametrize("curve", [encode, decode])
def test_unknown_transfer_is_refused(curve):
    with pytest.raises(InputError, match=r"pq.*srgb"):
        curve(np.zeros(1), "pq")


@pytest.mark.parametrize("height", [1, 63, 64, 65, 130])
@pytest.mark.parametrize("suffix", [".exr", ".tif", ".tiff", ".png", ".EXR"])
def test_light_metadata_and_size_come_back(tmp_path, suffix, height):
    """Of one band and of several, without a seam."""
    light = picture(suffix, height=height)
    if suffix != ".png":
        light[0, 0] = -0.5, 100.0, 60000.0
    path = tmp_path / f"picture{suffix}"
    write_picture(path, light, META)
    back = read_picture(path, limit=(17, height))
    assert {key: back.metadata[key] for key in META} == META
    assert back.radiance.dtype == np.float32
    # Half floats keep 11 bits, 8-bit sRGB a step of at most 1 / 255 times the curve's slope 1 / 0.44.
    relative, absolute = {".exr": (2.0**-11, 2.0**-24), ".png": (0.0, 0.5 / 255 * 2.3)}.get(suffix.lower(), (0.0, 0.0))
    np.testing.assert_allclose(back.radiance, light, rtol=relative, atol=absolute)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("transfer", ["srgb", "gamma2.2", "linear"])
@pytest.mark.parametrize("bits", [1, 5, 6, 8, 9, 12, 16])
def test_png_holds_the_panels_levels(tmp_path, bits, transfer):
    """Read by Pillow (8 bits) or raw (16): the nearest of 2^bits levels, spread over the file's range.

    PNG 11.3.2.2: gAMA is the exponent of the encoding times 100000; sRGB comes with 45455.
    """
    light = picture(bits, transfer, height=64, width=64)
    path = tmp_path / "panel.png"
    write_picture(path, light, {}, transfer, bits)
    parts = chunks(path)
    assert struct.unpack(">I", parts[b"gAMA"]) == (100_000 if transfer == "linear" else 45_455,)
    assert (b"sRGB" in parts) == (transfer == "srgb")
    levels = 2**bits - 1
    values = {"linear": light, "gamma2.2": np.power(light.astype(float), 1.0 / 2.2)}.get(
        transfer, np.vectorize(srgb_by_hand)(light.astype(float))
    )
    deep = bits > 8
    full = 65535 if deep else 255
    source = oiio.ImageInput.open(str(path))
    raw = np.asarray(source.read_image(oiio.UINT16 if deep else oiio.UINT8), float)
    assert source.spec().format == (oiio.UINT16 if deep else oiio.UINT8)
    source.close()
    assert set(np.unique(raw)) <= {round(k * full / levels) for k in range(levels + 1)}
    level = raw * levels / full
    # float32 may round a value on the border between two levels either way.
    assert np.abs(np.rint(level) - values * levels).max() <= 0.5 + 0.01
    if not deep:
        np.testing.assert_array_equal(np.asarray(Image.open(path)), raw)
    back = read_picture(path).radiance
    # Half a level at the panel and half at the file, through the steepest slope of the decoding curve.
    assert np.abs(back - light).max() <= (0.5 / levels + 0.5 / full) * 2.4 + 1e-6


def test_grey_and_alpha_files_are_read(tmp_path):
    grey, alpha = tmp_path / "grey.png", tmp_path / "alpha.png"
    Image.fromarray(np.full((4, 5), 188, np.uint8)).save(grey)
    Image.fromarray(np.full((4, 5, 4), (188, 118, 0, 255), np.uint8)).save(alpha)
    for path, expected in ((grey, (0.5, 0.5, 0.5)), (alpha, (0.5, 0.18, 0.0))):
        back = read_picture(path)
        assert back.radiance.shape == (4, 5, 3)
        np.testing.assert_allclose(back.radiance[0, 0], expected, atol=0.005)
        assert back.metadata == {}


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.exr.bak", ".exr"])
def test_unknown_extensions_are_refused(tmp_path, name):
    with pytest.raises(InputError, match=r"unknown extension.*choose from \.exr"):
        check_output(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_be_written_are_refused(tmp_path, monkeypatch):
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(InputError, match=r"folder\.png: is a folder"):
        check_output(tmp_path / "folder.png")
    with pytest.raises(InputError, match=r"missing does not exist; make the folder"):
        check_output(tmp_path / "missing" / "a.png")
    # Root may write anywhere, but not there, though its permissions allow it.
    with pytest.raises(InputError, match=r"a\.png: cannot be written \(.+\); free space or choose another place"):
        check_output("/proc/a.png")
    check_output(tmp_path / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["folder.png"]
    # Ask as one who may not.
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match=r"a\.png: cannot be written; choose another folder"):
        check_output(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".png"])
def test_truncated_files_are_refused(tmp_path, suffix, capfd):
    """Libraries print no line of their own, as libpng does; and of what a library says one line is told."""
    path = tmp_path / f"a{suffix}"
    write_picture(path, picture("truncated", suffix, height=64, width=64), META)
    whole = path.read_bytes()
    for share in (0.0, 0.02, 0.5, 0.9):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=rf"a\{suffix}: is (not an image|truncated or broken)") as caught:
            read_picture(path)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < len(str(path)) + 170
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["a.exr", "a.png", "a.tif", "a.toml"])
def test_files_that_are_no_image_are_refused(tmp_path, name):
    path = tmp_path / name
    path.write_text("width_px = 3\n" * 50)
    with pytest.raises(InputError, match=r"is not an image.*give an EXR, TIFF or PNG"):
        read_picture(path)
    with pytest.raises(InputError, match="no such image"):
        read_picture(tmp_path / "absent.exr")
    with pytest.raises(InputError, match="is a folder; give an image"):
        read_picture(tmp_path)


def test_a_header_that_claims_too_much_is_told_as_a_size(tmp_path):
    """OpenImageIO refuses 100000 x 100000 before it tells the size."""
    path = tmp_path / "a.exr"
    spec = oiio.ImageSpec(100_000, 100_000, 3, oiio.HALF)
    spec.attribute("compression", "zip")
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    out.close()
    with pytest.raises(InputError, match=r"is 100000 x 100000 pixels, but the panel is 17 x 13; render the image"):
        read_picture(path, limit=(17, 13))


def test_texts_that_swell_are_refused(tmp_path):
    path = tmp_path / "a.png"
    text = chunk(b"zTXt", b"key\0\0" + zlib.compress(bytes(7_000_000), 9))
    rest = chunk(b"IDAT", zlib.compress(bytes(4 * (1 + 3 * 4)))), chunk(b"IEND")
    path.write_bytes(png(4, 4, text, *rest))
    assert read_picture(path).radiance.shape == (4, 4, 3)
    # Six gigabytes of text.
    path.write_bytes(png(4, 4, *[text] * 900, *rest))
    with pytest.raises(InputError, match=r"texts; render the image again"):
        read_picture(path)


def test_a_picture_that_is_not_wanted_is_not_read(tmp_path):
    """The header is whole, the pixels are not: who refuses the header never comes to them."""
    path = tmp_path / "a.png"
    write_picture(path, picture("wanted", height=64, width=64), META)
    path.write_bytes(path.read_bytes()[:-4000])
    seen = []

    def refuse(metadata):
        seen.append(metadata["identity"])
        raise InputError("not wanted")

    with pytest.raises(InputError, match="not wanted"):
        read_picture(path, accept=refuse)
    assert seen == [META["identity"]]
    with pytest.raises(InputError, match="rendered for display 79ee8471d40b2533"):
        load_frame(path, Target(1, 64, 64))


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".png"])
@pytest.mark.parametrize(
    ("library", "name", "error", "expected", "message"),
    [
        (
            os,
            "replace",
            partial(OSError, 13, "No"),
            InputError,
            r"a\.\w+: cannot be written \(No\); free space",
        ),
        (oiio.ImageOutput, "write_scanlines", KeyboardInterrupt, KeyboardInterrupt, None),
    ],
    ids=["replace", "interrupt"],
)
def test_a_failing_write_leaves_the_old_file_alone(
    tmp_path, monkeypatch, suffix, library, name, error, expected, message
):
    path = tmp_path / f"a{suffix}"
    write_picture(path, picture("old"), {"age": "old"})
    old = path.read_bytes()

    def fail(*_):
        raise error()

    monkeypatch.setattr(library, name, fail)
    with pytest.raises(expected, match=message):
        write_picture(path, picture("new"), {"age": "new"})
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".png"])
def test_a_file_that_does_not_fit_is_told(tmp_path, suffix):
    """The limit of a file's size stands for a full disk: a write comes back short, and then fails."""
    script = """
        import resource, sys
        import numpy as np
        from lippmann.errors import NoSpaceError
        from lippmann.base.images import write_picture
        light = np.random.default_rng(1).random((64, 64, 3)).astype(np.float32)
        for limit in (0, 100, 4096, 10_000):
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
            try:
                write_picture(sys.argv[1], light, {})
            except NoSpaceError as error:
                print(error)
    """
    path = tmp_path / f"a{suffix}"
    write_picture(path, picture("old"), {"age": "old"})
    old = path.read_bytes()
    command = [sys.executable, "-c", textwrap.dedent(script), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 4, done.stdout
    assert all("cannot be written (" in line and "free space" in line for line in lines), done.stdout
    assert done.stderr == ""
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".gif", ".png", ".apng"])
def test_animations_run_to_and_fro(tmp_path, suffix):
    views = [np.full((6, 8, 3), light, np.float32) for light in (0.0, 0.2, 0.5, 1.0)]
    path = tmp_path / f"sweep{suffix}"
    write_animation(path, views)
    shown = []
    with Image.open(path, formats=["GIF" if suffix == ".gif" else "PNG"]) as film:
        assert film.n_frames == 6
        for k in range(film.n_frames):
            film.seek(k)
            assert film.info["duration"] == FRAME_MS
            shown.append(int(np.asarray(film.convert("RGB"))[0, 0, 0]))
    expected = [round(255 * srgb_by_hand(light)) for light in (0.0, 0.2, 0.5, 1.0, 0.5, 0.2)]
    # A GIF's palette may be a level off.
    np.testing.assert_allclose(shown, expected, atol=1 if suffix == ".gif" else 0)
    assert list(tmp_path.iterdir()) == [path]


def test_contact_sheets_hold_every_view(tmp_path):
    views = [np.full((10, 12, 3), light, np.float32) for light in (0.1, 0.4, 0.7, 1.0)]
    path = tmp_path / "sheet.png"
    write_contact_sheet(path, views, ["one", "two", "three", "four"], columns=3)
    sheet = np.asarray(Image.open(path))
    for light in (0.1, 0.4, 0.7, 1.0):
        level = round(255 * srgb_by_hand(light))
        assert (sheet == level).all(axis=2).sum() >= 120


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".png"])
def test_metadata_with_line_breaks_stay(tmp_path, suffix):
    values = ("first\nsecond\n\tthird\n", "a = b", "one\u2028line", "one\n\ttwo\n\nthree", "a\r\nb", "\nstarts")
    metadata = {f"note {k}": value for k, value in enumerate(values)}
    write_picture(tmp_path / f"a{suffix}", np.zeros((4, 4, 3), np.float32), metadata)
    assert read_picture(tmp_path / f"a{suffix}").metadata.items() >= metadata.items()


@pytest.mark.parametrize("suffix", [".tif", ".exr"])
@pytest.mark.parametrize("tile", [(0, 0), (64, 48), (16, 160)], ids=str)
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_other_programs_files_are_read_by_rows_and_whole(tmp_path, suffix, tile, channels):
    """Scanlines and tiles, whose rows are no multiple of a band; the data window of an EXR begins anywhere."""
    values = generator(SEED, "tiles", channels).random((150, 100, channels), np.float32)
    spec = oiio.ImageSpec(100, 150, channels, oiio.FLOAT)
    spec.tile_width, spec.tile_height = tile
    spec.x, spec.y = (-7, 9) if suffix == ".exr" else (0, 0)
    path = tmp_path / f"other{suffix}"
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(values), out.geterror()
    assert out.close(), out.geterror()
    expected = np.broadcast_to(values, (150, 100, 3)) if channels == 1 else values[:, :, :3]
    assert np.array_equal(read_picture(path).radiance, expected)
    with StoredRows(path, (100, 150)) as rows:
        for first, last in ((0, 3), (2, 70), (47, 49), (100, 150), (149, 150), (5, 5), (0, 150)):
            assert np.array_equal(rows[first:last], expected[first:last])
        assert np.array_equal(rows[-1], expected[-1])
        assert np.array_equal(rows[::3, 2:5], expected[::3, 2:5])
        assert np.array_equal(np.asarray(rows), expected)


def test_rows_on_disk_are_closed_with_their_block(tmp_path):
    values = np.linspace(0.0, 1.0, 128 * 4 * 3, dtype=np.float32).reshape(128, 4, 3)
    write_picture(tmp_path / "a.tif", values, {})
    before = set(os.listdir("/proc/self/fd"))
    with StoredRows(tmp_path / "a.tif", (4, 128)) as rows:
        assert np.array_equal(rows[3:70], values[3:70])
    assert set(os.listdir("/proc/self/fd")) == before
    rows.close()
    with pytest.raises(ValueError, match="closed"):
        rows[100:120]
