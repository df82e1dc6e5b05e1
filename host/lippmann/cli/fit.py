"""Command `lippmann fit`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import ROUND_CEILING, Context
from pathlib import Path

import click

from lippmann.base.variant import own_variant
from lippmann.cli.frame import argument, flag_of, make_command, option
from lippmann.cli.options import DEVICE, SEED, TEXELS, vector
from lippmann.cli.options_rendering import MOVED, Moved
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.conformance.fit import MOST_SAMPLES, Fit, fit
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.layers.layer_costs import BLOCK_RAMS, MULTIPLIERS, SLOTS, TOLERANCE_DB, LayerChoice, choose_layers
from lippmann.optics.display_properties import display_properties
from lippmann.optics.model_choice import TOLERANCE
from lippmann.rendering.options import Settings
from lippmann.scenes.scene import check_scene_file


@make_command("fit")
def command(
    display: Display = argument("DISPLAY.toml"),
    tolerance: float = option("Maximum error, pixels of the reconstructed view; above 0.", TOLERANCE),
    depths: tuple[float, float] | None = option(
        "Depth range z of the scene, mm.  [default: the display's depth range]", kind=vector("FAR,NEAR")
    ),
    scene: Path | None = option("Scene (.xml); also choose its layers for a board that draws scenes."),
    tolerance_db: float = option("Minimum PSNR of the layers' view at every eye position, dB.", TOLERANCE_DB),
    slot: tuple[tuple[int, int], ...] = option(
        f"Slot size to try; can be repeated.  [default: {', '.join(f'{w}x{h}' for w, h in SLOTS)}]",
        SLOTS,
        TEXELS,
        multiple=True,
    ),
    block_rams: int = option("Maximum block RAMs for drawing.", BLOCK_RAMS, click.IntRange(1)),
    multipliers: int = option("Maximum multipliers for drawing.", MULTIPLIERS, click.IntRange(1)),
    moved: Moved = MOVED,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Choose the cheapest lens model, samples and RTL build; with --scene, also layers and their build.

    Errors of the chief rays stay within --tolerance. The command explains each choice.

    Example: lippmann fit scenes/displays/paper-square.toml --depths -40,30
    """
    if scene is None and moved.changes:
        raise InputError(f"{flag_of(next(iter(moved.changes)))} places a scene; give --scene too")
    far, near = depths or display_properties(display).depth_range_mm
    if not far <= near:
        raise input_error("--depths", f"{far:g} is nearer to the viewer than {near:g}", "give FAR,NEAR")
    best = fit(display, (far, near), tolerance)
    result = {
        "tolerance": tolerance,
        "depths_mm": [far, near],
        "model": best.choice.model,
        "model_errors": best.choice.error_px,
        "samples": best.samples,
        "sample_error": best.sample_error_px,
        "build": best.build and best.build.as_dict(),
        "build_error": best.build_error_px,
    }
    lines = [str(best.choice), _samples(best, tolerance), _build(best, tolerance)]
    if scene:
        settings, path = Settings(samples=16, seed=seed), check_scene_file(scene)
        with progress_bar("fit") as progress, own_variant(device):
            placed = moved.load(path, display)
            choice = choose_layers(placed, display, tolerance_db, slot, block_rams, multipliers, settings, progress)
        result |= {
            "tolerance_db": tolerance_db, "layers": choice.cheapest, "best": choice.best, "limit": choice.limit,
            "render_db": choice.render_db, "tried": choice.candidates,
        }  # fmt: skip
        lines += _layers(choice, tolerance_db)
    head = f"{display.name}, z = {far:.4g} to {near:.4g} mm; errors in pixels of the reconstructed view"
    emit(result, (head, *lines), display)


def _samples(best: Fit, tolerance: float) -> str:
    error = best.sample_error_px
    if best.samples is None:
        enough = Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(error)
        refusal = f"samples: the maximum, {MOST_SAMPLES} per pixel, is not enough for {tolerance:g}"
        return f"{refusal}; it is enough for --tolerance {enough:g}"
    return f"samples {best.samples} per pixel: error at most {error:.2g} (tolerance {tolerance:g})"


def _build(best: Fit, tolerance: float) -> str:
    build, error = best.build, best.build_error_px
    if build is None and math.isinf(error):
        return "RTL: no build supports this display and its rays"
    if build is None:
        return f"RTL: no build is within {tolerance:g} (smallest error {error:.2g})"
    kind = f"{build.model}, {build.grid}" + ", near eye" * build.converge
    quality = f"the cheapest hardware and the shortest words within {tolerance:g} (error {error:.2g})"
    return f"RTL {kind}, F {build.fraction_bits}: {quality}"


def _layers(choice: LayerChoice, tolerance_db: float) -> Iterator[str]:
    cheapest = choice.cheapest
    if cheapest is not None:
        yield f"layers {cheapest['layers']}: the cheapest within {tolerance_db:g} dB, of those tried:"
    else:
        limit = {
            "render": f"two full renders with other seeds differ as much ({_cut(choice.render_db or 0.0)} dB)",
            "hardware": "larger builds, not tried, need more than --block-rams or --multipliers",
            "depths": "the scene has no more depths, and no larger --slot was tried",
            "sizes": "no board has more layers, and no larger --slot was tried",
        }[choice.limit or "sizes"]
        yield f"layers: none of those tried is within {tolerance_db:g} dB; limit: {limit}"
    for row in choice.candidates:
        mark = "chosen" if row is cheapest else "best" if cheapest is None and row is choice.best else ""
        spent = f"{row['block_rams']:>3} block RAMs, {row['load_bytes']:>7} bytes, {row['multipliers']:>3} multipliers"
        size, quality = "{}x{}".format(*row["slot"]), f"{_cut(row['worst_db'])} dB (mean {_cut(row['view_db'])})"
        yield f"  {row['layers']} {row['filter']:<8} {size:<8} {spent}: {quality} {mark}".rstrip()


def _cut(decibels: float) -> str:
    """Round decibels down, so that no value below a tolerance appears equal to it."""
    return f"{math.floor(100.0 * decibels) / 100.0:.2f}"
