"""The report as one HTML page that needs nothing else: no script, no network, pictures within."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping, Sequence

from lippmann.report.section import Plot, Section, Shown
from lippmann.report.tables import figure
from lippmann.viewer.template import filled, read

PACKAGE = "lippmann.report"
CODE = re.compile(r"`([^`]+)`")


def page_html(title: str, origin: Mapping[str, str], sections: Sequence[Section]) -> str:
    """Return the page.

    Parameters
    ----------
    title
        Its heading.
    origin
        Where its figures come from; said at the top, and by every table and plot.
    sections
        What it shows.
    """
    names = [f"section-{number}" for number, _ in enumerate(sections, 1)]
    return filled(
        "report.html",
        PACKAGE,
        title=_text(title),
        style=read("report.css", PACKAGE),
        origin="\n".join(f"<dt>{_text(key)}</dt><dd>{_text(value)}</dd>" for key, value in origin.items()),
        contents="\n".join(
            f'<li><a href="#{name}">{_text(section.title)}</a></li>'
            for name, section in zip(names, sections, strict=True)
        ),
        sections="\n".join(
            _section(name, section, said(origin)) for name, section in zip(names, sections, strict=True)
        ),
    )


def said(origin: Mapping[str, str]) -> str:
    """Return where figures come from, in one line."""
    return "; ".join(f"{key}: {value}" for key, value in origin.items())


def _text(words: str) -> str:
    """Return text as HTML, what stands between backticks as code."""
    return CODE.sub(r"<code>\1</code>", html.escape(words))


def _section(name: str, section: Section, origin: str) -> str:
    parts = [f'<section aria-labelledby="{name}">', f'<h2 id="{name}">{_text(section.title)}</h2>']
    parts += [f"<p>{_text(paragraph)}</p>" for paragraph in section.text]
    parts += [_plot(plot, origin) for plot in section.plots]
    parts += [_table(table, origin) for table in section.tables]
    return "\n".join([*parts, "</section>"])


def _plot(plot: Plot, origin: str) -> str:
    data = base64.b64encode(plot.png).decode()
    return (
        f'<figure>\n<img src="data:image/png;base64,{data}" alt="{html.escape(plot.alt)}">\n'
        f'<figcaption>{_text(plot.caption)} <span class="origin">{_text(origin)}</span></figcaption>\n</figure>'
    )


def _table(table: Shown, origin: str) -> str:
    """Return a table; it scrolls by itself where it is wider than the page, by the keys too."""
    heads = "".join(f'<th scope="col">{_text(heading)}</th>' for heading in table.columns)
    rows = []
    for first, *others in zip(*table.columns.values(), strict=True):
        cells = "".join(f"<td>{_text(figure(value).replace('**', ''))}</td>" for value in others)
        rows.append(f'<tr><th scope="row">{_text(figure(first))}</th>{cells}</tr>')
    body = "\n".join(rows)
    return (
        f'<div class="table" role="region" aria-label="{html.escape(table.caption)}" tabindex="0">\n<table>\n'
        f'<caption>{_text(table.caption)} <span class="origin">{_text(origin)}</span></caption>\n'
        f"<thead><tr>{heads}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</div>"
    )
