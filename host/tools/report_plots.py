"""Makes the pages and plots of the tools' reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from lippmann.base.animation import write_contact_sheet
from lippmann.base.images import Radiance
from lippmann.conformance.figures import Row, Rows, groups, values
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import COLOURS, MARKS, Plot, finish_picture, make_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TEMPLATES = Path(__file__).with_name("templates")


def make_page(
    name: str,
    origin: Mapping[str, str],
    plots: Sequence[Plot] = (),
    tables: Mapping[str, Rows] | None = None,
    context: Row | None = None,
) -> Page:
    """Return a page that is rendered from the tools' template `name`."""
    return Page(name, origin, plots, tables or {}, context or {}, TEMPLATES)


def draw_bars(axis: Axes, labels: Sequence[str], lengths: Sequence[float], **options: Any) -> None:
    """Draw a horizontal bar for each label, with the first label on top."""
    place = np.arange(len(labels))
    axis.barh(place, lengths, **options)
    axis.set_yticks(place, labels, fontsize=8)
    axis.invert_yaxis()


def draw_lines(axis: Axes, rows: Rows, by: str, x: str, y: str) -> None:
    """Draw column y against column x for rows that have a y, with a line for each value of column `by`."""
    for mark, colour, group in zip(MARKS, COLOURS, groups(rows, by), strict=False):
        points = [row for row in group if row[y] is not None]
        if points:
            axis.plot(values(points, x), values(points, y), f"{mark}-", color=colour, label=group[0][by])
    axis.legend()


def draw_bar_charts(name: str, labels: Sequence[str], charts: Mapping[str, Sequence[float]], **options: Any) -> Plot:
    """Draw charts, keyed by heading, side by side with common labels; `options` are axes properties."""
    picture, axes = make_axes(1, len(charts), (5.2, 0.9 + 0.22 * len(labels)))
    for across, (heading, lengths) in enumerate(charts.items()):
        draw_bars(axes[0][across], labels if across == 0 else [""] * len(labels), lengths, color=COLOURS[0])
        axes[0][across].set(xlabel=heading, **options)
    return Plot(name, finish_picture(picture))


def contact_sheet(name: str, views: tuple[list[Radiance], list[str]] | None, across: int, times: int = 3) -> list[Plot]:
    """Return a contact sheet of magnified views with captions, or [] if `views` is None."""
    if views is None:
        return []
    large = [np.kron(view, np.ones((times, times, 1), np.float32)) for view in views[0]]
    with TemporaryDirectory() as folder:
        write_contact_sheet(Path(folder) / "sheet.png", large, views[1], columns=across)
        return [Plot(name, (Path(folder) / "sheet.png").read_bytes())]
