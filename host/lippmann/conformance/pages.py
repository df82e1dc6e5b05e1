"""Create pages in Markdown and self-contained HTML from Jinja2 templates."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import jinja2
from markdown_it import MarkdownIt
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from lippmann.base.files import make_folder, write_file
from lippmann.conformance.figures import Row, Rows, columns, figure, spanned, table, values, where, write_csv
from lippmann.conformance.plots import Plot

TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True)
class Page:
    """A report page; its template and output files are named `name` plus extension."""

    name: str
    #: Machine, date, command and software versions of the measurement.
    origin: Mapping[str, str]
    plots: Sequence[Plot] = ()
    #: Rows of the CSV files, keyed by file name without extension.
    tables: Mapping[str, Rows] = field(default_factory=dict)
    #: Variables for the page's template.
    context: Row = field(default_factory=dict)
    templates: Path = TEMPLATES

    @cached_property
    def _environment(self) -> jinja2.Environment:
        environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader([self.templates, TEMPLATES]),
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        for function in (figure, where, values, columns, spanned):
            environment.filters[function.__name__] = function
        environment.filters["escaped"] = lambda words: html.escape(str(words), quote=False)
        environment.filters |= {"markdown_table": table, "base64": lambda data: base64.b64encode(data).decode()}
        environment.globals |= {"zip": zip}
        return environment

    def text(self, form: Literal["markdown", "html"] = "markdown") -> str:
        """Return the page as Markdown; `form` selects Markdown or HTML for plots and tables."""
        origin = {key: html.escape(str(value), quote=False) for key, value in self.origin.items()}
        names = {
            "repeat_origin": False,  # True: each plot and table repeats the origin
            **self.context,
            "macros": f"{form}.jinja",
            "plots": {plot.name: plot.png for plot in self.plots},
            "origin": origin,
            "said": "; ".join(f"{key}: {value}" for key, value in origin.items()),
        }
        text = self._environment.get_template(f"{self.name}.md").render(names)
        return re.sub(r"\n{3,}", "\n\n", text).strip()

    def html(self) -> str:
        """Return the page as self-contained HTML without scripts."""
        reader = MarkdownIt("commonmark", {"html": True})
        tokens = reader.parse(self.text("html"))
        headings = [(token, tokens[k + 1].content) for k, token in enumerate(tokens) if token.type == "heading_open"]
        sections = [(token, title) for token, title in headings if token.tag == "h2"]
        for number, (token, _) in enumerate(sections, 1):
            token.attrSet("id", f"section-{number}")
        return self._environment.get_template("page.html").render(
            title=headings[0][1],
            style=(TEMPLATES / "page.css").read_text(),
            sections=[(token.attrs["id"], reader.renderInline(title)) for token, title in sections],
            body=reader.renderer.render(tokens, reader.options, {}),
        )

    def write(self, folder: Path, as_html: bool = False) -> list[Path]:
        """Write page, plots and CSV files to a folder; return the paths, or raise InputError."""
        make_folder(folder)
        pages = {folder / f"{self.name}.md": f"{self.text()}\n"}
        if as_html:
            pages[folder / f"{self.name}.html"] = self.html()
        for path, text in pages.items():
            write_file(path, text)
        for name, rows in self.tables.items():
            write_csv(folder / f"{name}.csv", self.origin, rows)
        for plot in self.plots:
            write_file(folder / f"{plot.name}.png", stamped(plot.png, self.origin))
        return [*pages, *(folder / f"{n}.csv" for n in self.tables), *(folder / f"{p.name}.png" for p in self.plots)]


def stamped(png: bytes, origin: Mapping[str, str]) -> bytes:
    """Return a PNG image with the origin of its values in text chunks."""
    texts, out = PngInfo(), io.BytesIO()
    for key, value in origin.items():
        texts.add_text(f"lippmann:{key}", value)
    with Image.open(io.BytesIO(png)) as picture:
        picture.save(out, "png", pnginfo=texts, optimize=True)
    return out.getvalue()
