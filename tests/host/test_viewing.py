"""What eyes will see of a display: zones, shares and moire against brute force, the table and warnings by hand."""

import dataclasses
import json
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from lippmann.cli import run
from lippmann.display.description import display_text, load_display
from lippmann.engines import trace
from lippmann.errors import InputError
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.optics.crosstalk_and_viewing_zone import middle_eye, sees_all, status_share, zones
from lippmann.optics.display_properties import beats_in_lenslets, display_properties, eye_views, table_of_views
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Status
from lippmann.optics.trace import trace_to_panel
from optics_cases import GRIDS, SIDES, display_of
from scene_cases import focused_display, generator

SEED = 1404
DESKTOP = Path(__file__).parents[2] / "scenes/displays/desktop-hex.toml"
SHIPPED = sorted((Path(__file__).parents[2] / "scenes/displays").glob("*.toml"))


def changed(display, panel=None, array=None, **others):
    """A display with other values of the panel's, the array's and its own keys."""
    return dataclasses.replace(
        display,
        panel=dataclasses.replace(display.panel, **panel or {}),
        array=dataclasses.replace(display.array, **array or {}),
        **others,
    )


def laptop(distance_mm=600.0, width_mm=None):
    """15.6 inches of 4K behind hexagonal lenslets of 1 mm, f 3 mm in the glass; or a panel of another width."""
    display = display_of(
        "hex", "panel", radius=3.0 * 0.5168, index=1.5168, thickness=4.5504, gap=0.0, rotation=0.37,
        pixel_pitch=0.08964, width_px=3840, height_px=2160,
    )  # fmt: skip
    if width_mm is not None:
        display = changed(display, {"width_px": round(width_mm / 0.08964), "height_px": round(width_mm / 0.15936)})
    return changed(display, viewing_distance_mm=distance_mm)


def rays_through(display, eye, points):
    """Origins and unit directions of rays from an eye to points (N, 3), refracted by a flat face before them."""
    first = np.array(points)
    if display.array.plano_side == "viewer":
        first[:, 2] = display.array.thickness_mm
        for _ in range(10):  # where the ray meets the flat face: Snell's law by iteration
            slope = (first[:, :2] - eye[:2]) / (eye[2] - first[:, 2:])
            angle = np.arctan(np.hypot(*slope.T))[:, None]
            inside = np.tan(np.arcsin(np.sin(angle) / display.array.index)) / np.maximum(np.tan(angle), 1e-30)
            first[:, :2] = points[:, :2] - slope * inside * (first[:, 2:] - points[:, 2:])
    lines = first - eye
    return np.broadcast_to(eye, lines.shape), lines / np.linalg.norm(lines, axis=1, keepdims=True)


def crosstalk_rays(display, eye, points):
    """How many of the rays through points see a neighbour's image."""
    return int((trace_to_panel(display, *rays_through(display, eye, points)).status == Status.CROSSTALK).sum())


def points_of_window(display, rng, count):
    size = (display.panel.width_mm, display.panel.height_mm, 0.0)
    return rng.uniform(-0.5, 0.5, (count, 3)) * size


def worst_points(display, rng, count):
    """Random points near corners and sides of cells, along the panel's edges: the last clean rays pass there.

    They are in the plane of the domes' vertices or in that of their rims, and keep off the last hundredth of a cell.
    """
    array, half = display.array, 0.5 * np.array([display.panel.width_mm, display.panel.height_mm])
    angle = math.radians(array.rotation_deg)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    row = [0.5, 0.5 * math.sqrt(3.0)] if array.grid == "hex" else [0.0, 1.0]
    px, py = array.pitches_mm
    skew = np.array([[px, array.shear * py], [0.0, py]])
    basis = turn @ skew @ np.array([[1.0, 0.0], row]).T
    around = rng.uniform(-1.0, 1.0, (count, 2))
    side = np.arange(count), rng.integers(0, 2, count)
    around[side] = np.sign(around[side]) * rng.uniform(0.98, 1.0, count)
    around[::2] = np.sign(around[::2]) * rng.uniform(0.98, 1.0, (len(around[::2]), 2))
    lattice = np.round((around * half - array.offset_mm) @ np.linalg.inv(basis).T)
    turns, first, radius = (6, 30.0, 3.0**-0.5) if array.grid == "hex" else (4, 45.0, 0.5**0.5)
    corners = np.radians(first + 360.0 / turns * np.arange(turns + 1))
    corners = radius * np.stack([np.cos(corners), np.sin(corners)], axis=1) @ (turn @ skew).T
    one, along = rng.integers(0, turns, count), rng.choice([0.0, 0.02, 0.5], (count, 1))
    edge = corners[one] * (1.0 - along) + corners[one + 1] * along
    points = lattice @ basis.T + array.offset_mm + edge * rng.uniform(0.93, 0.99, (count, 1))
    rims = array.sag_mm if array.plano_side == "viewer" else -array.sag_mm
    points = np.concatenate([points, rng.choice([0.0, rims], (count, 1))], axis=1)
    return points[(np.abs(points[:, :2]) < half).all(axis=1)]


ZONED = {
    "15.6 inch": laptop(),
    "15.6 inch, off the axis": dataclasses.replace(laptop(), viewing_axis_mm=(80.0, -30.0)),
    "1.2 m at 1500 mm": laptop(1500.0, 1200.0),
    "small, eye far away": display_of("square", "panel", radius=1.7, thickness=4.0, gap=0.2, width_px=400),
    "turned": changed(
        focused_display("square", focal=3.0, width_px=1600, height_px=1200, pixel_pitch=0.1, rotation=20.0),
        viewing_distance_mm=400.0,
    ),
    "domes to the panel": changed(
        focused_display("hex", "viewer", focal=5.0, width_px=1500, height_px=900, pixel_pitch=0.1, rotation=7.0),
        {}, {"thickness_mm": 2.5}, viewing_distance_mm=500.0,
    ),
    "skewed": changed(
        focused_display("hex", focal=4.0, width_px=1600, height_px=1200, pixel_pitch=0.1, rotation=-9.0),
        {}, {"pitch_mm": (1.0, 1.05), "shear": 0.06, "thickness_mm": 1.0}, viewing_distance_mm=500.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "share"), [*((name, 1.0) for name in ZONED), ("15.6 inch, off the axis", 1.2)])
def test_the_zone_ends_where_the_observers_rays_find_crosstalk(name, share):
    """Inside none of many rays finds any, 0.5 % before the border; 2 % beyond it some do."""
    display, rng = ZONED[name], generator(SEED, name)
    z = share * (display.viewing_distance_mm or 600.0)
    (zone,) = zones(display, [z])
    middle = np.array(middle_eye(display, z))
    width, height = zone.right_mm - zone.left_mm, zone.top_mm - zone.bottom_mm
    ends = np.array([(zone.left_mm, middle[1]), (zone.right_mm, middle[1]),
                     (middle[0], zone.bottom_mm), (middle[0], zone.top_mm)])  # fmt: skip
    everywhere, worst = points_of_window(display, rng, 10_000), worst_points(display, rng, 40_000)
    # A lenslet that the panel's edge cuts moves the border by the distance at which an eye tells two lenslets apart.
    cut = display.array.coarsest_mm * abs(1.0 - z / (display.viewing_distance_mm or math.inf))
    for place, size in zip(ends, (width, width, height, height), strict=True):
        out = np.array([*place, z]) - middle
        out /= np.linalg.norm(out)
        inside, outside = np.array([*place, z]) - 0.0025 * size * out, np.array([*place, z]) + (0.01 * size + cut) * out
        assert crosstalk_rays(display, inside, everywhere) == 0
        assert crosstalk_rays(display, inside, worst) == 0
        assert crosstalk_rays(display, outside, np.concatenate([everywhere, worst])) > 0
    # Nor does an eye between the four ends.
    for weights in rng.dirichlet(np.ones(4), 6):
        assert crosstalk_rays(display, np.array([*(weights @ ends), z]), everywhere) == 0


def test_a_wide_panel_has_no_zone_nearby_and_inspect_says_so():
    """1.2 m at 600 mm: Snell's law in the glass moves the outer images by more than half a pitch, for every eye."""
    display = laptop(600.0, 1200.0)
    # At 45 degrees a ray comes 4.5504 tan(asin(sin 45 / 1.5168)) = 2.398 mm off the axis; the image lies 3 mm off it.
    assert 3.0 - 4.5504 * math.tan(math.asin(math.sin(math.radians(45.0)) / 1.5168)) > 0.5
    assert zones(display, [600.0]) == [None]
    share = status_share(display, (0.0, 0.0, 600.0))["crosstalk"]
    (warning,) = [words for words in display_properties(display).warnings if "whole panel" in words]
    assert warning.startswith(f"no eye at 600 mm sees the whole panel: {100.0 * share:.1f} % of the view")


@pytest.mark.parametrize("name", ["15.6 inch, off the axis", "small, eye far away", "domes to the panel"])
def test_shares_are_those_of_observe(name, mi):
    """Within five standard deviations of both samples, for eyes inside the zone and outside."""
    display, rng = ZONED[name], generator(SEED, name, 2)
    display = changed(display, {"width_px": 700, "height_px": 500}, viewing_axis_mm=(5.0, -3.0))
    light = np.ones((500, 700, 3), np.float32)
    for _ in range(4):
        eye = (float(rng.uniform(-150.0, 150.0)), float(rng.uniform(-100.0, 100.0)), float(rng.uniform(300.0, 900.0)))
        window = whole_window(display, 300)
        seen = observe(light, display, Eye(eye), window, samples=4).status_share
        told = status_share(display, eye)
        assert told.keys() == seen.keys()
        assert sum(told.values()) == pytest.approx(1.0)
        rays = 4 * window.width_px * window.height_px
        for status, share in seen.items():
            noise = math.sqrt(share * (1.0 - share) * (1.0 / rays + 1.0 / 8192.0))
            assert told[status] == pytest.approx(share, abs=5.0 * noise + 2.0 / 8192.0), status


def lenslet_pixels(display, eye, count):
    """Pixel columns that an eye sees through the centres of lenslets in the array's middle row."""
    centres = np.zeros((count, 3))
    centres[:, 0] = display.array.pitch_mm * (np.arange(count) - count // 2)
    return trace_to_panel(display, *rays_through(display, np.array(eye), centres), model="pinhole").pixel[:, 0]


@pytest.mark.parametrize("distance_mm", [250.0, 600.0, 1500.0])
def test_the_table_of_views_follows_from_traced_rays(distance_mm):
    """View step, beat and depth range, from pixels that an eye sees through neighbouring lenslets' centres."""
    display = display_of("square", "panel", radius=1.6, gap=1.3, width_px=1600, height_px=500, pixel_pitch=0.0931)
    (view,) = eye_views(display, [(0.0, 0.0, distance_mm)])
    here, there = (lenslet_pixels(display, (x, 0.0, distance_mm), 129) for x in (0.0, view.view_step_mm))
    assert here - there == pytest.approx(np.ones(129), abs=1e-9)
    steps = np.diff(here)
    beat = 1.0 / abs(math.remainder(steps.mean(), 1.0))
    assert beats_in_lenslets(display, distance_mm)[0] == pytest.approx(beat)
    assert view.moire_lenslets == (pytest.approx(beat) if 4.0 < beat < display.panel.width_mm else None)
    assert math.tan(math.radians(view.lenslet_arcmin / 60.0)) == pytest.approx(1.0 / distance_mm, rel=1e-4)
    # Two rays from pixels q apart through one lenslet are |d| q / D apart at the depth d. The eye sees that gap on the
    # display as wide as a lenslet.
    gap = display.panel.pixel_pitch_mm / display.aperture_distance_mm
    for depth in view.depth_range_mm:
        assert abs(depth) * gap * distance_mm / (distance_mm - depth) == pytest.approx(1.0)
    assert view.depth_range_mm[0] < 0.0 < view.depth_range_mm[1]


def test_the_farthest_depth_is_infinite_for_a_near_eye():
    display = display_of("square", "panel", radius=1.6, gap=1.3, pixel_pitch=0.005)
    reach = display.aperture_distance_mm / 0.005
    (view,) = eye_views(display, [(0.0, 0.0, 0.9 * reach)])
    assert view.depth_range_mm == (-math.inf, pytest.approx(0.9 / 1.9 * reach))


def test_the_table_has_the_zones_and_shares_of_its_eyes():
    display = ZONED["15.6 inch, off the axis"]
    views = table_of_views(display)
    assert [view.eye_mm[2] for view in views] == [300.0, 450.0, 600.0, 900.0, 1200.0, 1800.0]
    assert views[2].eye_mm == (80.0, -30.0, 600.0)
    assert views[0].eye_mm == (40.0, -15.0, 300.0)
    for view in views:
        assert [view.zone_mm] == zones(display, [view.eye_mm[2]])
        assert view.status_share == status_share(display, view.eye_mm)
        assert (view.zone_mm is not None) == sees_all(display, np.array([view.eye_mm]))[0]
    assert display_properties(display).viewing_zone_mm == pytest.approx(
        0.5 * (views[2].zone_mm.right_mm - views[2].zone_mm.left_mm)
    )


def test_an_eye_behind_the_display_is_refused():
    for z in (-1.0, 0.0, 2.5):
        with pytest.raises(InputError, match=r"not in front of the display, whose front is at z = 2\.5 mm"):
            status_share(ZONED["domes to the panel"], (0.0, 0.0, z))


HELPLESS = {
    "15.6 inch without a viewing distance": changed(laptop(), viewing_distance_mm=None),
    "1.2 m at 600 mm": laptop(600.0, 1200.0),
    "an eye far too near": laptop(40.0),
    "out of focus": changed(focused_display("square", focal=3.0, width_px=900, height_px=600), gap_mm=5.0),
    "fast domes to the panel": focused_display("square", "viewer", focal=2.2, width_px=900, height_px=600),
    **{path.stem: load_display(path) for path in SHIPPED},
}


@pytest.mark.parametrize("name", HELPLESS)
def test_the_remedy_of_the_warning_opens_a_zone(name):
    display = HELPLESS[name]
    found = [words for words in display_properties(display).warnings if "sees the whole panel" in words]
    usual = display.viewing_distance_mm or 600.0
    assert bool(found) == (zones(display, [usual]) == [None])
    if not found:
        return
    keys = {key: float(value) for key, value in re.findall(r"(\w+_mm) = ([\d.]+)", found[0])}
    assert keys
    array = {key: keys[key] for key in ("pitch_mm",) if key in keys}
    if "focal_length_mm" in keys:
        array["radius_mm"] = keys["focal_length_mm"] * (display.array.index - 1.0)
    top = {key: keys[key] for key in ("gap_mm", "viewing_distance_mm") if key in keys}
    better = changed(display, {}, array, **top)
    z = better.viewing_distance_mm or 600.0
    assert found[0].endswith("and look from there") == (z != usual)
    assert zones(better, [z]) != [None]
    assert not [words for words in display_properties(better).warnings if "sees the whole panel" in words]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"viewing_axis_mm": (800.0, 0.0)}, "viewing_axis_mm, 800, 0, is beside the panel of 344.2 x 193.6 mm"),
        ({"viewing_axis_mm": (0.0, -97.0)}, "viewing_axis_mm, 0, -97, is beside the panel"),
        ({"viewing_axis_mm": (170.0, -96.0)}, None),
        ({"viewing_distance_mm": 600000.0}, "an eye 600000 mm away is 600 m away"),
    ],
)
def test_an_eye_that_nobody_has_is_noticed(changes, said):
    warnings = display_properties(changed(laptop(), **changes)).warnings
    beside = [words for words in warnings if "beside the panel" in words or "m away" in words]
    assert [said in words for words in beside] == [True] if said else not beside
    assert not (said and "beside" in said and any("sees the whole panel" in words for words in warnings))


SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def inspected(tmp_path, monkeypatch, capsys):
    """Run `inspect` on a display in an empty folder; return its exit code, JSON (None without) and messages."""
    monkeypatch.chdir(tmp_path)

    def call(display, *arguments):
        Path("it.toml").write_text(display_text(display))
        capsys.readouterr()
        code = run(["inspect", "it.toml", "--json", *arguments])
        out, err = capsys.readouterr()
        return code, json.loads(out), err

    return call


@pytest.fixture
def printed(tmp_path, capsys):
    """Run `inspect` on a display; return the lines that it prints."""

    def call(display, *arguments):
        (tmp_path / "it.toml").write_text(display_text(display))
        assert run(["inspect", str(tmp_path / "it.toml"), *arguments]) == 0
        return capsys.readouterr().out.splitlines()

    return call


def test_inspect_tells_what_an_eye_sees(inspected):
    display = ZONED["15.6 inch, off the axis"]
    code, result, _ = inspected(display, "--eye", "95,0,610")
    assert code == 0
    (view,) = eye_views(display, [(95.0, 0.0, 610.0)])
    assert result["eye"] == json.loads(json.dumps({**dataclasses.asdict(view), "zone_mm": view.zone_mm._asdict()}))
    assert [row["eye_mm"][2] for row in result["distances"]] == [300.0, 450.0, 600.0, 900.0, 1200.0, 1800.0]
    assert result["viewing_distance_mm"] == 600.0
    assert result["viewing_axis_mm"] == [80.0, -30.0]
    # The elemental image's pitch is p (1 + D/E) = 1.005 mm.
    assert result["elemental_image_px"] == pytest.approx(1.005 / 0.08964)


@pytest.mark.parametrize("axis", [(0.0, 0.0), (80.0, -30.0)])
def test_the_crosstalk_angle_is_that_of_the_lenslet_it_names(printed, axis):
    """Chief rays back from the two sides of the angle: own image within, the neighbour's beyond."""
    display = changed(ZONED["15.6 inch"], {}, {"rotation_deg": 0.0, "offset_mm": axis}, viewing_axis_mm=axis)
    (line,) = [line for line in printed(display) if line.startswith("crosstalk")]
    found = re.search(r"beyond ([\d.]+) deg off the axis of the lenslet at \((.+), (.+)\) mm", line)
    angle, x, y = (float(number) for number in found.groups())
    assert (x, y) == axis
    for share, status in ((-1.001, 4), (-0.999, 0), (0.999, 0), (1.001, 4)):
        slope = math.tan(math.radians(share * angle))
        eye, place = np.array([[x + 600.0 * slope, y, 600.0]]), np.array([[x, y, 0.0]])
        ray = (place - eye) / np.linalg.norm(place - eye)
        assert trace_to_panel(display, eye, ray, "pinhole").status.tolist() == [status], share
    changed_back = dataclasses.replace(display, viewing_distance_mm=None, viewing_axis_mm=(0.0, 0.0))
    assert "deg off a lenslet's axis" in "".join(printed(changed_back))


@pytest.mark.parametrize("name", ["15.6 inch, off the axis", "small, eye far away"])
def test_the_printed_zone_ends_where_the_searched_one_does(printed, name):
    (zone,) = zones(ZONED[name], [600.0])
    (line,) = [line for line in printed(ZONED[name]) if line.startswith("viewing zone")]
    ends = [float(end) for end in re.search(r"x = (\S+) to (\S+) mm, for eyes at 600 mm", line).groups()]
    assert ends == pytest.approx([zone.left_mm, zone.right_mm], rel=1e-3)


def test_where_no_zone_is_the_printed_crosstalk_is_not_0(printed):
    """Of desktop-hex at 450 mm no ray of 8192 is crosstalk, but the corners' lenslets are at the very limit."""
    lines = [line.split() for line in printed(load_display(DESKTOP))]
    rows = {line[0]: line[1:] for line in lines if line and re.fullmatch(r"\d+", line[0])}
    assert rows["450"][:4] == ["<", "0.1", "%", "none"]
    assert rows["600"][:2] == ["0.0", "%"]
    assert all(row[:3] != ["0.0", "%", "none"] for row in rows.values())


@pytest.mark.parametrize(
    ("grid", "pitch", "rows", "advised"),
    [
        ("hex", [1.0, 0.866], "0.749978", "[1, 0.999971]"),
        ("hex", [1.3, 1.125], "0.974279", "[1.3, 1.29904]"),
        ("hex", [1.0, 0.99], "0.857365", None),
        ("square", [1.0, 0.866], "0.866", None),
        ("hex", 1.0, None, None),
    ],
)
def test_the_distance_of_rows_is_said(printed, grid, pitch, rows, advised):
    """py sqrt(3)/2 on a hexagonal lattice; advised: [px, py 2 / sqrt(3)]."""
    display = changed(display_of(grid, "panel", thickness=2.0))
    pitch = tuple(pitch) if isinstance(pitch, list) else pitch
    lines = printed(changed(display, {}, {"pitch_mm": pitch}))
    (line,) = [line for line in lines if line.startswith("array ")]
    out = "\n".join([*lines, ""])
    assert (f"rows {rows} mm apart" in line) if rows else ("rows" not in line)
    assert ("if they are" in out) == (advised is not None)
    assert advised is None or f"give pitch_mm = {advised}\n" in out


@pytest.mark.parametrize(("x", "sees_all"), [(59.0, True), (61.0, False), (200.0, False), (1e8, False)])
def test_an_eye_beside_the_zone_is_told(printed, x, sees_all):
    """The zone of the 15.6 inch panel ends at 59.5 mm. Just outside, none of the 8192 rays of the share may see it."""
    lines = printed(load_display(DESKTOP), "--eye", f"{x},0,600")
    (at,) = [k for k, line in enumerate(lines) if line.startswith("an eye at")]
    assert ("outside the zone" in lines[at]) != sees_all
    crosstalk = lines[at + 2].split()[1:3]
    assert (crosstalk == ["0.0", "%"]) == sees_all
    assert (crosstalk[0] == "dark") == (x == 1e8)


def texts(path):
    return [" ".join(text.itertext()).strip() for text in ElementTree.parse(path).iter(f"{SVG}text")]


def axes_of(path):
    return [group for group in ElementTree.parse(path).iter(f"{SVG}g") if group.get("id", "").startswith("axes_")]


def coloured(chart, style, colour):
    """The marks or lines of a chart whose style names a colour."""
    tag = {"fill": "use", "stroke": "path"}[style]
    return [one for one in chart.iter(f"{SVG}{tag}") if re.search(f"{style}: {colour}", one.get("style", ""))]


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("side", SIDES)
def test_the_drawing_shows_every_lenslet_and_the_numbers(inspected, grid, side):
    """A small panel: a dot for each lenslet whose centre lies on it."""
    display = display_of(grid, side, width_px=200, height_px=160, pixel_pitch=0.0931, offset=(0.2, 0.3), thickness=2.5)
    display = changed(display, viewing_distance_mm=300.0)
    assert inspected(display, "--draw", "d.svg")[0] == 0
    words = texts("d.svg")
    assert "panel 18.62 x 14.9 mm, all lenslets" in words
    distance = display.aperture_distance_mm
    assert f"gap 0.5, thickness 2.5, focal length 3, D {distance:.4g} mm" in words
    i, j = np.mgrid[-60:61, -60:61]
    across = i + 0.5 * j if grid == "hex" else i
    up = j * (0.5 * math.sqrt(3.0) if grid == "hex" else 1.0)
    on_panel = (abs(across + 0.2) <= 0.5 * 18.62) & (abs(up + 0.3) <= 0.5 * 14.896)
    whole, _, middle, corner = axes_of("d.svg")
    dots = coloured(whole, "fill", "#0072b2")
    assert len(dots) == on_panel.sum()
    for close in (middle, corner):
        # A close-up is 4 x 4 pitches of 1 mm: cells of 1 mm^2, or sqrt(3)/2 mm^2, and each with its elemental image.
        cells, images = (coloured(close, "stroke", colour) for colour in ("#0072b2", "#d55e00"))
        assert len(images) >= 16.0 / (0.5 * math.sqrt(3.0) if grid == "hex" else 1.0)
        assert len(cells) >= len(images)


def test_the_border_of_an_array_is_drawn(inspected):
    """9 x 5 mm about (0.2, 0.3) mm, turned by 30 degrees, on a panel that is wider: in the chart's own units."""
    display = display_of("square", "panel", width_px=200, height_px=160, offset=(0.2, 0.3), rotation=30.0)
    display = changed(display, array={"extent_mm": (9.0, 5.0)})
    for name in ("d.svg", "again.svg", "d.png"):
        assert inspected(display, "--draw", name)[0] == 0
    assert Path("d.svg").read_bytes() == Path("again.svg").read_bytes()
    assert Path("d.png").read_bytes().startswith(b"\x89PNG")
    assert "end of the array" in texts("d.svg")
    whole, *_ = axes_of("d.svg")

    def points(path):
        return np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path.get("d")), float)

    # The only black line around something: axes and ticks have two points.
    (frame,) = [points(path)[:4] for path in coloured(whole, "stroke", "#000000") if len(points(path)) == 5]
    border = points(whole.find(f".//{SVG}g[@id='border']/{SVG}path"))[:4]
    mm = display.panel.width_mm / np.ptp(frame[:, 0])
    found = (border - frame.mean(axis=0)) * (mm, -mm)
    turn = np.array([[math.sqrt(0.75), 0.5], [-0.5, math.sqrt(0.75)]])
    corners = np.array([(-4.5, -2.5), (4.5, -2.5), (4.5, 2.5), (-4.5, 2.5)]) @ turn + (0.2, 0.3)
    np.testing.assert_allclose(found, corners, atol=0.02)


def test_the_picture_of_the_zones_names_the_eyes_and_their_crosstalk(inspected):
    display = ZONED["15.6 inch"]
    code, result, _ = inspected(display, "--zones", "z.svg", "--eye", "95,0,600")
    assert code == 0
    words = texts("z.svg")
    assert "viewing distance: 0, 0, 600 mm, crosstalk 0.0 %" in words
    share = result["eye"]["status_share"]["crosstalk"]
    assert share > 0.0
    assert f"eye: 95, 0, 600 mm, crosstalk {100.0 * share:.1f} %" in words
    assert "zone without crosstalk" in words
    assert inspected(laptop(600.0, 1200.0), "--zones", "none.svg")[0] == 0
    assert "zone without crosstalk" not in texts("none.svg")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--eye", "0,0,-5"), "eye: z -5 mm is not in front of the display"),
        (("--eye", "0,0"), "give 3 finite numbers"),
        (("--draw", "d.jpg"), "choose from .svg, .png"),
        (("--zones", "gone/z.svg"), "make the folder first"),
        (("--draw", "d.svg", "--zones", "d.svg"), "give two names"),
        (("--zone", "d.svg"), "Did you mean '--zones'?"),
    ],
)
def test_what_inspect_refuses(inspected, arguments, said):
    code, result, err = inspected(ZONED["15.6 inch"], *arguments)
    assert code == 2
    assert said in result["error"]
    assert len(err.splitlines()) == 1
    assert [path.name for path in Path().iterdir()] == ["it.toml"]


@pytest.mark.parametrize(
    ("x", "y", "nearest"),
    [
        (1.9, 2.0, (1.9, 2.0)),  # 1.4 along its row
        (-0.9, 2.0, (-0.9, 2.0)),  # -1.4
        (9.0, 1.0, (1.75, 1.0)),
        (9.0, 5.0, (2.5, 4.0)),
        (-9.0, -5.0, (-2.5, -4.0)),
    ],
)
def test_the_nearest_point_of_an_array_that_ends_by_hand(x, y, nearest):
    """Rows 2 mm apart to 4 mm from the middle, each moved by a quarter of its height; 1.5 mm to both sides along it."""
    lattice = Lattice("square", (1.0, 2.0), shear=0.25, half_steps=(4, 4))
    assert lattice.nearest_within(np.array(x), np.array(y)) == pytest.approx(nearest)


def lattice_vectors(display):
    """(2, 2): the lattice's basis in panel axes, in lenslet pitches."""
    array = display.array
    angles = np.radians(np.array([0.0, 60.0 if array.grid == "hex" else 90.0]))
    px, py = array.pitches_mm
    basis = np.stack([px * np.cos(angles) + array.shear * py * np.sin(angles), py * np.sin(angles)], axis=1) / px
    c, s = math.cos(math.radians(array.rotation_deg)), math.sin(math.radians(array.rotation_deg))
    return basis @ np.array([[c, s], [-s, c]])


def nearest_reciprocal(display, distance_mm=math.inf):
    """Distances of the pixels' two fundamental frequencies from the reciprocal lattice, cycles a lenslet: tries all."""
    ratio = display.array.pitches_mm[0] / display.panel.pixel_pitch_mm
    # An eye sees pixels through neighbouring lenslets (1 + D/z) pitches apart, by similar triangles.
    ratio *= 1.0 + display.aperture_distance_mm / distance_mm
    reach = math.ceil(1.5 * ratio) + 2
    counts = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
    reciprocal = counts @ np.linalg.inv(lattice_vectors(display)).T  # b_i . a_j = delta_ij
    return [np.linalg.norm(reciprocal - frequency, axis=1).min() for frequency in ([ratio, 0.0], [0.0, ratio])]


def case(rng):
    """A random display with up to 60 pixels for each lenslet, turned or not, often almost commensurate."""
    grid = rng.choice(GRIDS)
    rotation = rng.choice([0.0, 30.0, 60.0, 90.0, rng.uniform(-180.0, 180.0), rng.uniform(-0.5, 0.5)])
    ratio = rng.choice([rng.uniform(2.5, 59.0), rng.integers(3, 59) + rng.uniform(-0.2, 0.2)])
    ratio *= rng.choice([1.0, 2.0 / math.sqrt(3.0)]) if grid == "hex" and ratio < 50.0 else 1.0
    more = {}
    if rng.random() < 0.3:
        more = {"shear": float(rng.uniform(-0.3, 0.3)), "row_pitch": float(rng.uniform(0.8, 1.2))}
    return display_of(grid, "panel", rotation=float(rotation), pixel_pitch=float(1.0 / ratio), width_px=2000, **more)


def moire_of(display):
    """The eye's distance and the period in the moire warning, mm; None without one."""
    found = [w for w in display_properties(display).warnings if w.startswith("moire: ")]
    said = r"to an eye at ([\d.e+]+) mm, pixels and lenslets beat every ([\d.e+]+) mm"
    return tuple(map(float, re.search(said, found[0]).groups())) if found else None


@pytest.mark.parametrize("viewing", [None, 300.0, 2000.0])
@pytest.mark.parametrize("number", range(30))
def test_moire_follows_from_the_reciprocal_lattice(number, viewing):
    display = dataclasses.replace(case(generator(SEED, number)), viewing_distance_mm=viewing)
    distance = viewing or 600.0
    for z in (math.inf, distance):
        frequencies = nearest_reciprocal(display, z)
        assert [1.0 / beat for beat in beats_in_lenslets(display, z)] == pytest.approx(frequencies, abs=1e-9)
    pitch = display.array.pitches_mm[0]
    visible = [1.0 / f for f in frequencies if f and 4.0 < 1.0 / f < display.panel.width_mm / pitch]
    # As the table of views has it at that distance.
    (view,) = eye_views(display, [(0.0, 0.0, distance)])
    assert view.moire_lenslets == (pytest.approx(max(visible), rel=1e-9) if visible else None)
    assert moire_of(display) == (pytest.approx((distance, max(visible) * pitch), rel=5e-3) if visible else None)


@pytest.mark.parametrize("number", range(40))
def test_lenslets_within_an_extent_are_those_that_pass_rays(number):
    """On a panel that is larger than the array: lenslets that own a ray through their centre, counted."""
    rng = generator(SEED, "extent", number)
    display = display_of(rng.choice(GRIDS), "panel", width_px=400, height_px=300, pixel_pitch=0.1)
    pitch = rng.choice([1.0, rng.uniform(0.8, 1.1)]), rng.uniform(0.8, 1.1)
    extent = tuple((rng.uniform(1.2, 20.0, 2) * rng.choice([1.0, 0.5])).round(int(rng.integers(0, 3))) + 1.0)
    array = dataclasses.replace(display.array, pitch_mm=pitch, extent_mm=extent, thickness_mm=2.0)
    display = dataclasses.replace(display, array=array)
    i, j = np.mgrid[-60:61, -60:61].reshape(2, -1)
    x = pitch[0] * (i + 0.5 * j if array.grid == "hex" else i)
    y = pitch[1] * (j * math.sqrt(0.75) if array.grid == "hex" else j)
    near = (abs(x) < 19.0) & (abs(y) < 14.0)
    rays = trace(display, np.stack([x[near] / 0.1 + 200.0, 150.0 - y[near] / 0.1], axis=1))
    passed = rays.status == Status.OK
    rows = np.round(y[near][passed], 6)
    across, down, total = display_properties(display).lenslets
    assert total == passed.sum()
    assert down == len(set(rows))
    assert across == max((rows == row).sum() for row in set(rows))


def test_lenslets_of_the_measured_display():
    """23 in the middle row, 24 in the next one, and so on: 11 x 23 + 10 x 24."""
    display = load_display(Path(__file__).parents[2] / "scenes/displays/measured-hex.toml")
    assert display_properties(display).lenslets == (24, 21, 493)


def test_hexagonal_rows_beat_with_their_own_pitch():
    """9.1 pixels a lenslet are 7.88 a row: 0.12 short of 8, a beat of 8.4 rows or 7.3 lenslets. Columns do not beat,
    because neighbouring rows are half a pitch apart.
    """
    columns, rows = beats_in_lenslets(display_of("hex", "panel", pixel_pitch=1.0 / 9.1))
    assert rows == pytest.approx(0.5 * math.sqrt(3.0) / (8.0 - 9.1 * 0.5 * math.sqrt(3.0)))
    assert columns < 2.0


@pytest.mark.parametrize("rotation", [0.0, 13.0, 30.0])
@pytest.mark.parametrize(("grid", "symmetry"), [("square", 90.0), ("hex", 60.0)])
@pytest.mark.parametrize("ratio", [9.1, 10.0, 15.2])
def test_a_turn_by_the_lattices_symmetry_changes_no_warning(grid, symmetry, ratio, rotation):
    warnings = []
    for turn in (rotation, rotation + symmetry, rotation - 2.0 * symmetry):
        display = display_of(grid, "panel", rotation=turn, pixel_pitch=1.0 / ratio)
        striped = dataclasses.replace(display, panel=dataclasses.replace(display.panel, subpixels="rgb"))
        warnings.append(display_properties(striped).warnings)
    assert warnings[0] == warnings[1] == warnings[2]
    # Stripes along a row of lenslets or across it: a hexagonal lattice has rows every 60 degrees.
    parallel = rotation == 0.0 or (grid == "hex" and rotation == 30.0)
    assert any(warning.startswith("colour moire") for warning in warnings[0]) == parallel
