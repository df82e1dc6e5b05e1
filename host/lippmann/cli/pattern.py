"""Command `lippmann pattern`."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

from lippmann.base.images import check_output
from lippmann.base.variant import own_variant
from lippmann.cli.frame import argument, make_command, option
from lippmann.cli.options import DEVICE, DISPLAY, FRACTION_BITS, PICTURE, Point, vector
from lippmann.cli.output import emit, log
from lippmann.display.description import Display
from lippmann.eye.observer import Eye
from lippmann.eye.test_patterns import Kind, draw
from lippmann.rendering.memory_estimate import check_memory
from lippmann.rendering.options import Settings


@make_command("pattern")
def command(
    kind: Kind = argument("KIND"),
    display: Display = DISPLAY,
    output: Path = PICTURE,
    eye: Point | None = option("Position of the eye for KIND white-for-eye, mm."),
    lens: tuple[int, int] | None = option(
        "Indices of the lenslet for KIND single-lens.  [default: 0,0]", kind=vector("I,J", int)
    ),
    fraction_bits: int | None = option(
        "Fraction bits of a board that draws the pattern.  [default: exact]", kind=FRACTION_BITS
    ),
    device: str = DEVICE,
) -> None:
    """Draw a test pattern for a display's panel.

    Example: lippmann pattern view-numbers --display scenes/displays/vga-square.toml -o
    views.png
    """
    path = check_output(output)
    panel = display.panel
    check_memory(*panel.size_px, Settings(), colours=1)
    with nullcontext() if eye is None else own_variant(device):
        image = draw(display, kind, None if eye is None else Eye(eye), lens, fraction_bits)
    image.save(path)
    lit = float(image.radiance.any(axis=2).mean())
    if eye is not None and not lit:
        log("note: the panel is black: the eye sees no pixel without crosstalk; see lippmann inspect --eye")
    size = {"width_px": panel.width_px, "height_px": panel.height_px}
    result = {"output": path, "kind": kind, **size, "lit_share": lit}
    emit(result, f"{path}: {kind}, {panel.width_px} x {panel.height_px}, {100 * lit:.2f} % of the pixels lit", display)
