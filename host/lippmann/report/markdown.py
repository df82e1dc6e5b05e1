"""The report as a page of the documentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lippmann.report.page import said
from lippmann.report.section import Section
from lippmann.report.tables import table


def page_text(title: str, origin: Mapping[str, str], sections: Sequence[Section]) -> str:
    """Return the page, its pictures beside it, as `lippmann.report.tables.write_report` takes it."""
    small = f"<sub>{said(origin)}</sub>"
    parts = [f"# {title}"]
    for section in sections:
        parts.append(f"## {section.title}")
        parts += section.text
        parts += [f"![{plot.alt}]({plot.name}.png)\n\n{plot.caption} {small}" for plot in section.plots]
        parts += [f"{shown.caption}. {small}\n\n{table(shown.columns)}" for shown in section.tables]
        if section.data:
            files = ", ".join(f"[{data.name}.csv]({data.name}.csv)" for data in section.data)
            parts.append(f"Figures and their spreads: {files}.")
    return "\n\n".join(part.strip() for part in parts)
