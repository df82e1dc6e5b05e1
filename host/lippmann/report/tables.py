"""Reports that are kept: a Markdown page and a CSV of one name, which say where their figures come from."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lippmann.images import replacing


def figure(value: Any) -> str:
    """Return a number as a table shows it: three digits and more, counts whole, nothing as a dash."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "**no**"
    if isinstance(value, float):
        if math.isinf(value):
            return "further"
        return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
    return str(value)


def table(columns: Mapping[str, Sequence[Any]]) -> str:
    """Return a Markdown table; columns of equal length under their headings."""
    rows = [list(columns), ["---"] * len(columns)]
    rows += [[figure(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def write_report(
    folder: Path,
    name: str,
    origin: Mapping[str, str],
    text: str,
    figures: Mapping[str, Sequence[Mapping[str, Any]]],
) -> None:
    """Write `name`.md, which begins with its heading and where it comes from, and a CSV for each set of figures.

    Parameters
    ----------
    folder
        Where to; made when missing.
    name
        The page's name.
    origin
        What `lippmann.provenance.provenance` says.
    text
        The page, its heading first.
    figures
        Rows under the name of their CSV file; each row has the same keys.
    """
    folder.mkdir(parents=True, exist_ok=True)
    heading, _, body = text.partition("\n")
    said = "\n".join(f"- {key}: {value}" for key, value in origin.items())
    with replacing(folder / f"{name}.md") as partial:
        partial.write_text(f"{heading}\n\n{said}\n\n{body.strip()}\n")
    for stem, rows in figures.items():
        with replacing(folder / f"{stem}.csv") as partial, partial.open("w", newline="") as stream:
            stream.writelines(f"# {key}: {value}\n" for key, value in origin.items())
            writer = csv.DictWriter(stream, list(rows[0]) if rows else [], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
