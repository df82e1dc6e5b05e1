"""`lippmann regress`: judges the rays of another tracer."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click

from lippmann.cli.options.common import Finite, display_option, fraction_bits_option, json_option, model_option
from lippmann.cli.output import emit
from lippmann.display import load_display
from lippmann.errors import input_error
from lippmann.optics.rays import Model

#: Exit code when rays were judged and found wrong. It differs from the codes of failures: the command worked.
FOUND_WRONG = 4


@click.command("regress")
@display_option
@click.option("--rays", "rays_path", required=True, metavar="FILE", help="Rays to judge: .npz, .csv or .mem.")
@click.option("--inputs", "inputs_path", metavar="FILE", help="Inputs of a .mem; by default inputs.mem beside it.")
@model_option
@fraction_bits_option("a .csv or .mem")
@click.option(
    "--tolerance-urad", type=Finite(), default=2.0, show_default=True,
    help="Tolerance of directions in an .npz, beside the effect of rounding the inputs to float32.",
)  # fmt: skip
@click.option(
    "--tolerance-nm", type=Finite(), default=50.0, show_default=True,
    help="Tolerance of points in an .npz, beside the effect of that rounding.",
)  # fmt: skip
@json_option
def command(
    display_path: str,
    rays_path: str,
    inputs_path: str | None,
    model: Model,
    fraction_bits: int,
    tolerance_urad: float,
    tolerance_nm: float,
    as_json: bool,
) -> int:
    """Check the rays of another ray tracer or RTL design.

    A .npz is compared with golden; a .csv or .mem with the RTL's twin, bit for bit. The first wrong step is named.

    Exit code 0: every ray is right; 4: some are wrong.

    Example: lippmann regress --display scenes/displays/paper-square.toml --rays rays.npz
    """
    from lippmann.diagnose.foreign import read_foreign
    from lippmann.diagnose.judge import judge

    for name, value in (("--tolerance-urad", tolerance_urad), ("--tolerance-nm", tolerance_nm)):
        if value <= 0.0:
            raise input_error(name, f"{value:g} is not positive", "give a positive number")
    display = load_display(display_path)
    inputs = None if inputs_path is None else Path(inputs_path)
    foreign = read_foreign(Path(rays_path), display, model, fraction_bits, inputs)
    verdict = judge(foreign, tolerance_urad, tolerance_nm)
    shown = {"right": verdict.right, "display": display.name, "identity": display.identity, "model": model}
    lines = []
    for entry in verdict.compared:
        least, most = entry.limits
        allowed = f" (allowed: {least:.3g} to {most:.3g})" if most else ""
        lines.append(
            f"{entry.stage:<11}{entry.field:<10} {entry.wrong} of {entry.compared} wrong, "
            f"largest difference {entry.worst:.3g} {entry.unit}{allowed}"
        )
    if verdict.right:
        lines.append(f"{verdict.rays} rays right ({verdict.on_edge} of them within a rounding of an edge)")
    else:
        lines.append(f"{verdict.wrong} of {verdict.rays} rays wrong, the first is {verdict.first_wrong}")
        lines.append(f"stage: {verdict.stage}; {verdict.fault or 'no single fault explains them'}")
    emit({**dataclasses.asdict(verdict), **shown}, as_json, lines)
    return 0 if verdict.right else FOUND_WRONG
