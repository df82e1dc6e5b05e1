"""Sphinx configuration for `make site`, which builds the site from the pages in docs/."""

from __future__ import annotations

import dataclasses
import inspect
import types
from pathlib import Path
from typing import Annotated, get_origin, get_type_hints

import lippmann
from jinja2.sandbox import SandboxedEnvironment
from lippmann.base.variant import mitsuba, start_mitsuba
from numpydoc import docscrape_sphinx
from sphinx.util.inspect import stringify_signature

project = "Lippmann"
author = "The Lippmann authors"
copyright = "The Lippmann authors, Apache-2.0"
version = release = lippmann.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
source_suffix = {".md": "markdown"}
root_doc = "README"
include_patterns = ["README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md", "docs/**.md", "scenes/README.md"]
# Exclude folders without pages, because Sphinx searches all other folders.
exclude_patterns = [".*", "build", "out", "host", "rtl", "sim", "tests"]

# Make heading anchors as code forges make them, so that links work on the site and on the forge.
myst_heading_anchors = 4

smartquotes_action = "qe"  # convert quotes and ellipses, but keep -- of options

numpydoc_show_class_members = False  # autodoc lists the class members
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autosummary_generate = False  # do not generate numpydoc's pages of members

html_theme = "furo"
html_title = f"Lippmann {release}"
html_copy_source = False
html_show_sphinx = False
# The site works without a network.
html_theme_options = {"sidebar_hide_name": False}

#: Headings of the table of contents, with the folders or pages under each heading.
PARTS = {
    "Overview": "docs/how-it-works",
    "How to": "docs/how-to/",
    "Reference": "docs/reference/",
    "Python API": "docs/site/api",
    "Commands": "docs/generated/commands/",
    "Registers": tuple(f"docs/generated/{name}" for name in ("registers", "board-registers", "scene-registers")),
    "Background": ("docs/models", "docs/generated/measured"),
    "Reports": "docs/generated/reports/",
    "For developers": ("docs/developers/", "docs/generated/promises"),
    "The project": ("scenes/README", "CONTRIBUTING", "SECURITY", "CHANGELOG"),
}


class Environment(SandboxedEnvironment):
    """Caches compiled templates, because numpydoc makes an environment for each docstring."""

    compiled = {}  # noqa: RUF012

    def get_template(self, name):
        if name not in self.compiled:
            self.compiled[name] = super().get_template(name)
        return self.compiled[name]


docscrape_sphinx.SandboxedEnvironment = Environment


def add_contents(app, docname, source):
    """Add the table of contents to the site's first page, the README.

    The pages have the order of the README's table; pages that the README does not name come last.
    """
    if docname != root_doc:
        return
    table = source[0].partition("## Documentation")[2]

    def place(page):
        return table.find(f"({page}.md") % (len(table) + 1), page

    for title, where in PARTS.items():
        pages = sorted((page for page in app.env.found_docs if page.startswith(where)), key=place)
        if pages:
            listed = "\n".join(f"/{page}" for page in pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{listed}\n```\n"


def add_index(app, error):
    """Write an index.html that redirects to the site's first page."""
    if error is None and app.builder.format == "html":
        refresh = f'<!doctype html><meta http-equiv="refresh" content="0; url={root_doc}.html"><title>Lippmann</title>'
        (Path(app.outdir) / "index.html").write_text(f'{refresh}<a href="{root_doc}.html">Lippmann</a>\n')


def skip_constants(app, what, name, thing, skip, options):
    """Omit module constants and type aliases from the API pages: their comments are for readers of the source."""
    return skip or (
        what == "module"
        and (not callable(thing) or isinstance(thing, types.GenericAlias) or get_origin(thing) is Annotated)
    )


def plain_types(app, what, name, thing, options, signature, returned):
    """Remove the ranges of keys from the signature of a dataclass: the list of attributes shows the ranges."""
    if what == "class" and dataclasses.is_dataclass(thing):
        start_mitsuba("llvm")  # Mitsuba's types have names only after a variant is set
        hints = get_type_hints(thing, localns={"mi": mitsuba(), "mts": mitsuba()})
        given = inspect.signature(thing)
        typed = [one.replace(annotation=hints[one.name]) for one in given.parameters.values()]
        return stringify_signature(given.replace(parameters=typed, return_annotation=given.empty)), returned
    return None


def setup(app):
    """Register this file's functions with Sphinx, which calls `setup`."""
    app.connect("autodoc-skip-member", skip_constants)
    app.connect("autodoc-process-signature", plain_types)
    app.connect("source-read", add_contents)
    app.connect("build-finished", add_index)
