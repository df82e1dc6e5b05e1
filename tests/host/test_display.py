"""The display file: what it means, what it refuses, and how it says so."""

import json
import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lippmann.base.toml import toml_text
from lippmann.calibration.coded_patterns import PatternSet, read_patterns
from lippmann.display.description import Array, Display, Panel, display_text, load_display, parse_display
from lippmann.display.glass import SELLMEIER, index_of
from lippmann.display.subpixels import LAYOUTS
from lippmann.errors import InputError
from truth import mp

SEED = 466
PANEL = {"width_px": 640, "height_px": 480, "pixel_pitch_mm": 0.05}
ARRAY = {"grid": "hex", "pitch_mm": 1.0, "index": 1.5, "radius_mm": 2.0}


def toml(panel=PANEL, array=ARRAY, gap_mm=0.5, **top) -> str:
    """TOML text; JSON's numbers, strings, arrays and booleans are TOML's too."""

    def lines(table):
        return "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items())

    top = {**top, **({} if gap_mm is None else {"gap_mm": gap_mm})}
    return f"{lines(top)}[panel]\n{lines(panel)}[array]\n{lines(array)}"


def but(table, **changes):
    """A table with keys changed, or taken out when None."""
    return {k: v for k, v in {**table, **changes}.items() if v is not None}


pitches = st.floats(0.05, 20)


@st.composite
def displays(draw):
    """A buildable display, in the terms of `Display` itself."""
    grid, pitch = draw(st.sampled_from(("square", "hex"))), draw(pitches)
    rho = pitch / math.sqrt({"square": 2, "hex": 3}[grid])
    # Rows from half to twice as far apart and a shear of up to 0.3 make half diagonals at most 2.5 times as long.
    shear = draw(st.sampled_from((0.0, 0.0012, -0.3)))
    rows = draw(st.sampled_from((None, pitch / 2, 1.001 * pitch, 2 * pitch)))
    if shear or rows:
        rho *= 2.5
    glass = draw(st.sampled_from((None, *SELLMEIER)))
    radius = rho * draw(st.floats(1.0001, 1e4))
    array = Array(
        grid=grid,
        pitch_mm=pitch if rows is None else (pitch, rows),
        radius_mm=radius,
        index=draw(st.floats(1.01, 4)) if glass is None else index_of(glass),
        thickness_mm=rho + draw(st.floats(0, 20)),  # the sag is at most rho
        plano_side=draw(st.sampled_from(("panel", "viewer"))),
        glass=glass,
        rotation_deg=draw(st.floats(-360, 360)),
        offset_mm=(draw(st.floats(-10, 10)), draw(st.floats(-10, 10))),
        shear=shear,
    )
    fine = array.finest_mm / draw(st.floats(1.001, 200))
    white = draw(st.none() | st.floats(1.0, 2000.0))
    panel = Panel(
        width_px=draw(st.integers(1, 65535)),
        height_px=draw(st.integers(1, 65535)),
        pixel_pitch_mm=draw(st.sampled_from((fine, (fine, 0.7 * fine), (0.3 * fine, fine)))),
        subpixels=draw(st.sampled_from(("none", "rgb", "bgr", "rgbw", "pentile", LAYOUTS["pentile"]))),
        bits=draw(st.integers(1, 16)),
        transfer=draw(st.sampled_from(("srgb", "linear", "gamma2.2", ((0.0, 0.0), (1 / 3, 0.1), (1.0, 1.0))))),
        white_cd_m2=white,
        black_cd_m2=None if white is None else draw(st.sampled_from((None, 0.0, white / 1000))),
    )
    if draw(st.booleans()):
        # From lenslets all over the panel to some more, whatever the offset.
        size = max(panel.width_mm, panel.height_mm) + 60 + 3 * array.coarsest_mm
        if size < 90 * math.hypot(panel.width_mm, panel.height_mm):
            array = replace(array, extent_mm=(size, size * draw(st.floats(1, 1.1))))
    name = draw(st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), max_size=12))
    display = Display(name, panel, array, draw(st.floats(0, 100)))
    nearest = 4.0001 * max(array.focal_length_mm, display.aperture_distance_mm)
    if draw(st.booleans()):
        axis = (draw(st.floats(-300, 300)), draw(st.floats(-300, 300)))
        display = replace(display, viewing_distance_mm=nearest * draw(st.floats(1, 1e4)), viewing_axis_mm=axis)
    return display


@given(displays())
def test_round_trip(display):
    """What was written is read back to the last bit, also with comments and the tables in another order."""
    text = display_text(display)
    panel, array = text.index("[panel]"), text.index("[array]")
    for written in (text, text[:panel] + "# turned round\n" + text[array:] + text[panel:array]):
        read = parse_display(written)
        assert read == display
        assert read.identity == display.identity
    assert re.fullmatch("[0-9a-f]{16}", display.identity)


@given(
    grid=st.sampled_from(("square", "hex")),
    pitch=pitches,
    steepness=st.floats(1.0 + 1e-9, 1e6),
    index=st.floats(1.01, 4),
    by=st.sampled_from(("radius", "focal")),
)
def test_equations_2_3_4(grid, pitch, steepness, index, by):
    """Focal length, flat-face distance and sag of the thinnest lenslet, against 50 digits."""
    square_of_rho = mp.mpf(pitch) ** 2 / {"square": 2, "hex": 3}[grid]
    radius = float(mp.sqrt(square_of_rho)) * steepness
    array = {"grid": grid, "pitch_mm": pitch, "index": index}
    if by == "radius":
        array["radius_mm"] = radius
    else:
        array["focal_length_mm"] = radius / (index - 1)
    display = parse_display(toml(but(PANEL, pixel_pitch_mm=pitch / 10), array))
    made = display.array

    # Two or three roundings of the factors, and 1 / (index - 1) near index 1.01.
    R, n = mp.mpf(made.radius_mm), mp.mpf(index)
    assert abs(mp.mpf(made.focal_length_mm) * (n - 1) / R - 1) < 4e-16
    assert abs(mp.mpf(made.radius_mm) / mp.mpf(radius) - 1) < 4e-16
    d = mp.sqrt(R**2 - square_of_rho)
    # R - rho has the rounding of rho: relative to it where R is nearly rho.
    conditioning = 1 / (1 - square_of_rho / R**2)
    assert abs(mp.mpf(made.flat_distance_mm) / d - 1) < 1e-15 * conditioning
    sag = R - d
    # The sag keeps its digits, also where R - d of floats had none left (steepness 1e6).
    assert abs(mp.mpf(made.sag_mm) / sag - 1) < 1e-15 * (1 + d / R * conditioning)
    assert made.thickness_mm == made.sag_mm
    assert abs(mp.mpf(made.half_diagonal_mm) / mp.sqrt(square_of_rho) - 1) < 4e-16


@pytest.mark.parametrize("grid", ["square", "hex"])
@pytest.mark.parametrize(("key", "per_radius"), [("radius_mm", 1.0), ("focal_length_mm", 2.0)])
def test_hemisphere_is_the_limit(grid, key, per_radius):
    """Of a cell 1 mm wide, at index 1.5."""
    rho = 1 / math.sqrt({"square": 2, "hex": 3}[grid])
    array = but(ARRAY, grid=grid, radius_mm=None)
    assert parse_display(toml(array={**array, key: per_radius * rho})).array.flat_distance_mm < 2e-8
    too_small = math.nextafter(per_radius * rho, 0)
    refused(toml(array={**array, key: too_small}), "array.radius_mm: ", "too small", "larger")


@given(st.floats(1, 20000))
def test_dpi_is_pixels_an_inch(dpi):
    by_dpi = but(PANEL, pixel_pitch_mm=None, dpi=dpi)
    array = but(ARRAY, pitch_mm=30.0, radius_mm=40.0)
    display = parse_display(toml(by_dpi, array))
    assert abs(mp.mpf(display.panel.pixel_pitch_mm) * mp.mpf(dpi) / mp.mpf("25.4") - 1) < 4e-16
    by_pitch = parse_display(toml(but(PANEL, pixel_pitch_mm=25.4 / dpi), array))
    assert by_pitch.identity == display.identity
    assert abs(display.panel.width_mm - 640 * 25.4 / dpi) <= 1e-15 * 640 * 25.4
    assert abs(display.panel.height_mm - 480 * 25.4 / dpi) <= 1e-15 * 640 * 25.4


def test_aperture_distance():
    """D of optics.md in its three cases, by hand."""
    array = but(ARRAY, thickness_mm=3.0)
    assert parse_display(toml(array=array)).aperture_distance_mm == 0.5 + 3.0 / 1.5
    viewer = but(array, plano_side="viewer")
    assert parse_display(toml(array=viewer)).aperture_distance_mm == 0.5
    touching = parse_display(toml(array=viewer, gap_mm=0.0))
    assert abs(touching.aperture_distance_mm - (2.0 - math.sqrt(4.0 - 1 / 3))) < 1e-15


def test_defaults():
    display = parse_display(toml(), "dir/fish.toml")
    assert display.name == "fish"
    assert (display.panel.subpixels, display.panel.bits, display.panel.transfer) == ("none", 8, "srgb")
    assert (display.array.plano_side, display.array.rotation_deg) == ("panel", 0.0)
    assert (display.array.offset_mm, display.array.glass) == ((0.0, 0.0), None)


OPTICAL_CHANGES = {
    "panel.width_px": [641],
    "panel.height_px": [481],
    "panel.pixel_pitch_mm": [math.nextafter(0.05, 1), [0.05, 0.050001]],
    "panel.subpixels": [
        *("rgb", "bgr", "rgbw", "pentile"),
        [["red", -0.25, 0.0, 0.5, 1.0], ["green", 0.25, 0.25, 0.5, 0.5], ["blue", 0.25, -0.25, 0.5, 0.5]],
    ],
    "array.grid": ["square"],
    "array.pitch_mm": [1.0000001, [1.0, 1.0000001]],
    "array.shear": [1e-9, -1e-9],
    "array.extent_mm": [[20.0, 10.0], [20.0, 10.000001]],
    "array.index": [1.5000001],
    "array.glass": ["PMMA", "N-BK7"],
    "array.radius_mm": [2.0000001],
    "array.focal_length_mm": [4.1],
    "array.thickness_mm": [2.0],
    "array.plano_side": ["viewer"],
    "array.rotation_deg": [0.001, -0.001],
    "array.offset_mm": [[0.001, 0.0], [0.0, 0.001]],
    "gap_mm": [0.5000001],
    "viewing_distance_mm": [600.0, 600.0000001],
}


def test_identity_changes_with_every_optical_key():
    texts = [with_raw(place, json.dumps(value)) for place, values in OPTICAL_CHANGES.items() for value in values]
    texts += [toml(viewing_distance_mm=600.0, viewing_axis_mm=axis) for axis in ([0.001, 0.0], [0.0, 0.001])]
    assert len({parse_display(text).identity for text in (toml(), *texts)}) == len(texts) + 1


def test_identity_ignores_the_rest():
    for change in (
        {"name": "another"},
        {"panel": but(PANEL, bits=10)},
        {"panel": but(PANEL, transfer="linear")},
        {"panel": but(PANEL, transfer=[[0, 0], [0.5, 0.3], [1, 1]])},
        {"panel": but(PANEL, white_cd_m2=300, black_cd_m2=1)},
        # The same said otherwise.
        {"panel": but(PANEL, pixel_pitch_mm=[0.05, 0.05], subpixels="none")},
        {"array": but(ARRAY, pitch_mm=[1.0, 1.0], shear=0.0)},
        {"array": but(ARRAY, radius_mm=2, shear=-0.0)},
        {"array": but(ARRAY, plano_side="panel", rotation_deg=0, offset_mm=[0, 0])},
        {"array": but(ARRAY, radius_mm=None, focal_length_mm=4.0)},
        {"viewing_axis_mm": [0, 0.0]},
    ):
        assert parse_display(toml(**change)).identity == parse_display(toml()).identity, change


def test_identities_of_the_shipped_displays():
    """Images that were rendered for them carry these; a new key with a default leaves them as they are."""
    shipped = {
        "desktop-hex": "3ab680fe0f19c324",
        "hd-square": "507097880726521b",
        "measured-hex": "a7cdbfb3362efdde",
        "paper-hex": "52c22853410732dc",
        "paper-hex-real": "353d2e342a917c34",
        "paper-square": "79ee8471d40b2533",
        "paper-square-real": "3a710a37a28dfaa7",
        "uhd-4k": "285861cf483aecd3",
        "uhd-8k": "8d297f2f07190d8d",
        "vga-hex": "f13c0874d129161a",
        "vga-square": "fff26505bc0c5ffc",
    }
    folder = Path(__file__).parents[2] / "scenes/displays"
    assert {path.stem: load_display(path).identity for path in folder.glob("*.toml")} == shipped


def test_identity_of_a_glass_holds_at_every_wavelength():
    display = parse_display(toml(array=but(ARRAY, index=None, glass="PMMA")))
    blue = display.at_wavelength(450.0)
    assert blue.array.index > display.array.index
    assert blue.identity == display.identity
    assert display.at_wavelength(587.5618) == display


def test_misaligned_is_another_display():
    display = parse_display(toml(array=but(ARRAY, thickness_mm=0.5)))
    assert display.misaligned() == display
    moved = display.misaligned(1.0, (0.1, -0.2), 0.25, 1.001)
    assert moved.array.rotation_deg == 1.0
    assert moved.array.offset_mm == (0.1, -0.2)
    assert moved.gap_mm == 0.75
    assert moved.array.pitch_mm == 1.001
    assert moved.identity != display.identity
    for said, errors in (
        (r"gap_mm.*negative", {"gap_mm": -0.6}),
        ("too small", {"pitch_scale": 4.0}),
        (r"\[x, y\]", {"offset_mm": 5}),
        (r"pitch_scale: .*; give .*finite number", {"pitch_scale": -1.0}),
    ):
        with pytest.raises(InputError, match=said):
            display.misaligned(**errors)
    with pytest.raises(InputError, match=r"dispersion.*glass"):
        display.at_wavelength(500.0)


def refused(text: str, key: str, *remedy: str) -> str:
    """Assert that a text is refused with one line `file: key: ...; remedy`; return the line."""
    with pytest.raises(InputError) as error:
        parse_display(text, "some/file.toml")
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("some/file.toml: ")
    assert key in message
    assert all(word in message for word in remedy), message
    assert error.value.exit_code == 2
    return message


TABLES = {"panel": PANEL, "array": ARRAY}


def test_missing_keys_and_tables():
    for table, key in (("panel", "width_px"), ("panel", "height_px"), ("array", "grid"), ("array", "pitch_mm")):
        refused(toml(**{table: but(TABLES[table], **{key: None})}), f"{table}.{key}: ", "add it")
    refused(toml(gap_mm=None), "gap_mm: ", "add it")
    refused("gap_mm = 0.5\n", "panel: ", "add it")
    refused(toml().split("[array]")[0], "array: ", "add it")
    refused("panel = 3\n", "panel: ", "[panel]")


@pytest.mark.parametrize(
    ("table", "first", "second", "value"),
    [("panel", "pixel_pitch_mm", "dpi", 508.0), ("array", "index", "glass", "PMMA"),
     ("array", "radius_mm", "focal_length_mm", 4.0)],
)  # fmt: skip
def test_both_or_neither_of_alternatives(table, first, second, value):
    for keys, word in (({second: value}, "several"), ({first: None}, "none")):
        refused(toml(**{table: but(TABLES[table], **keys)}), f"{table}.{first} or {second}", "exactly one", word)


@pytest.mark.parametrize(
    ("place", "hint"),
    [
        ("array.pich_mm", "did you mean pitch_mm?"),
        ("panel.widht_px", "did you mean width_px?"),
        ("gap", "did you mean gap_mm?"),
        ("radius", "did you mean array.radius_mm?"),
        # In the wrong table.
        ("panel.thickness_mm", "it belongs in [array]"),
        ("panel.pitch_mm", "it belongs in [array], or did you mean pixel_pitch_mm?"),
        ("array.transfer", "it belongs in [panel]"),
        ("array.gap_mm", "it belongs at the top of the file, before the first [table]"),
        ("speed", "known here: panel, array, gap_mm, name"),
        ("panel.a\\nb", "known here: width_px"),
    ],
)
@pytest.mark.parametrize("lacking", [False, True])
def test_unknown_key(place, hint, lacking):
    """It says what the key may stand for, also where a key is missing in this table or in another."""
    text = toml(but(PANEL, pixel_pitch_mm=None), but(ARRAY, grid=None)) if lacking else toml()
    table, _, key = place.rpartition(".")
    head = f"[{table}]\n" if table else ""
    shown = place.replace("\\n", " ")
    refused(text.replace(head, f'{head}"{key}" = 1\n', 1), f"{shown}: unknown key; {hint}")


@pytest.mark.parametrize(
    ("place", "instead_of", "stands_for"),
    [
        ("array.f_mm", "radius_mm", "focal_length_mm"),
        ("array.n", "index", "index"),
        ("array.refractive_index", "index", "index"),
        ("array.Pitch", "pitch_mm", "pitch_mm"),
        ("array.lattice", "grid", "grid"),
        ("panel.pitch_mm", "pixel_pitch_mm", "pixel_pitch_mm"),
        ("panel.PPI", "pixel_pitch_mm", "dpi"),
    ],
)
def test_an_unknown_key_stands_for_one_that_the_table_lacks(place, instead_of, stands_for):
    table, key = place.split(".")
    text = toml(**{table: but(TABLES[table], **{instead_of: None, key: 1.0})})
    refused(text, f"{place}: unknown key", f"did you mean {stands_for}?")


def test_an_unknown_table_stands_for_the_missing_one():
    refused(toml().replace("[array]", "[lenslets]"), "lenslets: unknown key", "did you mean array?")


LENGTHS = ("panel.pixel_pitch_mm", "array.pitch_mm", "array.radius_mm", "array.thickness_mm")
NUMBERS = (*LENGTHS, "array.index", "array.rotation_deg", "gap_mm")
WHOLE = ("panel.width_px", "panel.height_px", "panel.bits")
#: TOML's integers have no end, Python's floats do.
NOT_FINITE = ("nan", "+nan", "inf", "-inf", "1e999", "1" + "0" * 400)
NO_NUMBERS = ('"1.0"', "true", "[1.0]", "{a = 1}", "1979-05-27", '"""a\nb"""')
NOT_POSITIVE = ("-1.0", "0.0", "-0.0", "0", "-1e-300")
NO_CHOICES = ('"round"', '""', "3", "true", "[]", "{}", '["hex"]')

INSTEAD_OF = {"dpi": "pixel_pitch_mm", "glass": "index", "focal_length_mm": "radius_mm"}
#: Keys, what may not stand there as TOML, and what the message must say.
WRONG_VALUES = [
    (NUMBERS, (*NOT_FINITE, *NO_NUMBERS), ["give a finite number"]),
    (LENGTHS, NOT_POSITIVE, ["give a finite number, from 1e-09"]),
    (["array.index"], (*NOT_POSITIVE, "1.0"), ["give a finite number, more than 1"]),
    (["array.index"], ["4.01"], ["at most 4"]),
    (["gap_mm"], ["-1e-9"], ["from 0 to"]),
    (WHOLE, ("0", "-3", "1.0", "nan", "true", '"9"', "65536", "[1]"), ["whole number from 1 to"]),
    (["array.offset_mm"], ("1.0", "[1.0]", "[1.0, 2.0, 3.0]", '["a", 1.0]', "[nan, 0.0]", "[0.0, inf]", "[true, 0]"),
     ["give"]),
    (["array.grid"], NO_CHOICES, ["choose from", "square", "hex"]),
    (["array.plano_side"], NO_CHOICES, ["choose from", "panel", "viewer"]),
    (["panel.subpixels"], NO_CHOICES, ["choose from", "none", "rgb", "bgr"]),
    (["panel.transfer"], NO_CHOICES, ["choose from", "srgb", "linear", "gamma2.2"]),
    (["array.glass"], ['"marble"'], ["marble", "N-BK7", "PMMA", "give index"]),
    (["array.glass"], ["1.5"], ["quotes"]),
    (["panel.dpi", "array.focal_length_mm"], (*NOT_POSITIVE, *NOT_FINITE, *NO_NUMBERS), ["give a finite number"]),
    (["name"], ["3"], ["quotes"]),
    (["viewing_distance_mm"], ("-600.0", '"near"'), ["give"]),
    (["viewing_axis_mm"], ("[1.0]", "3.0"), ["give"]),
    (["viewing_axis_mm"], ["[1.0, 0.0]"], ["add viewing_distance_mm"]),
    (["array.shear"], ("1.01", "-2"), ["from -1 to 1"]),
    (["array.shear"], ["[0.1, 0.0]"], ["number"]),
    (["array.pitch_mm"], ("[1.0]", "[1.0, 1.0, 1.0]"), ["[x, y]"]),
    (["panel.pixel_pitch_mm"], ("[0.1]", "[0.1, 0.2, 0.3]", "[0.1, 0.0]", "[0.1, nan]", "[0.1, -0.1]", "[]"),
     ["give a finite number", "[x, y]"]),
    (["array.pitch_mm"], ["[1.0, 0.0]"], ["number"]),
    (["array.pitch_mm"], ("[1.0, 4.001]", "[4.001, 1.0]"), ["hexagonal 0.866 py"]),
    (["array.pitch_mm"], ("0.04", "[0.1, 0.04]"), ["finer", "at least one pixel pitch"]),
    (["array.extent_mm"], ["20.0"], ["[x, y]"]),
    (["array.extent_mm"], ["[20.0, -1.0]"], ["number"]),
    (["array.extent_mm"], ("[0.99, 10.0]", "[20.0, 0.86]"), ["omit the key"]),
    (["array.extent_mm"], ["[20000.0, 15000.0]"], ["in mm"]),
]  # fmt: skip


def with_raw(place, raw):
    """TOML text in which a key has a value that is written as it stands."""
    table, _, key = place.rpartition(".")
    marker = 123456789
    keys = {INSTEAD_OF.get(key, key): None, key: marker}
    text = toml(**{table: but(TABLES[table], **keys)}) if table else toml(**{key: marker})
    return text.replace(str(marker), raw)


@pytest.mark.parametrize(
    ("place", "raw", "said"),
    [(place, raw, said) for places, raws, said in WRONG_VALUES for place in places for raw in raws],
)
def test_a_wrong_value_is_refused(place, raw, said):
    refused(with_raw(place, raw), f"some/file.toml: {place}", *said)


def test_a_lens_that_is_nearly_flat_gets_the_smallest_thickness():
    """Its sag, p^2 / (4 R) at the corner of a square cell, is below any length that a file may give."""
    array = parse_display(toml(array=but(ARRAY, grid="square", radius_mm=1e9))).array
    assert array.sag_mm < 1e-9
    assert array.thickness_mm == 1e-9


@given(grid=st.sampled_from(("square", "hex")), steepness=st.floats(1.001, 1e4), pitch=pitches)
def test_thickness_may_equal_the_sag_as_typed(grid, steepness, pitch):
    """15 digits, as a person copies them, may lie 5e-16 of the sag below it: it passes."""
    radius = pitch * steepness
    array = but(ARRAY, grid=grid, pitch_mm=pitch, radius_mm=radius)
    panel = but(PANEL, pixel_pitch_mm=pitch / 10)
    sag = parse_display(toml(panel, array)).array.sag_mm
    for typed in (sag, float(f"{sag:.15g}"), float(f"{sag:.14g}") if sag > 1 else sag):
        thick = parse_display(toml(panel, but(array, thickness_mm=typed))).array.thickness_mm
        assert thick == typed
    parse_display(toml(panel, but(array, thickness_mm=sag * (1 - 1e-13))))
    thin = toml(panel, but(array, thickness_mm=sag * (1 - 1e-11)))
    refused(thin, "array.thickness_mm: ", "sag", "at least", "leave it out")


@pytest.mark.parametrize(
    ("array", "gap", "zone", "at_fault"),
    [
        # f = R / (n - 1) = 4 mm; D = gap + sag / n, or the gap.
        (ARRAY, 0.5, 16.0, "viewing_distance_mm"),
        (ARRAY, 30.0, 4 * (30.0 + (2.0 - math.sqrt(4.0 - 1 / 3)) / 1.5), "gap_mm"),
        (ARRAY, 292.0, 4 * (292.0 + (2.0 - math.sqrt(4.0 - 1 / 3)) / 1.5), "gap_mm"),
        (but(ARRAY, plano_side="viewer"), 30.0, 120.0, "gap_mm"),
        # 30 mm of glass at n = 1.5 are 20 mm of air: no gap is in focus.
        (but(ARRAY, thickness_mm=30.0), 1.0, 84.0, "viewing_distance_mm"),
    ],
)
def test_an_eye_within_the_focal_zone(array, gap, zone, at_fault):
    eye = zone * (1 - 1e-9)
    near = toml(array=array, gap_mm=gap, viewing_distance_mm=eye)
    line = refused(near, f"{at_fault}: ", "focal zone")
    assert f"{zone:.4g} mm" in line
    # What it advises is accepted.
    farther = float(re.search(r"viewing_distance_mm such as ([\d.]+)", line)[1])
    assert zone < farther < 1.02 * zone
    parse_display(toml(array=array, gap_mm=gap, viewing_distance_mm=farther))
    if at_fault == "gap_mm":
        better = float(re.search(r"give a gap_mm of ([\d.]+) \(in focus\)", line)[1])
        built = parse_display(toml(array=array, gap_mm=better, viewing_distance_mm=eye))
        assert built.aperture_distance_mm == pytest.approx(4.0, rel=1e-3)
    assert parse_display(toml(array=array, gap_mm=gap, viewing_distance_mm=zone * (1 + 1e-9))).convergence < 0.2501


def test_keys_of_an_array_that_do_not_fit_together():
    refused(toml(array=but(ARRAY, pitch_mm=[1.0, 0.04], radius_mm=9.0)), "array.pitch_mm: ", "hexagonal 0.866 py")
    refused(toml(array=but(ARRAY, shear=1.0, radius_mm=0.7)), "array.radius_mm: ", "larger radius_mm")
    # To the very limits.
    for keys in ({"pitch_mm": [1.0, 4.0], "radius_mm": 9.0}, {"shear": 1.0}, {"extent_mm": [1.0, 0.867]}):
        parse_display(toml(array={**ARRAY, **keys}))


def _corners(width, height, right, up):
    """(4, 2) corners of a parallelogram about the origin, from its sides' vectors of length 1 mm."""
    corners = [[x * width / 2, y * height / 2] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.array(corners) @ [right, up]


def _gap(one, other):
    """The widest gap between two convex polygons along a normal of their edges; negative: they overlap along each."""
    gaps = []
    for x, y in np.concatenate([np.roll(each, -1, 0) - each for each in (one, other)]):
        normal = np.array([-y, x]) / math.hypot(x, y)
        gaps += [(other @ normal).min() - (one @ normal).max()]
    return max(gaps)


def test_an_extent_reaches_the_panel_by_its_corners():
    """Turned and sheared areas around the panel, by their corners; a lenslet reaches half its diagonal farther."""
    rng, both = np.random.default_rng(SEED), set()
    for _ in range(300):
        angle, shear = rng.uniform(-180, 180), rng.choice([0.0, rng.uniform(-1, 1)])
        width, height = rng.uniform(2, 30, 2)
        way = rng.uniform(0, 2 * math.pi)
        offset = (rng.uniform(0.5, 1.2) * 35.0 * np.array([math.cos(way), math.sin(way)])).round(3)
        keys = {"shear": round(shear, 4), "extent_mm": [width, height], "offset_mm": [*offset], "rotation_deg": angle}
        array = but(ARRAY, **{"radius_mm": 9.0, **keys})
        turned = np.exp(1j * math.radians(angle)) * np.array([1.0, round(shear, 4) + 1j])
        area = _corners(width, height, *((side.real, side.imag) for side in turned)) + offset
        gap = _gap(_corners(32.0, 24.0, (1.0, 0.0), (0.0, 1.0)), area)
        reach = Array("hex", 1.0, 9.0, 1.5, 1.0, shear=round(shear, 4)).half_diagonal_mm
        if abs(gap - reach) < 1e-6:
            continue
        both.add(gap > reach)
        if gap > reach:
            refused(toml(array=array), "array.extent_mm: ", "bring array.offset_mm nearer")
        else:
            parse_display(toml(array=array))
    assert both == {True, False}


@pytest.mark.parametrize(
    ("grid", "extent", "steps"),
    [
        # Square, 0.5 along and 0.25 across: centres up to 5 and 2.5 mm.
        ("square", (10.0, 5.0), (20, 20)),
        ("square", (10.499, 5.249), (20, 20)),
        # Hexagonal: rows 0.25 sqrt(3)/2 = 0.216506 apart, 23 half rows in 5 mm.
        ("hex", (10.0, 5.0), (20, 23)),
        # 0.3 / 0.1 is 2.9999999999999996.
        ("thin", (0.3, 0.3), (3, 3)),
    ],
)
def test_lenslets_within_an_extent(grid, extent, steps):
    """(i, j) is there when |2 i|, hexagonal |2 i + j|, and |2 j| are not more than these."""
    pitch = (0.1, 0.1) if grid == "thin" else (0.5, 0.25)
    array = Array("hex" if grid == "hex" else "square", pitch, 1.0, 1.5, 1.0, extent_mm=extent)
    assert array.half_steps == steps


@given(displays())
def test_the_half_diagonal_reaches_the_farthest_corner(display):
    """The corners of the regular cell of pitch 1, brought to the lattice in 50 digits."""
    array = display.array
    px, py = (mp.mpf(pitch) for pitch in array.pitches_mm)
    half, third = mp.mpf(1) / 2, 1 / mp.sqrt(3)
    corners = [(half, half), (-half, half)]
    if array.grid == "hex":
        corners = [(half, third / 2), (-half, third / 2), (0, third)]
    reach = max(mp.hypot(px * x + mp.mpf(array.shear) * py * y, py * y) for x, y in corners)
    assert abs(array.half_diagonal_mm / reach - 1) < 1e-15


@pytest.mark.parametrize("value", [math.nan, math.inf, (math.nan, 0.0)])
@pytest.mark.parametrize("name", ["offset_mm", "rotation_deg", "gap_mm", "pitch_scale"])
def test_misaligned_by_no_number(name, value):
    """A lattice at no place made golden search without end."""
    with pytest.raises(InputError, match=rf"{name}: .*; give .*(finite numbers?|\[x, y\])"):
        parse_display(toml()).misaligned(**{name: value})


@pytest.mark.parametrize("part", ["panel", "array", ""])
def test_what_python_makes_has_the_checks_of_a_file(part):
    """Each number of panel, array and display: not a number, infinite, text, of numpy."""
    display = parse_display(toml(viewing_distance_mm=500.0))
    whole = getattr(display, part) if part else display
    numbers = [name for name, value in vars(whole).items() if isinstance(value, float | tuple) and name != "identity"]
    assert numbers
    for name in numbers:
        pair = isinstance(getattr(whole, name), tuple)
        for value in (math.nan, math.inf, "1"):
            with pytest.raises(InputError, match=rf"{type(whole).__name__}: {name}: .* is not valid; "):
                replace(whole, **{name: (value, 1.0) if pair else value})
        same = replace(whole, **{name: np.array(getattr(whole, name))})
        assert same == whole
        assert type(getattr(same, name)) in (float, tuple)
    with pytest.raises(InputError, match="Display: panel must be lippmann's Panel, not"):
        replace(display, panel="a panel")


@pytest.mark.parametrize("name", ['a "quoted" name', "a \\ name", "an emoji \U0001f600", "\u00e9", "# [x]", "a,\tb"])
def test_any_name_is_written_so_that_it_is_read(name, tmp_path):
    display = replace(parse_display(toml()), name=name)
    assert parse_display(display_text(display)) == display
    patterns = PatternSet.of(display)
    (tmp_path / "patterns.toml").write_text(patterns.text(display), encoding="utf-8")
    assert read_patterns(tmp_path / "patterns.toml", display) == patterns


def test_lists_are_written_in_one_line_or_in_many():
    table = {"a": [1, [2.0, "x,\n]"]], "b": "[\n", "t": [{"c": [3, 4]}]}
    for text in (toml_text(table), toml_text(table, one_line=False)):
        assert tomllib.loads(text) == table
    assert toml_text({"a": [1, [2, 3]]}) == "a = [1, [2, 3]]\n"
    assert toml_text({"a": [1, 2]}, one_line=False) == "a = [\n  1,\n  2,\n]\n"


@pytest.mark.parametrize("scale", [0.97, 0.9999, 1.0001, 1.003, 1.02])
@pytest.mark.parametrize("extent", [[12.0, 8.0], [11.9, 8.7], [4.0, 2.0]])
def test_misaligned_stretches_both_pitches_and_the_extent(extent, scale):
    """A stretched array has as many lenslets as before."""
    display = parse_display(toml(array=but(ARRAY, pitch_mm=[1.0, 1.5], shear=0.01, extent_mm=extent)))
    stretched = display.misaligned(pitch_scale=scale).array
    assert stretched.pitch_mm == pytest.approx((scale, 1.5 * scale))
    assert stretched.extent_mm == pytest.approx([side * scale for side in extent])
    assert stretched.half_steps == display.array.half_steps


def test_misaligned_keeps_the_eye_and_its_zone():
    """The eye belongs to the pixels: a moved array leaves it where it is."""
    display = parse_display(toml(viewing_distance_mm=20.0, viewing_axis_mm=[3.0, -4.0]))
    moved = display.misaligned(2.0, (0.3, 0.1), 1.0, 1.01)
    assert (moved.viewing_distance_mm, moved.viewing_axis_mm) == (20.0, (3.0, -4.0))
    with pytest.raises(InputError, match=r"misaligned: gap_mm.*focal zone"):
        display.misaligned(gap_mm=5.0)


LONG, NESTED = f"gap_mm = {'1' * 5000}\n", f"gap_mm = {'[' * 100000}\n"


@pytest.mark.parametrize("text", ["gap_mm = ", "[panel", "= 1", "a = 'x\n", "\x00", "é = 1", LONG, NESTED])
def test_broken_toml(text):
    """Also what Python itself gives up on."""
    message = refused(text, "not TOML", "syntax")
    assert "line" in message or "end of document" in message or text in (LONG, NESTED)


@pytest.mark.parametrize("loader", [str, Path])
def test_files(tmp_path, loader):
    file = tmp_path / "little.toml"
    file.write_text(toml())
    display = load_display(loader(file))
    assert display.name == "little"
    assert replace(display, name="display") == parse_display(toml())
    file.write_bytes(toml().replace("\n", "\r\n").encode())
    assert load_display(file) == display

    bad = tmp_path / "latin.toml"
    bad.write_bytes(b"name = '\xe9'\n")
    for path in (tmp_path / "none.toml", tmp_path, bad):
        with pytest.raises(InputError, match=rf"^{re.escape(str(path))}: .*give .*\.toml.*$"):
            load_display(loader(path))


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_value_anywhere_is_read_or_refused(data):
    """Whatever stands where, the outcome is a display or an InputError of one line."""
    scalars = st.one_of(st.integers(), st.floats(), st.booleans(), st.sampled_from(("", "hex", "PMMA", "a\nb")))
    values = st.one_of(scalars, st.lists(scalars, max_size=3))

    def raw(value):
        if isinstance(value, list):
            return f"[{', '.join(raw(item) for item in value)}]"
        return str(value) if isinstance(value, float) else json.dumps(value)

    keys = [f"panel.{key}" for key in (*PANEL, "bits", "subpixels")]
    keys += [f"array.{key}" for key in (*ARRAY, "offset_mm", "thickness_mm", "rotation_deg")]
    text = with_raw(data.draw(st.sampled_from([*keys, "gap_mm"])), raw(data.draw(values)))
    try:
        display = parse_display(text, "some/file.toml")
    except InputError as error:
        message = str(error)
        assert message.startswith("some/file.toml: ")
        assert "\n" not in message
    else:
        assert display.array.thickness_mm >= display.array.sag_mm * (1 - 1e-12)
