"""`lippmann trace`: rays from pixels through the lenslets, into an .npz file."""

from __future__ import annotations

import re
import time
import warnings
import zipfile
from pathlib import Path
from typing import Any, cast

import click
import numpy as np
import numpy.typing as npt
from click.core import ParameterSource

from lippmann.cli.options.common import device_option, display_option, json_option, seed_option
from lippmann.cli.output import emit
from lippmann.display import Display, load_display
from lippmann.engines import trace
from lippmann.errors import input_error
from lippmann.fixed.words import FRACTIONS, WIDEST
from lippmann.images import check_output, replacing
from lippmann.optics.rays import ENGINES, MODELS, Engine, Model, Status

#: Rays that one call may ask for: what fits in memory.
MAX_RAYS = 100_000_000


@click.command("trace")
@display_option
@click.option("--engine", type=click.Choice(ENGINES), default="golden", show_default=True)
@click.option("--model", type=click.Choice(MODELS), default="exact", show_default=True)
@click.option(
    "--pixels",
    required=True,
    metavar="N|FILE",
    help="N random pixels; or .npy/.npz (array `pixel`)/.csv with columns u, v: whole numbers mean pixel centres, "
    "others are continuous pixel coordinates; a .csv may begin with the heading u,v.",
)
@click.option(
    "--aperture",
    type=click.Choice(["chief", "full"]),
    default="chief",
    show_default=True,
    help="Chief rays, or random points over the lenslet's cell.",
)
@click.option(
    "--fraction-bits",
    type=click.IntRange(FRACTIONS[0], FRACTIONS[-1]),
    default=WIDEST,
    show_default=True,
    help="Word length of the engines twin and rtl.",
)
@click.option("--wavelength", "wavelength_nm", type=float, help="nm; the array must name its glass.")
@seed_option
@device_option
@click.option("-o", "output", required=True, metavar="RAYS.npz")
@json_option
@click.pass_context
def command(
    ctx: click.Context,
    display_path: str,
    engine: str,
    model: str,
    pixels: str,
    aperture: str,
    fraction_bits: int,
    wavelength_nm: float | None,
    seed: int,
    device: str,
    output: str,
    as_json: bool,
) -> None:
    """Trace rays and write pixel, origin_mm, direction, status (and lenslet) as arrays.

    Status: 0 ok, 1 missed surface, 2 total internal reflection, 3 blocked, 4 crosstalk.

    Example: lippmann trace --display scenes/displays/paper-square.toml --engine fast --pixels 1000 -o rays.npz
    """
    if engine in ("golden", "fast") and ctx.get_parameter_source("fraction_bits") == ParameterSource.COMMANDLINE:
        raise click.UsageError(f"--fraction-bits belongs to the engines twin and rtl; leave it out with {engine}")
    if engine != "fast" and device == "cuda":
        raise click.UsageError(f"--device cuda belongs to the engine fast; leave it out with {engine}")
    path = check_output(output, (".npz",))
    display = load_display(display_path)
    if wavelength_nm is not None:
        display = display.at_wavelength(wavelength_nm)
    random = np.random.default_rng(seed)
    pixel = _pixels(pixels, display, random)
    points = _aperture(display, len(pixel), random) if aperture == "full" else None
    if engine == "fast":
        from lippmann.variant import start_mitsuba

        device = start_mitsuba(device)
    if engine == "rtl":
        # Compiles the RTL, which is no part of tracing.
        trace(
            display, pixel[:1], None if points is None else points[:1], cast(Model, model), "rtl", device, fraction_bits
        )
    started = time.perf_counter()
    rays = trace(display, pixel, points, cast(Model, model), cast(Engine, engine), device, fraction_bits)
    seconds = time.perf_counter() - started
    counts = np.bincount(rays.status, minlength=len(Status))
    with replacing(path) as partial, partial.open("wb") as stream:
        np.savez(
            stream,
            pixel=rays.pixel,
            aperture_mm=np.zeros_like(rays.pixel) if points is None else points,
            origin_mm=rays.origin_mm,
            direction=rays.direction,
            status=rays.status,
            lenslet=rays.lenslet,
            centre_mm=rays.centre_mm,
            local_mm=rays.local_mm,
        )
    result = {
        "output": str(path),
        "display": display.name,
        "identity": display.identity,
        "engine": engine,
        "model": model,
        "rays": len(pixel),
        "seed": seed,
        "seconds": seconds,
        "status": {status.name.lower(): int(counts[status]) for status in Status},
    }

    def text() -> None:
        shares = ", ".join(f"{name} {n}" for name, n in cast(dict[str, int], result["status"]).items() if n)
        click.echo(f"{len(pixel)} rays in {seconds:.3g} s ({shares}): {path}")

    emit(result, as_json, text)


def _pixels(spec: str, display: Display, random: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return pixel coordinates (N, 2) from a count or a file."""
    panel = display.panel
    if re.fullmatch(r"[+-]?[0-9]{1,18}", spec):
        count = int(spec)
        if not 1 <= count <= MAX_RAYS:
            raise input_error("--pixels", f"{count} is out of range", f"give 1 to {MAX_RAYS}, or a file")
        columns, rows = random.integers(0, panel.width_px, count), random.integers(0, panel.height_px, count)
        return np.stack([columns, rows], axis=1).astype(np.float64) + 0.5
    path = Path(spec)
    if not path.is_file():
        raise input_error(spec, "no such file", "give a number of rays or a .npy, .npz or .csv file")
    table = _table(path)
    if isinstance(table, np.ndarray) and table.size == 0:
        raise input_error(spec, "holds no pixels", "give columns u, v")
    if (
        not isinstance(table, np.ndarray)
        or table.ndim != 2
        or table.shape[1] != 2
        or len(table) == 0
        or table.dtype.kind not in "iuf"
    ):
        raise input_error(spec, f"holds {table.dtype} of shape {table.shape}", "give numbers of shape (N, 2)")
    values = np.asarray(table, np.float64)
    if not np.isfinite(values).all():
        raise input_error(spec, "holds values that are not finite", "remove them")
    if (values == np.floor(values)).all():
        values = values + 0.5
    if (values < 0.0).any() or (values[:, 0] > panel.width_px).any() or (values[:, 1] > panel.height_px).any():
        raise input_error(
            spec,
            f"holds pixels outside the panel of {panel.width_px} x {panel.height_px}",
            "give columns u, v within it",
        )
    return values


def _table(path: Path) -> Any:
    """Return what a file of pixels holds."""
    spec = str(path)
    try:
        if path.suffix == ".npy":
            with path.open("rb") as stream:
                return np.load(stream)
        if path.suffix == ".npz":
            with path.open("rb") as stream:
                return np.load(stream)["pixel"]
        if path.suffix in (".csv", ".txt"):
            with warnings.catch_warnings(action="ignore"):  # of an empty file, which is refused below
                return np.genfromtxt(path, delimiter=",", comments="#", ndmin=2, skip_header=_lines_of_header(path))
        raise input_error(spec, f"unknown extension '{path.suffix}'", "choose from .npy, .npz, .csv")
    except (ValueError, OSError, KeyError, IndexError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise input_error(spec, f"cannot be read ({error})", "give columns u, v") from None


def _lines_of_header(path: Path) -> int:
    """Return how many lines stand before the numbers where the columns have the heading u,v; else none."""
    with path.open(encoding="utf-8") as stream:
        for count, line in enumerate(stream, 1):
            text = line.split("#")[0].strip()
            if text:
                return count if re.fullmatch(r"u\s*,\s*v", text, re.IGNORECASE) else 0
    return 0


def _aperture(display: Display, count: int, random: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return random points (N, 2) over a lenslet's cell, mm."""
    from lippmann.optics.lattice import Lattice

    array = display.array
    lattice = Lattice(array.grid, array.pitch_mm)
    reach = array.pitch_mm / np.sqrt(3.0) if array.grid == "hex" else 0.5 * array.pitch_mm
    points = np.empty((0, 2))
    while len(points) < count:
        more = random.uniform(-reach, reach, (2 * (count - len(points)) + 16, 2))
        points = np.concatenate([points, more[lattice.holds(more[:, 0], more[:, 1])]])
    return np.asarray(points[:count], np.float64)
