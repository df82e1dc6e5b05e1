"""The report's pages need nothing else, tell where each figure comes from, and can be read without seeing."""

import re

import jinja2
import pytest
from html_page import HtmlPage
from lippmann.conformance.figures import Figures, Measured
from lippmann.conformance.pages import Page
from lippmann.conformance.plots import Plot, finish_picture, make_axes
from PIL import Image

ORIGIN = {
    "machine": "AMD <EPYC> & co, 2 cores",
    "date": "2026-01-02 03:04 UTC",
    "command": "lippmann report --seed 5",
    "versions": "lippmann 9.9.9",
    "seed": "5",
}
TEMPLATE = """{% from macros import plot, table, file, link, origins with context %}
# Speed & error

{{ plot("report-made", "What `a` does", 'A line that falls, "so".') }}

{{ origins() }}

## First & best

Text with `code` < 3, {{ link("more", "../more.md") }}. All of it: {{ file("report-made.csv") }}.

{{ table("Rates <of> engines", rows | columns({"engine": "engine", "rate": "rate"})) }}

## Second
"""


@pytest.fixture
def page(tmp_path):
    (tmp_path / "made.md").write_text(TEMPLATE)
    picture, axes = make_axes(1, 1)
    axes[0][0].plot([0, 1], [1, 0])
    rows = [{"engine": "fast", "rate": Measured(1234567.0, 0.5)}, {"engine": "a<b", "rate": None}]
    data = Figures("report-made", ("engine",), rows)
    context = {"rows": rows, "repeat_origin": True}
    return Page(
        "made", ORIGIN, [Plot("report-made", finish_picture(picture))], {"report-made": data.flat()}, context, tmp_path
    )


def check_page(text, origin, images, tables):
    """Assert what holds for every page: self-contained, told where from, read without seeing."""
    page = HtmlPage(text)
    assert page.well_formed
    assert len(page.named("img")) >= images
    assert len(page.named("table")) >= tables
    # Nothing is fetched from anywhere.
    assert {name for name, _ in page.elements} & {"script", "link", "iframe", "object", "base"} == set()
    assert all(value.startswith(("data:image/png;base64,", "#")) for value in page.values("src", "href", "srcset"))
    assert not re.search(r"url\(|@import|https?:", text)
    assert any("default-src 'none'" in a.get("content", "") for a in page.named("meta"))
    # Each figure and table says where it comes from.
    assert len(page.captions["figcaption"]) == len(page.named("img"))
    assert len(page.captions["caption"]) == len(page.named("table"))
    for said in page.captions["figcaption"] + page.captions["caption"]:
        assert [
            key for key in ("machine", "date", "versions", "command", "seed") if f"{key}: {origin[key]}" not in said
        ] == []
    # Links lead somewhere, pictures are told in words, tables that scroll can be reached by the keys.
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    assert {a["href"][1:] for a in page.named("a")} <= set(ids)
    assert all(len(a["alt"]) > 10 for a in page.named("img"))
    assert page.named("html")[0]["lang"] == "en"
    assert len(page.named("h1")) == len(page.named("main")) == 1
    assert all({"aria-label", "tabindex"} <= set(a) for a in page.named("div"))
    assert all(a.get("scope") in ("row", "col") for a in page.named("th"))


def test_page_and_markdown_are_self_contained_and_say_where_their_figures_come_from(page):
    text = page.html()
    check_page(text, ORIGIN, images=1, tables=1)
    assert "<code>code</code> &lt; 3" in text
    assert "a&lt;b" in text
    assert "<td>1234567</td>" in text
    assert "<td>-</td>" in text
    assert '<li><a href="#section-1">First &amp; best</a></li>' in text
    text = page.text()
    assert text.startswith("# Speed & error\n")
    assert '![A line that falls, "so".](report-made.png)' in text
    assert "[report-made.csv](report-made.csv)" in text
    assert "[more](../more.md)" in text
    assert text.count(f"command: {ORIGIN['command']}") == 3
    assert "| fast | 1234567 |" in text


def test_a_template_that_names_what_is_not_there_fails(page, tmp_path):
    (tmp_path / "made.md").write_text("{{ nothing }}")
    with pytest.raises(jinja2.UndefinedError, match="nothing"):
        page.text()


def test_written_files_are_those_that_are_told(page, tmp_path):
    files = page.write(tmp_path / "new", as_html=True)
    assert {path.name for path in files} == {"made.md", "made.html", "report-made.csv", "report-made.png"}
    assert set(files) == set((tmp_path / "new").iterdir())
    with Image.open(tmp_path / "new/report-made.png") as picture:
        assert {key: picture.text[f"lippmann:{key}"] for key in ORIGIN} == ORIGIN
