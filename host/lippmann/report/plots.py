"""How the report's plots look: colours and marks that differ without colour vision, PNG in memory."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

#: Colours of Okabe and Ito, which all kinds of colour vision tell apart.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
MARKS = ("o", "s", "^", "x", "D", "v", "+")
DPI = 100


def drawn(down: int, across: int, size: tuple[float, float] = (5.2, 3.8)) -> tuple[Any, Any]:
    """Return a picture and its axes, in rows of `across`, each of a size in inches."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    return plt.subplots(down, across, figsize=(size[0] * across, size[1] * down), squeeze=False, layout="constrained")


def finish(picture: Any) -> bytes:
    """Return the PNG of a picture, and forget it."""
    from matplotlib import pyplot as plt

    for axis in picture.axes:
        axis.grid(alpha=0.3)
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=DPI)
    plt.close(picture)
    return buffer.getvalue()


def legend(axis: Any, marks: Mapping[str, str], colours: Mapping[str, str]) -> None:
    """Tell what marks and colours stand for."""
    for name, mark in marks.items():
        axis.plot([], [], mark, color="grey", label=name)
    for name, colour in colours.items():
        axis.plot([], [], "-", color=colour, label=name)
    axis.legend(fontsize=7, ncols=2)
