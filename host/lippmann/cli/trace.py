"""Command `lippmann trace`."""

from __future__ import annotations

import itertools
import re
import time
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lippmann.base.file_limits import MAX_RAYS, MAX_TABLE_BYTES, check_expanded, lines_of, load_arrays, read_limited
from lippmann.base.files import replacing
from lippmann.base.images import check_output
from lippmann.base.variant import start_mitsuba
from lippmann.cli.frame import Name, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, ENGINE_BITS, LENS_MODEL, SEED
from lippmann.cli.output import emit
from lippmann.display.description import Display
from lippmann.engines import trace
from lippmann.errors import input_error, not_there, reason
from lippmann.optics.backend import NumpyBackend
from lippmann.optics.lattice import Lattice
from lippmann.optics.rays import Engine, Floats, Model, Status
from lippmann.optics.sample_points import square_to_cell

#: Memory per ray in bytes, measured with the engine golden.
RAY_BYTES = 350
ARRAYS = ("origin_mm", "direction", "status", "lenslet", "centre_mm", "local_mm")


@make_command("trace")
def command(
    display: Display = DISPLAY,
    engine: Engine = option("Engine that traces the rays.", "golden"),
    model: Model = LENS_MODEL,
    pixels: Name = option(
        "Number of random pixels, or a file (.npy, .npz with array `pixel`, .csv) of pixels or coordinates u, v.",
        metavar="N|FILE",
    ),
    aperture: Literal["chief", "full"] = option("Chief rays, or rays to random points of the lenslet.", "chief"),
    fraction_bits: int | None = ENGINE_BITS,
    wavelength_nm: float | None = option("Wavelength, nm; the display file must name a glass.", flag="--wavelength"),
    seed: int = SEED,
    device: str = DEVICE,
    output: Path = option(None, metavar="RAYS.npz"),
) -> None:
    """Trace rays from pixels through the lenslets.

    The .npz contains the arrays pixel, origin_mm, direction, status, lenslet and more.
    Status: 0 ok, 1 missed surface, 2 total internal reflection, 3 blocked, 4 crosstalk.

    Example: lippmann trace --display scenes/displays/paper-square.toml --pixels 1000 -o
    rays.npz
    """
    path = check_output(output, (".npz",))
    if wavelength_nm is not None:
        display = display.at_wavelength(wavelength_nm)
    random = np.random.default_rng(seed)
    pixel = _pixels(pixels, display, random)
    points = None
    if aperture == "full":
        s, t = random.uniform(size=(2, len(pixel)))
        points = np.stack(square_to_cell(NumpyBackend(), s, t, Lattice.of(display.array)), axis=1)
    if engine == "fast":
        device = start_mitsuba(device)
    if engine == "rtl":
        # Compile the RTL first, so that compilation is not timed.
        trace(display, pixel[:1], None if points is None else points[:1], model, engine, device, fraction_bits)
    started = time.perf_counter()
    rays = trace(display, pixel, points, model, engine, device, fraction_bits)
    seconds = time.perf_counter() - started
    counts = np.bincount(rays.status, minlength=len(Status))
    status = {kind.name.lower(): int(counts[kind]) for kind in Status}
    with replacing(path) as partial, partial.open("wb") as stream:
        aims = np.zeros_like(rays.pixel) if points is None else points
        np.savez(stream, pixel=rays.pixel, aperture_mm=aims, **{name: getattr(rays, name) for name in ARRAYS})
    result = {
        "output": path, "engine": engine, "model": model,
        "rays": len(pixel), "seed": seed, "seconds": seconds, "status": status,
    }  # fmt: skip
    shares = ", ".join(f"{name} {n}" for name, n in status.items() if n)
    emit(result, f"{len(pixel)} rays in {seconds:.3g} s ({shares}): {path}", display)


def _pixels(spec: str, display: Display, random: np.random.Generator) -> Floats:
    panel = display.panel
    size = np.array(panel.size_px)
    if re.fullmatch(r"[+-]?[0-9]{1,18}", spec):
        count = int(spec)
        if not 1 <= count <= MAX_RAYS:
            raise input_error("--pixels", f"{count} is out of range", f"give 1 to {MAX_RAYS}, or a file")
        check_expanded("--pixels", f"{count} rays", count * RAY_BYTES, "give fewer rays")
        columns, rows = (random.integers(0, side, count) for side in size)
        return np.stack([columns, rows], axis=1).astype(np.float64) + 0.5
    if not Path(spec).is_file():
        raise input_error(spec, not_there(Path(spec)), "give a number of rays or a .npy, .npz or .csv file")
    table = _table(Path(spec))
    if table.size == 0:
        raise input_error(spec, "contains no pixels", "give columns u, v")
    if table.ndim != 2 or table.shape[1] != 2 or table.dtype.kind not in "iuf":
        raise input_error(spec, f"contains {table.dtype} of shape {table.shape}", "give numbers of shape (N, 2)")
    values = np.asarray(table, np.float64)
    if not np.isfinite(values).all():
        raise input_error(spec, "contains values that are not finite", "remove them")
    if (values == np.floor(values)).all():
        values = values + 0.5
    if (values < 0.0).any() or (values > size).any():
        outside = f"contains pixels outside the panel of {panel.width_px} x {panel.height_px}"
        raise input_error(spec, outside, "give columns u, v inside the panel")
    return values


def _table(path: Path) -> np.ndarray[Any, Any]:
    remedy = "give columns u, v"
    try:
        if path.suffix == ".npy":
            return load_arrays(path, None, remedy, RAY_BYTES)[0][""]
        if path.suffix == ".npz":
            arrays, _ = load_arrays(path, ["pixel"], remedy, RAY_BYTES)
            if not arrays:
                raise input_error(path, "has no array pixel", "add it, with columns u, v")
            return arrays["pixel"]
        if path.suffix in (".csv", ".txt"):
            text = read_limited(path, MAX_TABLE_BYTES, "give the pixels as .npy").decode("utf-8")
            check_expanded(str(path), "its pixels", (text.count("\n") + 1) * RAY_BYTES, "give fewer rays")
            lines = (line for line in lines_of(text) if line.split("#")[0].strip())
            first = next(lines, "")
            if re.fullmatch(r"\s*u\s*,\s*v\s*(#.*)?", first, re.IGNORECASE):
                first = next(lines, "")
            return np.loadtxt(itertools.chain([first], lines), delimiter=",", ndmin=2) if first else np.empty((0, 2))
    except (ValueError, OSError, IndexError) as error:
        raise input_error(path, f"cannot be read ({reason(error)})", remedy) from None
    raise input_error(path, f"unknown extension '{path.suffix}'", "choose from .npy, .npz, .csv")
