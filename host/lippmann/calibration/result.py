"""Result of a calibration: display, uncertainties, warnings and residuals."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, TypedDict

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.stats import t as students_t

from lippmann.base.file_limits import load_arrays
from lippmann.base.files import replacing, write_file
from lippmann.calibration.bundle_adjustment import BOW, Solution
from lippmann.display.description import Array, Display, check_radius, display_text, load_display, parse_display
from lippmann.errors import InputError, LippmannError, input_error, reason
from lippmann.optics.rays import Floats

#: Maximum uncertainty of a determined parameter: rotation in degrees, gap relative to
#: the aperture distance D, radius relative to itself, others relative to the pitch.
OPEN = {"pitch_x": 2e-4, "pitch_y": 2e-4, "gap": 0.02, "offset": 0.02, "rotation": 0.01, "radius": 0.02}
#: Number of camera positions that suffice to determine all parameters.
ENOUGH_POSITIONS = 3
#: Number of columns of `Calibration.field`.
FIELD_COLUMNS = 8


class ContradictionError(LippmannError):
    """The photographs contradict each other or the display file."""

    exit_code = 4


@dataclass(frozen=True)
class Parameter:
    """A parameter, its uncertainty (half of the 95 % interval), and whether it was determined."""

    name: str
    value: float
    uncertainty: float
    unit: str
    nominal: float
    determined: bool


class FoundCamera(TypedDict):
    """A fitted camera position, with statistics of its photographs."""

    name: str
    place_mm: Annotated[list[float], msgspec.Meta(min_length=3, max_length=3)]
    uncertainty_mm: list[float]
    lenslets: int
    agree: float
    modulation: float


@dataclass(frozen=True)
class Findings:
    """The results in the .npz file, except the residuals."""

    parameters: tuple[Parameter, ...]
    remarks: tuple[str, ...]
    cameras: Annotated[tuple[FoundCamera, ...], msgspec.Meta(min_length=1)]
    #: Camera lens: focal length and principal point, pixels, and distortion k1, k2.
    lens: dict[str, float]
    rms_panel_px: float
    rms_photo_px: float
    outliers: float


@dataclass(frozen=True, eq=False)
class Calibration(Findings):
    """The calibrated display, with uncertainties and residuals."""

    display: Display
    nominal: Display
    #: Residuals, a row for each lenslet of each position: position, i, j, centre x and
    #: y in mm, residual to the right and down in px, and inlier (0 or 1).
    field: Floats

    def summary(self) -> dict[str, Any]:
        """Return all results except the residuals, as values for JSON."""
        findings = {one.name: msgspec.to_builtins(getattr(self, one.name)) for one in fields(Findings)}
        head = {"display": self.display.name, "identity": self.display.identity}
        return {**head, **findings, "lenslets": len(self.field)}

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by its name."""
        return next(one for one in self.parameters if one.name == name)

    def save(self, path: Path) -> Path:
        """Write the display to `path` and the other results to a .npz file; return its path."""
        sidecar = path.with_suffix(".npz")
        write_file(path, display_text(self.display))
        with replacing(sidecar) as partial:
            summary, nominal = _bytes(json.dumps(self.summary())), _bytes(display_text(self.nominal))
            np.savez_compressed(partial, field=self.field, summary=summary, nominal=nominal)
        return sidecar


def _bytes(text: str) -> npt.NDArray[np.uint8]:
    return np.frombuffer(text.encode(), np.uint8)


def _text(array: npt.NDArray[Any]) -> str:
    if array.dtype != np.uint8:
        raise ValueError(f"a text has the type {array.dtype}")
    return array.tobytes().decode()


def load_calibration(path: Path) -> Calibration:
    """Read the files that `Calibration.save` wrote.

    Raises InputError if the .npz file is damaged or belongs to another display.
    """
    display = load_display(path)
    sidecar = path.with_suffix(".npz")
    remedy = "give a display file that lippmann calibrate solve wrote"
    arrays, _ = load_arrays(sidecar, ("summary", "nominal", "field"), remedy)
    try:
        summary = json.loads(_text(arrays["summary"]))
        findings = msgspec.convert(summary, Findings)
        field, nominal = np.asarray(arrays["field"], np.float64), _text(arrays["nominal"])
        if field.ndim != 2 or field.shape[1] != FIELD_COLUMNS or len(field) != summary["lenslets"]:
            raise ValueError(f"the residuals have the shape {field.shape}")
        identity = summary["identity"]
    except (KeyError, ValueError, RecursionError) as error:
        why = f"{error} is missing" if isinstance(error, KeyError) else reason(error)
        raise input_error(sidecar, f"cannot be read ({why})", remedy) from None
    if identity != display.identity:
        remedy = "run calibrate solve again, and keep its .toml and .npz together"
        raise input_error(sidecar, "belongs to another display file", remedy)
    return Calibration(**vars(findings), display=display, nominal=parse_display(nominal, "nominal"), field=field)


def display_of(nominal: Display, solution: Solution) -> Display:
    """Return the display with the fitted array and gap.

    Raises ContradictionError if the display is physically impossible.
    """
    value, array = solution.value, nominal.array
    pitch_mm, gap = (value("pitch_x"), value("pitch_y")), value("gap")
    extent = array.extent_mm
    if extent is not None:
        extent = tuple(np.multiply(extent, pitch_mm) / array.pitches_mm)
    if gap < -3.0 * solution.deviation("gap"):
        what = f"the fitted gap is {gap:.4f} +- {1.96 * solution.deviation('gap'):.4f} mm, below 0"
        raise ContradictionError(f"{what}; correct thickness_mm or index in the display file")
    mounted: Array = replace(
        array,
        pitch_mm=pitch_mm,
        shear=value("shear"),
        rotation_deg=math.degrees(value("rotation")),
        offset_mm=(value("offset_x"), value("offset_y")),
        extent_mm=extent,
    )
    try:
        check_radius(mounted, "array.radius_mm")
        mounted = replace(mounted, thickness_mm=max(mounted.thickness_mm, mounted.sag_mm))
    except InputError as error:
        raise ContradictionError(f"the fitted array is physically impossible ({error})") from None
    return replace(nominal, array=mounted, gap_mm=max(0.0, gap))


def parameters_of(nominal: Display, solution: Solution) -> tuple[Parameter, ...]:
    """Return the fitted parameters of array and gap with 95 % intervals."""
    array, factor = nominal.array, float(students_t.ppf(0.975, 60))
    (px, py), depth, degree = array.pitches_mm, nominal.aperture_distance_mm, math.degrees(1.0)
    # A row has unit, factor to the unit, display file's value, maximum uncertainty.
    rows = {
        "pitch_x": ("mm", 1.0, px, OPEN["pitch_x"] * px),
        "pitch_y": ("mm", 1.0, py, OPEN["pitch_y"] * py),
        "shear": ("", 1.0, array.shear, OPEN["pitch_x"]),
        "rotation": ("deg", degree, array.rotation_deg, OPEN["rotation"]),
        "offset_x": ("mm", 1.0, array.offset_mm[0], OPEN["offset"] * px),
        "offset_y": ("mm", 1.0, array.offset_mm[1], OPEN["offset"] * py),
        "gap": ("mm", 1.0, nominal.gap_mm, OPEN["gap"] * depth),
    }
    if "bow" not in solution.problem.fixed:
        rows |= dict.fromkeys(BOW, ("mm", 1.0, 0.0, 0.01 * depth))
    parameters = []
    for name, (label, unit, before, limit) in rows.items():
        half = unit * factor * solution.deviation(name)
        parameters.append(Parameter(name, unit * solution.value(name), half, label, before, half < limit))
    return tuple(parameters)


def find_warnings(parameters: tuple[Parameter, ...], solution: Solution) -> tuple[str, ...]:
    """Return warnings of undetermined parameters, with remedies."""
    undetermined = [one.name for one in parameters if not one.determined]
    views = len(solution.problem.views)
    if not undetermined:
        return ()
    warnings = []
    pairs = [("pitch_x", "gap"), ("pitch_y", "gap"), ("gap", "focal"), ("pitch_x", "focal")]
    pairs += [(f"offset_{axis}", f"place_{axis}_{k}") for axis in "xy" for k in range(views)]
    pairs += [(f"offset_{axis}", f"middle_{axis}") for axis in "xy"]
    alike = [(a, b, r) for a, b in pairs if abs(r := solution.correlation(a, b)) > 0.98]
    words = {"place": "the camera position", "middle": "the lens's principal point", "focal": "the lens's focal length"}
    pairs_text = sorted({f"{a} and {words.get(b.split('_')[0], b)}" for a, b, _ in alike})
    text = f"the photographs do not determine {', '.join(undetermined)}"
    warnings.append(text + (f"; the photographs do not separate {', '.join(pairs_text)}" if pairs_text else ""))
    if views < ENOUGH_POSITIONS:
        more = ENOUGH_POSITIONS - views
        warnings.append(
            f"only {views} camera position{'s' * (views > 1)}; to determine all parameters, add {more} more, at "
            "other distances and shifted sideways by a third of the distance"
        )
        if views == 1:
            x, y, z = (solution.value(f"place_{axis}_0") for axis in "xyz")
            half = 1.96 * solution.deviation("place_z_0")
            place = f"({x:.0f}, {y:.0f}, {z:.0f} +- {half:.0f}) mm"
            warnings.append(f"the display file is correct only for eyes near {place}, the camera's fitted position")
    else:
        warnings.append("photograph again, farther to the sides, with distances that differ by half")
    return tuple(warnings)
