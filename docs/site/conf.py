"""The documentation as a site: `make site`. The pages are the repository's own, where they lie."""

from __future__ import annotations

from pathlib import Path

import lippmann

project = "Lippmann"
author = "The Lippmann authors"
copyright = "The Lippmann authors, Apache-2.0"
version = release = lippmann.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
source_suffix = {".md": "markdown"}
root_doc = "README"
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/**.md", "scenes/README.md"]
# Sphinx walks through all that is not excluded.
exclude_patterns = [".*", "build", "out", "host", "rtl", "sim", "tests"]

# Anchors are made as forges make them, so that a link leads to the same place here and there.
myst_heading_anchors = 4

smartquotes_action = "qe"  # quotes and ellipses; a dash made of -- would break options

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autosummary_generate = False  # numpydoc would have it make pages
numpydoc_show_class_members = False  # autodoc lists them

html_theme = "furo"
html_title = f"Lippmann {release}"
html_copy_source = False
html_show_sphinx = False
# Everything lies in the folder: the site is read without a network.
html_theme_options = {"sidebar_hide_name": False}

#: Parts of the table of contents, and the folder or the page that holds each.
PARTS = {
    "How to": "docs/how-to/",
    "Reference": "docs/reference/",
    "Python API": "docs/site/api",
    "Background": ("docs/models", "docs/measured"),
    "Reports": "docs/reports/",
    "The project": ("scenes/README", "CONTRIBUTING", "CHANGELOG"),
}


def add_contents(app, docname, source):
    """Give the first page, which forges show too, the table of contents that only the site needs.

    Pages stand in the order of the first page's own table; those that it does not name, last.
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
    """Lead from index.html to the first page."""
    if error is None and app.builder.format == "html":
        refresh = f'<!doctype html><meta http-equiv="refresh" content="0; url={root_doc}.html"><title>Lippmann</title>'
        (Path(app.outdir) / "index.html").write_text(f'{refresh}<a href="{root_doc}.html">Lippmann</a>\n')


def skip_constants(app, what, name, thing, skip, options):
    """Leave out a module's constants: their comments are for who reads the source."""
    return skip or (what == "module" and not callable(thing))


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-skip-member", skip_constants)
    app.connect("source-read", add_contents)
    app.connect("build-finished", add_index)
