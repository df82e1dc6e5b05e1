"""`lippmann fit`: the cheapest model, samples and build of the RTL, and layers of a scene, that meet a tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import ROUND_CEILING, Context
from pathlib import Path

import click

from lippmann.cli.frame import argument, flag_of, make_command, option
from lippmann.cli.options import DEVICE, SEED, TEXELS, vector
from lippmann.cli.options_rendering import MOVED, Moved
from lippmann.cli.output import emit
from lippmann.cli.progress_bar import progress_bar
from lippmann.conformance.fit import MOST_SAMPLES, Fit, fit
from lippmann.display.description import Display
from lippmann.errors import InputError, input_error
from lippmann.layers.layer_choice import BLOCK_RAMS, MULTIPLIERS, SLOTS, TOLERANCE_DB, LayerChoice, choose_layers
from lippmann.optics.display_properties import display_properties
from lippmann.optics.model_choice import TOLERANCE
from lippmann.rendering.options import Settings
from lippmann.rendering.plan import open_scene, place_scene
from lippmann.scenes.scene import check_scene_file


@make_command("fit")
def command(
    display: Display = argument("DISPLAY.toml"),
    tolerance: float = option("Largest error, in pixels of the reconstructed view; greater than 0.", TOLERANCE),
    depths: tuple[float, float] | None = option(
        "The scene's range of z, mm.  [default: the display's own depth range]", None, vector("FAR,NEAR")
    ),
    scene: Path | None = option("Scene (.xml): also choose the layers of it that a board draws.", None),
    tolerance_db: float = option("Least PSNR of the layers' view at any place of a moving eye, dB.", TOLERANCE_DB),
    slot: tuple[tuple[int, int], ...] = option(
        f"Texels of a slot that is tried; may be repeated.  [default: {', '.join(f'{w}x{h}' for w, h in SLOTS)}]",
        SLOTS,
        TEXELS,
        multiple=True,
    ),
    block_rams: int = option("Most block RAMs of the drawing.", BLOCK_RAMS, click.IntRange(1)),
    multipliers: int = option("Most multipliers of the drawing.", MULTIPLIERS, click.IntRange(1)),
    moved: Moved = MOVED,
    seed: int = SEED,
    device: str = DEVICE,
) -> None:
    """Choose the cheapest lens model, samples and RTL build; of a scene also the layers and the build that draws them.

    Their errors stay within --tolerance for the display's chief rays. The reasons are printed.

    Example: lippmann fit scenes/displays/paper-square.toml --tolerance 0.25 --depths -40,30
    """
    if scene is None and moved.given:
        raise InputError(f"{flag_of(next(iter(moved.given)))} places a scene; give --scene too")
    far, near = depths or display_properties(display).depth_range_mm
    if not far <= near:
        raise input_error("--depths", f"{far:g} is nearer to the viewer than {near:g}", "give FAR,NEAR")
    display_fit = fit(display, (far, near), tolerance)
    build = None if display_fit.build is None else display_fit.build.as_dict()
    result = {
        "tolerance": tolerance,
        "depths_mm": [far, near],
        "model": display_fit.choice.model,
        "model_errors": display_fit.choice.error_px,
        "samples": display_fit.samples,
        "sample_error": display_fit.sample_error_px,
        "build": build,
        "build_error": display_fit.build_error_px,
    }
    lines = [str(display_fit.choice), _samples(display_fit, tolerance), _build(display_fit, tolerance)]
    if scene is not None:
        settings, checked = Settings(samples=16, seed=seed), check_scene_file(scene)
        placement, arrange = moved.placement(checked), moved.arrange(checked)
        with progress_bar("fit") as progress, open_scene(checked, placement, device) as loaded:
            placed = place_scene(loaded, display, arrange)
            choice = choose_layers(placed, display, tolerance_db, slot, block_rams, multipliers, settings, progress)
        result |= {
            "tolerance_db": tolerance_db, "layers": choice.chosen, "best": choice.best, "limit": choice.limit,
            "render_db": choice.render_db, "tried": choice.tried,
        }  # fmt: skip
        lines += _layers(choice, tolerance_db)
    head = f"{display.name}, z = {far:.4g} to {near:.4g} mm; errors in pixels of the reconstructed view"
    emit(result, (head, *lines), display)


def _samples(display_fit: Fit, tolerance: float) -> str:
    if display_fit.samples is None:
        enough = Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(display_fit.sample_error_px)
        return (
            f"samples: {MOST_SAMPLES} a pixel, the most, are not enough for {tolerance:g} at these depths; "
            f"they are enough for --tolerance {enough:g}"
        )
    return (
        f"samples {display_fit.samples} per pixel: its light is at most {display_fit.sample_error_px:.2g} from a ray "
        f"(tolerance {tolerance:g})"
    )


def _build(display_fit: Fit, tolerance: float) -> str:
    build, error = display_fit.build, display_fit.build_error_px
    if build is None and math.isinf(error):
        return "RTL: no build can hold this display or give its rays"
    if build is None:
        return f"RTL: no build is within {tolerance:g} (smallest error {error:.2g})"
    kind = f"{build.model}, {build.grid}" + ", near eye" * build.converge
    return (
        f"RTL {kind}, F {build.fraction_bits}: the cheapest hardware and the shortest words within {tolerance:g} "
        f"(error {error:.2g})"
    )


def _layers(choice: LayerChoice, tolerance_db: float) -> Iterator[str]:
    cheapest = choice.chosen
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
    for row in choice.tried:
        mark = "chosen" if row is cheapest else "best" if cheapest is None and row is choice.best else ""
        spent = f"{row['block_rams']:>3} block RAMs, {row['load_bytes']:>7} bytes, {row['multipliers']:>3} multipliers"
        size, quality = "{}x{}".format(*row["slot"]), f"{_cut(row['worst_db'])} dB (mean {_cut(row['view_db'])})"
        yield f"  {row['layers']} {row['filter']:<8} {size:<8} {spent}: {quality} {mark}".rstrip()


def _cut(decibels: float) -> str:
    """Return decibels rounded down, so that what misses a tolerance shows less than it."""
    return f"{math.floor(100.0 * decibels) / 100.0:.2f}"
