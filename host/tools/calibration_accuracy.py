"""Measures the errors of calibrations of random displays whose true values are known (`tools.bench calibration`).

The exact tracer or POV-Ray renders the photographs; with the tracer, disturbances outside the model are possible.
"""

from __future__ import annotations

import contextlib
import math
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click
import numpy as np
from lippmann.base.files import scratch_folder
from lippmann.base.images import Radiance
from lippmann.base.machine import proc_mb
from lippmann.base.tones import psnr_db
from lippmann.calibration.coded_patterns import STEPS, PatternSet, write_patterns
from lippmann.calibration.result import Calibration
from lippmann.calibration.simulated_camera import Camera, Point, Sensor
from lippmann.calibration.simulated_photographs import UNDISTURBED, Bench, photograph_folder
from lippmann.calibration.solve import calibrate
from lippmann.cli.frame import option
from lippmann.conformance.figures import Rows, groups, values
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import Plot, finish_picture, make_axes
from lippmann.display.description import Array, Display, Grid, Panel, PlanoSide, display_text, load_display
from lippmann.errors import LippmannError
from lippmann.eye.observer import Eye, observe, whole_window
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Floats, gets_through
from lippmann.optics.system import PanelFrame, System
from lippmann.optics.trace import trace_to_panel
from lippmann.rendering.executors import local_workers
from lippmann.rendering.options import Settings
from lippmann.rendering.renderer import render_integral
from lippmann.scenes.placement import Placement
from lippmann.scenes.scene import Scene, load_scene
from scipy.spatial import KDTree

from tools.bench import ON_DEVICE, MeasurementRun, measurement
from tools.report_plots import draw_bar_charts, draw_lines, make_page
from tools.simulated_bench import Disturbances, framed
from tools.simulated_povray import SolidsBench

if TYPE_CHECKING:
    from distributed import Client

#: Minimum and maximum width of the random displays' lenslets, pixels.
LENSLET_PX = (14.0, 24.0)
#: Maximum errors of the random displays: rotation in degrees, pitch and gap as fractions.
ROTATION_DEG, PITCH, GAP = 5.0, 0.01, 0.2
#: Standard deviations of the pitches' ratio and of the shear of the random displays.
RATIO, SHEAR = 3e-4, 5e-4
#: Cameras: range of distances, panel widths; angle to the axis, degrees: first camera's maximum, others' range.
DISTANCE = (2.5, 5.0)
NEAR_AXIS_DEG, ASIDE_DEG = 5.0, (8.0, 18.0)
#: Default number of camera positions.
POSITIONS = 3
#: Swept quantities: camera positions, phase pictures per direction, and factor on the noise.
SWEPT = {"positions": (1, 2, 3, 4), "steps": (3, 4, 8, 16), "noise": (1, 2, 4, 8)}
#: Disturbances of displays calibrated with --bow: an array bowed by 30 um, dust, and camera pixels of arbitrary value.
BOWED = Disturbances(bow_mm=0.03, hidden_lenslets=0.02, outliers=0.1)
#: The 8K display: number of lenslets, width of its photographs, pixels; errors (degrees, fractions of pitch and gap).
LENSLETS, LARGE_PHOTO_PX = 100_000, 4000
LARGE_ERRORS = 0.6, 0.003, 0.1
#: Displays whose views are compared: rotation error, degrees; relative pitch error; width of the photographs, pixels.
SEEN_DEG, SEEN_PITCH, VIEWS_PHOTO_PX = 0.3, 0.002, 2000
#: Scale of the fish, mm per unit; samples per pixel of its pictures and of the reference; rays per pixel of a view.
SCALE, PICTURE_SAMPLES, REFERENCE_SAMPLES, EYE_SAMPLES = 0.25, 4, 16, 64


@dataclass(frozen=True)
class Case:
    """A display as described (nominal) and as built, and the cameras and the sensor that photograph it."""

    name: str
    nominal: Display
    built: Display
    cameras: tuple[Camera, ...]
    sensor: Sensor

    def shoot(self, folder: Path, seed: int = 0, bench: Bench = UNDISTURBED, steps: int = STEPS) -> Path:
        """Write both display files, the patterns and the photographs; return the folder of the photographs."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "nominal.toml").write_text(display_text(self.nominal))
        (folder / "built.toml").write_text(display_text(self.built))
        patterns, photographs = folder / "patterns", folder / "photographs"
        write_patterns(replace(PatternSet.of(self.nominal), steps=steps), self.nominal, patterns)
        for number, camera in enumerate(self.cameras, 1):
            position = photographs / f"position-{number}"
            photograph_folder(self.built, camera, patterns, position, seed + number, self.sensor, bench)
        (photographs / "patterns.toml").write_text((patterns / "patterns.toml").read_text())
        return photographs


def photo_width(panel_px: int) -> int:
    """Return the width, pixels, of a panel's photographs: the smallest lenslets get about 45 pixels each."""
    return round(25.0 / 8.0 * panel_px)


def random_case(seed: int, panel_px: int = 640, photo_px: int = 1000, positions: int = 3) -> Case:
    """Return a random display and its cameras; panel and photographs (4:3) are `panel_px` and `photo_px` wide."""
    rng = np.random.default_rng((seed, 0xCA1))
    between = rng.uniform
    pixel = math.exp(between(math.log(0.04), math.log(0.2)))
    panel = Panel(panel_px, 3 * panel_px // 4, pixel)
    grid: Grid = "hex" if seed % 2 else "square"
    side: PlanoSide = "viewer" if seed // 2 % 2 else "panel"
    pitch, index = pixel * between(*LENSLET_PX), between(1.48, 1.6)
    focal = pitch * between(2.2, 4.0)
    array = Array(grid, pitch, focal * (index - 1.0), index, focal, side, rotation_deg=(0.0, 90.0)[seed // 4 % 2])
    array = replace(array, thickness_mm=array.sag_mm + between(0.1, 0.5) * focal)
    gap = between(0.97, 1.03) * focal - (array.thickness_mm / index if side == "panel" else 0.0)
    nominal = Display(f"case-{seed}", panel, array, gap)
    built = nominal.misaligned(
        rotation_deg=between(-ROTATION_DEG, ROTATION_DEG),
        offset_mm=(pitch * between(-0.5, 0.5), pitch * between(-0.5, 0.5)),
        gap_mm=gap * between(-GAP, GAP),
        pitch_scale=1.0 + between(-PITCH, PITCH),
    )
    px = built.array.pitches_mm[0]
    uneven = replace(built.array, pitch_mm=(px, px * (1.0 + RATIO * rng.normal())), shear=SHEAR * rng.normal())
    built = replace(built, array=replace(uneven, thickness_mm=max(uneven.thickness_mm, uneven.sag_mm)))
    return Case(nominal.name, nominal, built, _cameras(built, rng, photo_px, positions), _sensor(rng))


def _cameras(display: Display, rng: np.random.Generator, photo_px: int, positions: int) -> tuple[Camera, ...]:
    """Return a camera at several positions, with the same lens, aimed near the panel's middle."""
    between, width = rng.uniform, display.panel.width_mm
    size = photo_px, 3 * photo_px // 4
    pupil, first = width * between(0.003, 0.02), between(0.0, 2.0 * math.pi)
    cameras = []
    for number in range(positions):
        angle = math.radians(between(0.0, NEAR_AXIS_DEG) if number == 0 else between(*ASIDE_DEG))
        # The positions after the first one are spread around the axis.
        turn = first + 2.0 * math.pi * (number + between(-0.2, 0.2)) / max(positions - 1, 1) * 0.7
        distance = width * between(*DISTANCE)
        across = distance * math.sin(angle)
        place = across * math.cos(turn), across * math.sin(turn), distance * math.cos(angle)
        aim = width * between(-0.02, 0.02), width * between(-0.02, 0.02), 0.0
        away = math.dist(place, aim) * between(0.98, 1.02)
        cameras.append(Camera(place, aim, between(-10.0, 10.0), *size, pupil_mm=pupil, focus_mm=away))
    lens: dict[str, Any] = {
        "focal_px": min(framed(camera, display).focal_px for camera in cameras),
        "principal_px": (size[0] * between(0.48, 0.52), size[1] * between(0.48, 0.52)),
        "k1": between(-0.15, 0.1),
        "k2": between(-0.05, 0.05),
        "vignetting": between(0.0, 0.4),
        "blur_px": between(0.4, 0.7),
    }
    return tuple(replace(camera, **lens) for camera in cameras)


def _sensor(rng: np.random.Generator) -> Sensor:
    between = rng.uniform
    curve = ("srgb", "gamma2.2")[int(rng.integers(2))]
    return Sensor(between(0.6, 0.9), between(5000.0, 20000.0), between(3.0, 10.0), transfer=curve)


class Judgement(NamedTuple):
    """Errors of a calibrated display: `..._px` of lenslet centres, `gap_percent` of `aperture_distance_mm`."""

    rms_px: float
    worst_px: float
    rotation_deg: float
    pitch_ppm: float
    gap_percent: float
    shear_ppm: float


def judge(solved: Display, truth: Display) -> Judgement:
    """Return a calibrated display's errors; each true lenslet centre is compared with the nearest calibrated centre."""
    system = System.of(solved)
    _, _, x, y = system.locate(NumpyBackend(), *centres_px(truth).T)
    error = np.hypot(*np.stack(system.frame.turn(x, y), axis=1).T / np.reshape(truth.panel.pitches_mm, (2, 1)))
    ratios = [a / b - 1.0 for a, b in zip(solved.array.pitches_mm, truth.array.pitches_mm, strict=True)]
    depth, true_depth = solved.aperture_distance_mm, truth.aperture_distance_mm
    return Judgement(
        float(np.sqrt((error**2).mean())),
        float(error.max()),
        abs(_turn_between(solved.array.rotation_deg, truth)),
        1e6 * max(map(abs, ratios)),
        100.0 * abs(depth - true_depth) / true_depth,
        1e6 * abs(solved.array.shear - truth.array.shear),
    )


def _turn_between(rotation_deg: float, truth: Display) -> float:
    """Return the angle, degrees, from the true array to an array of `rotation_deg`, modulo the grid's symmetry."""
    turn = 90.0 if truth.array.grid == "square" else 60.0
    return (rotation_deg - truth.array.rotation_deg + 0.5 * turn) % turn - 0.5 * turn


def centres_px(display: Display) -> Floats:
    """Return the centres of the lenslets in front of the panel, (N, 2), in panel pixels."""
    i, j = _lenslets(display)
    return np.stack(PanelFrame.of(display).pixel_from_panel(*System.of(display).centre(i, j)), axis=1)


def _lenslets(display: Display) -> tuple[Floats, Floats]:
    panel, lattice, frame = display.panel, Lattice.of(display.array), PanelFrame.of(display)
    corners = np.array([(u, v) for u in (0.0, panel.width_px) for v in (0.0, panel.height_px)])
    at = lattice.locate(NumpyBackend(), *frame.array_from_panel(*frame.panel_from_pixel(*corners.T)))
    (low_i, high_i), (low_j, high_j) = ((int(k.min()) - 1, int(k.max()) + 2) for k in at[:2])
    i, j = (k.ravel().astype(np.float64) for k in np.mgrid[low_i:high_i, low_j:high_j])
    u, v = frame.pixel_from_panel(*System.of(display).centre(i, j))
    inside = (u >= 0.0) & (u < panel.width_px) & (v >= 0.0) & (v < panel.height_px)
    inside &= lattice.present(NumpyBackend(), i, j)
    return i[inside], j[inside]


def seen_px(display: Display, eye_mm: Point) -> Floats:
    """Return the panel points (N, 2), in pixels, that an eye sees through the lenslets' centres."""
    system, (i, j) = System.of(display), _lenslets(display)
    x, y = system.centre(i, j)
    aim = np.stack([x, y, np.zeros_like(x)], axis=1) - np.asarray(eye_mm)
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    hits = trace_to_panel(display, np.broadcast_to(eye_mm, aim.shape), aim)
    return hits.pixel[gets_through(hits.status)]


def eye_difference(solved: Display, truth: Display, eye_mm: Point, solved_eye_mm: Point | None = None) -> Floats:
    """Return the distances, px, between panel points that an eye sees and those that the calibration predicts."""
    expected, points = seen_px(solved, solved_eye_mm or eye_mm), seen_px(truth, eye_mm)
    distance, _ = KDTree(expected).query(points)
    # Ignore points near the panel's edge: the matching predicted point may be outside the panel.
    edge = 0.6 * truth.array.coarsest_mm / min(truth.panel.pitches_mm)
    size = truth.panel.width_px, truth.panel.height_px
    inner = ((points > edge) & (points < np.subtract(size, edge))).all(axis=1)
    return np.asarray(distance[inner], np.float64)


def deviations(result: Calibration, truth: Display) -> dict[str, float]:
    """Return each parameter's error divided by half its 95 % interval; offsets are compared modulo the lattice."""
    array, frame = truth.array, PanelFrame.of(truth)
    names = ("pitch_x", "pitch_y", "shear", "rotation", "offset_x", "offset_y", "gap")
    value = {name: result.parameter(name).value for name in names}
    offset = np.array([[value["offset_x"]], [value["offset_y"]]])
    *_, x, y = Lattice.of(array).locate(NumpyBackend(), *frame.array_from_panel(*offset))
    off_x, off_y = frame.turn(x, y)
    errors = {"pitch_x": value["pitch_x"] - array.pitches_mm[0], "pitch_y": value["pitch_y"] - array.pitches_mm[1]}
    errors |= {"shear": value["shear"] - array.shear, "rotation": _turn_between(value["rotation"], truth)}
    errors |= {"offset_x": float(off_x[0]), "offset_y": float(off_y[0]), "gap": value["gap"] - truth.gap_mm}
    return {name: error / result.parameter(name).uncertainty for name, error in errors.items()}


def solve_case(case: Case, photographs: Path, bow: bool = False) -> dict[str, Any]:
    """Calibrate from a case's photographs; return the row: errors, seconds, parameters outside their intervals."""
    started = time.perf_counter()
    result = calibrate(photographs, case.nominal, bow)
    seconds = time.perf_counter() - started
    off = deviations(result, case.built)
    bows = {"bow_um": sum(1000.0 * result.parameter(name).value for name in ("bow_xx", "bow_yy"))} if bow else {}
    array, lenslets = case.built.array, len(centres_px(case.built))
    keys = {"display": case.name, "grid": array.grid, "plano_side": array.plano_side, "lenslets": lenslets}
    beyond = sum(abs(one) > 1.0 for one in off.values())
    outside = {"outside": beyond, "numbers": len(off), "most_intervals": max(map(abs, off.values()))}
    return {**keys, **judge(result.display, case.built)._asdict(), **outside, "seconds": seconds, **bows}


def measure(
    folder: Path, seeds: Sequence[int], disturbances: Disturbances, solids: bool, panel_px: int, jobs: int
) -> Iterator[dict[str, Any]]:
    """Photograph (with `solids` by POV-Ray) and calibrate random displays in `jobs` processes; yield their rows."""
    one = partial(measure_one, folder, disturbances=disturbances, solids=solids, panel_px=panel_px)
    if jobs == 1:
        yield from map(one, seeds)
        return
    with _workers(jobs) as client:
        yield from (future.result() for future in client.map(one, seeds))


@contextlib.contextmanager
def _workers(count: int) -> Iterator[Client]:
    """Start worker processes, which end with this context; yield their client."""
    from distributed import Client

    with local_workers(count) as (address, security), Client(address, security=security) as client:
        yield client


def measure_one(folder: Path, seed: int, disturbances: Disturbances, solids: bool, panel_px: int) -> dict[str, Any]:
    """Photograph and calibrate a random display; return its row; `refused` tells why a calibration fails."""
    case = random_case(seed, panel_px, photo_width(panel_px))
    place = folder / case.name
    photographs = case.shoot(place, seed, SolidsBench(seed=seed) if solids else disturbances)
    try:
        return solve_case(case, photographs, bow=disturbances.bow_mm != 0.0)
    except LippmannError as error:
        return {"display": case.name, "refused": str(error)}
    finally:
        shutil.rmtree(place)


def largest(folder: Path, scenes: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Calibrate the 8K display in a new process; yield its row with `megapixels`, `photographs` and `peak_mb`."""
    nominal, rng = load_display(scenes / "displays/uhd-8k.toml"), np.random.default_rng((seed, 0x8))
    pitch = math.sqrt(nominal.panel.width_mm * nominal.panel.height_mm / LENSLETS)
    nominal = replace(nominal, array=replace(nominal.array, pitch_mm=pitch))
    turn, scale, gap = LARGE_ERRORS
    built = nominal.misaligned(rotation_deg=turn, pitch_scale=1.0 + scale, gap_mm=gap * nominal.gap_mm)
    case = Case(nominal.name, nominal, built, _cameras(built, rng, LARGE_PHOTO_PX, POSITIONS), _sensor(rng))
    photographs = case.shoot(folder / case.name, seed)
    megapixels = case.cameras[0].width_px * case.cameras[0].height_px / 1e6
    size = {"megapixels": megapixels, "photographs": len(list(photographs.glob("*/*.png")))}
    with _workers(1) as client:
        yield {**client.submit(_weighed, case, photographs).result(), **size}
    shutil.rmtree(folder / case.name)


def _weighed(case: Case, photographs: Path) -> dict[str, Any]:
    return {**solve_case(case, photographs), "peak_mb": proc_mb("self/status", "VmHWM")}


def sweep(folder: Path, seeds: Sequence[int], jobs: int = 1) -> Iterator[dict[str, Any]]:
    """Calibrate with one quantity changed; yield rows that also have the quantity's name (`over`) and `value`."""
    defaults = {"positions": POSITIONS, "steps": STEPS, "noise": 1}
    runs = [(seed, over, value) for seed in seeds for over, values in SWEPT.items() for value in values]
    settings = [(seed, *(defaults | {over: value}).values()) for seed, over, value in runs]
    with _workers(jobs) as client:
        # Settings that occur in several sweeps are calibrated once.
        results = {one: client.submit(_swept, folder, *one) for one in dict.fromkeys(settings)}
        for (seed, over, value), one in zip(runs, settings, strict=True):
            yield {"display": f"case-{seed}", "over": over, "value": value, **results[one].result()}


def _swept(folder: Path, seed: int, positions: int, steps: int, noise: int) -> dict[str, Any]:
    case = random_case(seed, positions=max(SWEPT["positions"]))
    sensor = replace(
        case.sensor, full_well_e=case.sensor.full_well_e / noise**2, read_noise_e=case.sensor.read_noise_e / noise
    )
    place = folder / f"{case.name}-{positions}-{steps}-{noise}"
    photographs = replace(case, cameras=case.cameras[:positions], sensor=sensor).shoot(place, seed, steps=steps)
    row = {"photographs": len(list(photographs.glob("*/*.png")))}
    try:
        result = calibrate(photographs, case.nominal)
    except LippmannError as error:
        return {**row, "refused": str(error)}
    finally:
        shutil.rmtree(place)
    x, y, z = result.cameras[0]["place_mm"]
    eye = eye_difference(result.display, case.built, case.cameras[0].position_mm, (x, y, z))
    return {**row, **judge(result.display, case.built)._asdict(), "eye_px": float(np.sqrt((eye**2).mean()))}


def views(folder: Path, scenes: Path, names: Sequence[str], seed: int = 0) -> Iterator[dict[str, Any]]:
    """Calibrate misaligned displays; yield the PSNR (dB) of views of the fish by an eye at the first camera.

    The shown image is rendered for the nominal (`before_db`), calibrated (`after_db`) or built (`ideal_db`) display.
    """
    scene = load_scene(scenes / "fish/fish.xml", Placement(SCALE))
    for name in names:
        nominal = load_display(scenes / f"displays/{name}.toml")
        built = nominal.misaligned(rotation_deg=SEEN_DEG, pitch_scale=1.0 + SEEN_PITCH)
        rng = np.random.default_rng((seed, 0xF15))
        case = Case(name, nominal, built, _cameras(built, rng, VIEWS_PHOTO_PX, POSITIONS), _sensor(rng))
        solved = calibrate(case.shoot(folder / name, seed), nominal).display
        eye = Eye(case.cameras[0].position_mm)
        reference = _view(scene, built, built, eye, Settings(samples=REFERENCE_SAMPLES, seed=seed + 1))
        settings = Settings(samples=PICTURE_SAMPLES, seed=seed)
        decibels = {
            f"{when}_db": psnr_db(_view(scene, display, built, eye, settings), reference)
            for when, display in (("before", nominal), ("after", solved), ("ideal", built))
        }
        yield {"display": name, **judge(solved, built)._asdict(), **decibels}


def _view(scene: Scene, display: Display, built: Display, eye: Eye, settings: Settings) -> Radiance:
    """Return an eye's view of the display `built`, which shows a picture that was rendered for `display`."""
    picture = render_integral(scene, display, "exact", settings).radiance
    return observe(np.minimum(picture, 1.0), built, eye, whole_window(built), EYE_SAMPLES).radiance


@measurement(page="calibration-accuracy", packages=(*ON_DEVICE, "scipy", "opencv-python-headless"))
def calibration(
    bench: MeasurementRun,
    displays: int = option("Number of random displays; the seeds start at --seed.", 12, click.IntRange(1)),
    solids: int = option("Number of random displays that POV-Ray photographs too.", 0, click.IntRange(0)),
    bowed: int = option("Number of random displays with bow, dust and bad camera pixels.", 0, click.IntRange(0)),
    large: bool = option("Also calibrate an 8K panel behind 100,000 lenslets.", False),
    swept: int = option("Number of random displays in the sweep.", 2, click.IntRange(0), flag="--sweep"),
    width_px: int = option("Width of the random panels, pixels.", 640, click.IntRange(320, 8192), flag="--width"),
    jobs: int = option("Number of processes that calibrate.", 1, click.IntRange(1)),
) -> tuple[Mapping[str, Any], Page]:
    """Calibrate random displays from simulated photographs, and compare the results with the displays as built.

    A sweep changes the numbers of photographs and positions, and the noise. Views of the fish are compared as well.

    Example: python -m tools.bench calibration --displays 4
    """
    with scratch_folder() as folder:
        first = bench.seed
        one = partial(measure, folder, panel_px=width_px, jobs=jobs)
        measured = {
            "rows": one(range(first, first + displays), Disturbances(), solids=False),
            "solids": one(range(first, first + solids), Disturbances(), solids=True),
            "bowed": one(range(first, first + bowed), BOWED, solids=False),
            "large": largest(folder, bench.scenes, first) if large else (),
            "sweep": sweep(folder, range(first, first + swept), jobs),
            "views": views(folder, bench.scenes, ("vga-square", "vga-hex"), first),
        }
        tables = {name: bench.collect(rows) for name, rows in measured.items()}
    return tables, accuracy_page(bench.origin, tables, width_px)


def accuracy_page(origin: Mapping[str, str], tables: Mapping[str, Rows], panel_px: int) -> Page:
    """Return the page of `tools.bench calibration`; `panel_px` is the width of the random displays' panels."""
    random = [*tables["rows"], *tables["solids"], *tables["bowed"]]
    context = {name: [row for row in rows if "refused" not in row] for name, rows in tables.items()}
    solved = context["rows"]
    context["sweep"] = list(tables["sweep"])
    context["refused"] = [row for row in random if "refused" in row]
    widths = {"tried": len(random), "panel_px": panel_px, "photo_px": photo_width(panel_px)}
    sums = {name: sum(row[name] for row in solved) for name in ("outside", "numbers")}
    labels = [f"{row['display']} {row['grid']} {row['plano_side']}" for row in solved]
    charts = {"centres, px rms": values(solved, "rms_px"), "gap, %": values(solved, "gap_percent")}
    plot = [draw_bar_charts("calibration-accuracy", labels, charts)] if solved else []
    plot += [draw_calibration_sweep(tables["sweep"])] if tables["sweep"] else []
    csv_tables = {"accuracy": solved, **{name: rows for name, rows in tables.items() if name != "rows"}}
    files = {f"calibration-{name}": rows for name, rows in csv_tables.items() if rows}
    return make_page("calibration-accuracy", origin, plot, files, {**context, **widths, **sums})


SWEPT_AXES = {
    "positions": ("value", "places of the camera"),
    "steps": ("photographs", "photographs from three places"),
    "noise": ("value", "noise, times the sensor's"),
}


def draw_calibration_sweep(rows: Rows) -> Plot:
    """Draw the calibrations' errors against each swept quantity."""
    solved = [row for row in rows if "refused" not in row]
    kinds = groups(solved, "over")
    picture, axes = make_axes(2, len(kinds), (3.6, 2.8))
    for column_of_axes, kind in zip(axes.T, kinds, strict=True):
        column, heading = SWEPT_AXES[kind[0]["over"]]
        labels = {"rms_px": "centres, px rms", "gap_percent": "gap, %"}
        for axis, (key, label) in zip(column_of_axes, labels.items(), strict=True):
            draw_lines(axis, kind, "display", column, key)
            axis.set(xlabel=heading, ylabel=label, yscale="log", ylim=(0.5 * min(values(solved, key)), None))
    return Plot("calibration-sweep", finish_picture(picture))
