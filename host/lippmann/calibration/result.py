"""What a calibration found: the display, uncertainties, what the data leave open, and the field of residuals."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypedDict

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.stats import t as students_t

from lippmann.base.files import replacing
from lippmann.base.limits import load_arrays
from lippmann.calibration.bundle_adjustment import BOW, Solution
from lippmann.display.description import Array, Display, check_radius, display_text, load_display
from lippmann.errors import InputError, LippmannError, input_error, reason
from lippmann.optics.rays import Floats

#: Uncertainties beyond these are not determined: shares of the pitch, gap (D) and radius; mm of the offset; degrees.
OPEN = {"pitch_x": 2e-4, "pitch_y": 2e-4, "gap": 0.02, "offset": 0.02, "rotation": 0.01, "radius": 0.02}
#: Correlation from which on two parameters cannot be told apart.
ALIKE = 0.98
#: Positions of the camera that determine everything.
ENOUGH_POSITIONS = 3
#: Columns of the field (see `Calibration`).
FIELD_COLUMNS = 8


class ContradictionError(LippmannError):
    """The photographs contradict each other, or the model of the display: no result can be trusted."""

    exit_code = 4


@dataclass(frozen=True)
class Parameter:
    """A number of the array, half its 95 % interval, both in `unit`, and whether the photographs determined it."""

    name: str
    value: float
    uncertainty: float
    unit: str
    nominal: float
    determined: bool


class FoundCamera(TypedDict):
    """A position of the camera: its place, and what was seen from there."""

    name: str
    place_mm: Annotated[list[float], msgspec.Meta(min_length=3, max_length=3)]
    uncertainty_mm: list[float]
    lenslets: int
    agree: float
    modulation: float


class Summary(TypedDict):
    """What `Calibration.summary` holds, as it is read again."""

    display: str
    identity: str
    parameters: list[Parameter]
    remarks: list[str]
    cameras: Annotated[list[FoundCamera], msgspec.Meta(min_length=1)]
    lens: dict[str, float]
    rms_panel_px: float
    rms_photo_px: float
    outliers: float
    lenslets: int


@dataclass(frozen=True, eq=False)
class Calibration:
    """The display as mounted, and how well it is known."""

    display: Display
    nominal: Display
    parameters: tuple[Parameter, ...]
    remarks: tuple[str, ...]
    cameras: tuple[FoundCamera, ...]
    #: The lens: focal length and principal point, px, and distortion.
    lens: dict[str, float]
    rms_panel_px: float
    rms_photo_px: float
    outliers: float
    #: A row for each lenslet and position: position, i, j, centre x and y, mm, residual right and down, px, kept.
    field: Floats

    def summary(self) -> dict[str, Any]:
        """Return all but the field, for JSON: the keys of `Summary`."""
        same = ("parameters", "remarks", "cameras", "lens", "rms_panel_px", "rms_photo_px", "outliers")
        summary = {"display": self.display.name, "identity": self.display.identity}
        summary |= {name: msgspec.to_builtins(getattr(self, name)) for name in same}
        return {**summary, "lenslets": len(self.field)}

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by its name."""
        return next(one for one in self.parameters if one.name == name)

    def save(self, path: Path) -> Path:
        """Write the display file, and beside it a .npz with all else, which `report` reads; return the latter."""
        sidecar = path.with_suffix(".npz")
        with replacing(path) as partial:
            partial.write_text(display_text(self.display), encoding="utf-8")
        with replacing(sidecar) as partial:
            summary, nominal = _bytes(json.dumps(self.summary())), _bytes(display_text(self.nominal))
            np.savez_compressed(partial, field=self.field, summary=summary, nominal=nominal)
        return sidecar


def _bytes(text: str) -> npt.NDArray[np.uint8]:
    """Return a text as an array, which numpy reads without its pickles."""
    return np.frombuffer(text.encode(), np.uint8)


def _text(array: npt.NDArray[Any]) -> str:
    if array.dtype != np.uint8:
        raise ValueError(f"a text is stored as {array.dtype}")
    return array.tobytes().decode()


def load_calibration(path: Path) -> tuple[Display, dict[str, Any], Floats, str]:
    """Return a calibrated file's display, and from its .npz the summary, the field, and the nominal file's text."""
    display = load_display(path)
    sidecar = path.with_suffix(".npz")
    remedy = "give a display file that lippmann calibrate solve wrote"
    arrays, _ = load_arrays(sidecar, ("summary", "nominal", "field"), remedy)
    try:
        summary = json.loads(_text(arrays["summary"]))
        msgspec.convert(summary, Summary)
        field, nominal = np.asarray(arrays["field"], np.float64), _text(arrays["nominal"])
        if field.ndim != 2 or field.shape[1] != FIELD_COLUMNS or len(field) != summary["lenslets"]:
            raise ValueError(f"the field has the shape {field.shape}")
    except (KeyError, ValueError, RecursionError) as error:
        why = f"it lacks {error}" if isinstance(error, KeyError) else reason(error)
        raise input_error(str(sidecar), f"cannot be read ({why})", remedy) from None
    if summary["identity"] != display.identity:
        raise input_error(str(sidecar), "belongs to another display file", "solve again, and keep both files together")
    return display, summary, field, nominal


def display_of(nominal: Display, solution: Solution) -> Display:
    """Return the display with the array and the gap that were found.

    Raises ContradictionError when it cannot be built: the file's optics contradict the photographs.
    """
    value, array = solution.value, nominal.array
    px, py = value("pitch_x"), value("pitch_y")
    old = array.pitches_mm
    extent = array.extent_mm
    if extent is not None:
        extent = extent[0] * px / old[0], extent[1] * py / old[1]
    gap = value("gap")
    if gap < 0.0:
        limit = 3.0 * solution.deviation("gap")
        if gap < -limit:
            raise ContradictionError(
                f"the gap is {gap:.4f} +- {1.96 * solution.deviation('gap'):.4f} mm, below 0; correct thickness_mm or "
                "index in the display file"
            )
        gap = 0.0
    mounted: Array = replace(
        array,
        pitch_mm=(px, py),
        shear=value("shear"),
        rotation_deg=math.degrees(value("rotation")),
        offset_mm=(value("offset_x"), value("offset_y")),
        extent_mm=extent,
    )
    try:
        check_radius(mounted, "array.radius_mm")
        mounted = replace(mounted, thickness_mm=max(mounted.thickness_mm, mounted.sag_mm))
    except InputError as error:
        raise ContradictionError(f"the array that was found cannot be built ({error})") from None
    return replace(nominal, array=mounted, gap_mm=gap)


def parameters_of(nominal: Display, solution: Solution) -> tuple[Parameter, ...]:
    """Return the array's numbers with 95 % intervals."""
    array, factor = nominal.array, float(students_t.ppf(0.975, 60))
    depth = nominal.aperture_distance_mm
    rows: list[tuple[str, str, float, float, float]] = [
        ("pitch_x", "mm", 1.0, array.pitches_mm[0], OPEN["pitch_x"] * array.pitches_mm[0]),
        ("pitch_y", "mm", 1.0, array.pitches_mm[1], OPEN["pitch_y"] * array.pitches_mm[1]),
        ("shear", "", 1.0, array.shear, OPEN["pitch_x"]),
        ("rotation", "deg", math.degrees(1.0), array.rotation_deg, OPEN["rotation"]),
        ("offset_x", "mm", 1.0, array.offset_mm[0], OPEN["offset"] * array.pitches_mm[0]),
        ("offset_y", "mm", 1.0, array.offset_mm[1], OPEN["offset"] * array.pitches_mm[1]),
        ("gap", "mm", 1.0, nominal.gap_mm, OPEN["gap"] * depth),
    ]
    if solution.problem.bow:
        rows += [(name, "mm", 1.0, 0.0, 0.01 * depth) for name in BOW]
    parameters = []
    for name, label, unit, before, most in rows:
        half = unit * factor * solution.deviation(name)
        parameters.append(Parameter(name, unit * solution.value(name), half, label, before, half < most))
    return tuple(parameters)


def remarks_of(parameters: tuple[Parameter, ...], solution: Solution) -> tuple[str, ...]:
    """Return what the photographs leave open, and what would determine it."""
    undetermined = [one.name for one in parameters if not one.determined]
    views = len(solution.problem.views)
    if not undetermined:
        return ()
    remarks = []
    pairs = [("pitch_x", "gap"), ("pitch_y", "gap"), ("gap", "focal"), ("pitch_x", "focal")]
    pairs += [(f"offset_{axis}", f"place_{axis}_{k}") for axis in "xy" for k in range(views)]
    pairs += [(f"offset_{axis}", f"middle_{axis}") for axis in "xy"]
    alike = [(a, b, r) for a, b in pairs if abs(r := solution.correlation(a, b)) > ALIKE]
    words = {"place": "the camera's place", "middle": "the lens's principal point", "focal": "the lens's focal length"}
    pairs_text = sorted({f"{a} and {words.get(b.split('_')[0], b)}" for a, b, _ in alike})
    text = f"not determined: {', '.join(undetermined)}"
    remarks.append(text + (f"; the photographs cannot tell apart {', '.join(pairs_text)}" if pairs_text else ""))
    if views < ENOUGH_POSITIONS:
        more = ENOUGH_POSITIONS - views
        remarks.append(
            f"{views} position{'s' * (views > 1)} of the camera; photograph from {more} more, a third of the distance "
            "aside and at other distances, to determine them"
        )
        if views == 1:
            x, y, z = (solution.value(f"place_{axis}_0") for axis in "xyz")
            half = 1.96 * solution.deviation("place_z_0")
            place = f"({x:.0f}, {y:.0f}, {z:.0f} +- {half:.0f}) mm"
            remarks.append(f"the file is right for eyes near {place}, where the camera was found, not elsewhere")
    else:
        remarks.append("photograph from places farther aside, at distances that differ by half")
    return tuple(remarks)
