"""`lippmann regress`: judges the rays of another tracer."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from lippmann.cli.frame import make_command, option
from lippmann.cli.options.common import DISPLAY, LENS_MODEL, Finite, word_length
from lippmann.cli.output import emit
from lippmann.display import load_display
from lippmann.errors import input_error
from lippmann.optics.rays import Model

#: Exit code when rays were judged and found wrong. It differs from the codes of failures: the command worked.
FOUND_WRONG = 4


@make_command("regress")
def command(
    display_path: str = DISPLAY,
    rays_path: str = option("Rays to judge: .npz, .csv or .mem.", flag="--rays", metavar="FILE"),
    inputs_path: str | None = option(
        "Inputs of a .mem; by default inputs.mem beside it.", None, flag="--inputs", metavar="FILE"
    ),
    model: Model = LENS_MODEL,
    fraction_bits: int = word_length("a .csv or .mem"),
    tolerance_urad: float = option(
        "Tolerance of directions in an .npz, beside the effect of rounding the inputs to float32.", 2.0, Finite()
    ),
    tolerance_nm: float = option("Tolerance of points in an .npz, beside the effect of that rounding.", 50.0, Finite()),
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
    emit({**dataclasses.asdict(verdict), **shown}, lines)
    return 0 if verdict.right else FOUND_WRONG
