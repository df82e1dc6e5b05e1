"""Draw the plots of reports, for readers with any colour vision."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lippmann.conformance.figures import Figures, groups, where
from lippmann.optics.rays import ENGINES, MODELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colour palette of Okabe and Ito.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
MARKS = ("o", "s", "^", "x", "D", "v", "+")


@dataclass(frozen=True)
class Plot:
    """A plot: its PNG data, and its file name without extension."""

    name: str
    png: bytes


def make_axes(down: int, across: int, size: tuple[float, float] = (5.2, 3.8)) -> tuple[Figure, npt.NDArray[np.object_]]:
    """Return a figure and an array (down, across) of axes; `size` is the size of one axis, inches."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    return plt.subplots(down, across, figsize=(size[0] * across, size[1] * down), squeeze=False, layout="constrained")


def finish_picture(picture: Figure) -> bytes:
    """Return the PNG data of a figure, and close the figure."""
    from matplotlib import pyplot as plt

    for axis in picture.axes:
        axis.grid(alpha=0.3)
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=100)
    plt.close(picture)
    return buffer.getvalue()


def draw_engines(data: Figures) -> Plot:
    """Plot error against speed of all models and engines, for one display of each lattice type."""
    kinds = (
        ("chief", "max_mm", "chief rays: largest error in the scene, mm", "log"),
        ("full", "max_mm", "full aperture: largest error in the scene, mm", "log"),
        ("chief", "view_db", "the eye's view, dB", "linear"),
    )
    displays = [rows[0]["display"] for rows in groups(data.rows, "grid")]
    picture, axes = make_axes(len(kinds), len(displays))
    for across, display in enumerate(displays):
        for axis, (aperture, key, label, scale) in zip(axes[:, across], kinds, strict=True):
            for row in where(data.rows, display=display, rays=aperture):
                if row[key] is not None:
                    mark = MARKS[ENGINES.index(row["engine"])]
                    colour = COLOURS[MODELS.index(row["model"])]
                    axis.plot(row["rays_per_second"].median, row[key].median, mark, color=colour)
            axis.set(xscale="log", yscale=scale, xlabel="rays/s", ylabel=label, title=display)
    for engine, mark in zip(ENGINES, MARKS, strict=False):
        axes[0][0].plot([], [], mark, color="grey", label=engine)
    for model, colour in zip(MODELS, COLOURS, strict=False):
        axes[0][0].plot([], [], "-", color=colour, label=model)
    axes[0][0].legend(fontsize=7, ncols=2)
    return Plot("report-engines", finish_picture(picture))
