"""The documentation's site builds without a warning, holds together, and a broken link stops it."""

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

from html_page import HtmlPage

TOP = Path(__file__).parents[2]
#: As `make site` has it, which is asked.
OPTIONS = ("--quiet", "--fail-on-warning", "--keep-going", "-b", "html", "-c")


def build(source, out, work):
    # Without the objects of the API in the pages' menus, which take a third of the time.
    less = ("-D", "toc_object_entries=0")
    folders = (str(TOP / "docs/site"), "-d", str(work), str(source), str(out))
    command = [sys.executable, "-m", "sphinx", *OPTIONS, *folders, *less]
    return subprocess.run(command, check=False, cwd=TOP, capture_output=True, text=True)


def test_the_makefile_builds_it_the_same_way():
    done = subprocess.run(["make", "-n", "site"], check=True, cwd=TOP, capture_output=True, text=True)
    assert f"sphinx-build {' '.join(OPTIONS)} docs/site " in done.stdout


def test_it_builds_and_every_link_within_it_leads_somewhere(tmp_path):
    done = build(TOP, tmp_path / "site", tmp_path / "work")
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    pages = {path: HtmlPage(path.read_text()) for path in (tmp_path / "site").rglob("*.html")}
    wanted = {
        *("README", "CONTRIBUTING", "CHANGELOG", "docs/models", "docs/site/api", "scenes/README"),
        *(str(path.relative_to(TOP).with_suffix("")) for path in TOP.glob("docs/*/*.md")),
    }
    names = {str(path.relative_to(tmp_path / "site").with_suffix("")) for path in pages}
    assert wanted <= names
    anchors = {path: set(page.values("id", "name")) for path, page in pages.items()}
    links = 0
    for path, page in pages.items():
        for link in page.values("href", "src"):
            target, _, anchor = unquote(link).partition("#")
            if "://" in target or target.startswith(("data:", "mailto:")):
                assert not target.endswith((".js", ".css")), f"{path.name} needs a network: {target}"
                continue
            links += 1
            there = (path.parent / target.split("?")[0]).resolve() if target else path
            assert there.exists(), f"{path.name}: {link}"
            if anchor and there in pages:
                assert anchor in anchors[there], f"{path.name}: {link}: no such anchor"
    assert links > 1000
    # From the first page every page can be reached.
    first_links = pages[tmp_path / "site/README.html"].values("href", "src")
    first = {(tmp_path / "site" / link.partition("#")[0]).resolve() for link in first_links}
    assert {tmp_path / f"site/{name}.html" for name in wanted - {"README"}} <= first
    # Options stay what can be copied; there are no dashes of typography in the pages.
    assert not [path.name for path in pages if "\N{EN DASH}" in path.read_text()]
    # In the order of the first page's table, which begins where a reader does.
    text = "\n".join(first_links)
    order = list(dict.fromkeys(re.findall(r"^docs/how-to/([\w-]+)\.html$", text, re.M)))
    table = (TOP / "README.md").read_text().partition("## Documentation")[2]
    assert order == re.findall(r"\(docs/how-to/([\w-]+)\.md\)", table)
    api = (tmp_path / "site/docs/site/api.html").read_text()
    for name in (
        "lippmann.display.description.load_display",
        "lippmann.eye.observer.observe",
        "lippmann.motion.film.Film.placement",
    ):
        assert f'id="{name}"' in api


def test_a_broken_link_stops_it(tmp_path):
    """Each has its warning, and nothing else has one."""
    wrong = {
        "[file](CHANGES.md)": "CHANGES.md", "[anchor](CHANGELOG.md#released)": "released",
        "[here](#nowhere)": "nowhere", "![picture](none.png)": "none.png",
    }  # fmt: skip
    links = "\n\n".join(["[good](CHANGELOG.md#unreleased)", *wrong])
    (tmp_path / "README.md").write_text(f"# Title\n\n{links}\n")
    (tmp_path / "CHANGELOG.md").write_text("# Changes\n\n## Unreleased\n\nNothing.\n")
    done = build(tmp_path, tmp_path / "site", tmp_path / "work")
    assert done.returncode != 0
    warnings = [line for line in done.stderr.splitlines() if "WARNING" in line]
    for said in wrong.values():
        assert sum(said in line for line in warnings) == 1, done.stderr
    assert len(warnings) == len(wrong), done.stderr
