"""`make report` and `lippmann report` end to end, and what they refuse before any work is done."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from lippmann.cli import run
from lippmann.conformance.figures import compare, read_stored
from lippmann.simulation.toolchain import repository
from PIL import Image
from test_report_page import check_page
from tools import full_report
from tools.full_report import TABLES

SCENES = str(repository() / "scenes")
SHIPPED = f"{SCENES}/displays/vga-square.toml"
ORIGIN = ("machine", "date", "command", "versions", "seed", "load")


def report(folder, *options, display=None):
    words = ["--scenes", SCENES, "-o", str(folder), "--device", "llvm", *options]
    if display is None:
        return run(words, full_report.main)
    return run(["report", "--display", str(display), *words])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of a quick run that measures each figure twice at most, and what it said."""
    folder = tmp_path_factory.mktemp("report") / "new" / "folder"
    with pytest.MonkeyPatch.context() as patch:
        said = []
        patch.setattr("lippmann.cli.report.emit", lambda result, text: said.append(result))
        patch.setattr(full_report, "QUICK", replace(full_report.QUICK, rounds=2, memory_rounds=1))
        assert report(folder, "--quick", "--seed", "3") == 0
    return folder, json.loads(json.dumps(said[0]))


def test_a_quick_run_writes_pages_plots_and_tables(made):
    folder, result = made
    assert {Path(file).name for file in result["files"]} == {path.name for path in folder.iterdir()}
    assert {f"{name}.csv" for name in TABLES} | {"report.md", "report.html"} <= {p.name for p in folder.iterdir()}
    assert set(result) == {*ORIGIN, "folder", "files", "seconds", "tables", "comparison"}
    assert result["seed"] == "3"
    assert result["command"].endswith("--seed 3 --device llvm --quick")
    assert result["comparison"]["before"] == {}
    for picture in folder.glob("*.png"):
        assert picture.stat().st_size < 200_000
        with Image.open(picture) as image:
            assert image.text["lippmann:command"] == result["command"]


def test_its_pages_need_nothing_else(made):
    folder, result = made
    check_page((folder / "report.html").read_text(), result, images=6, tables=5)
    assert (folder / "report.html").stat().st_size < 2_000_000
    text = (folder / "report.md").read_text()
    assert all(f"]({path.name})" in text for path in folder.iterdir() if path.suffix in (".png", ".csv"))
    # At the top, by six plots and by five tables.
    assert text.count(f"command: {result['command']}") >= 12
    assert text.count("![") == 6


def test_its_tables_hold_what_was_asked_for(made):
    folder, _ = made

    def rows(name):
        with (folder / f"{name}.csv").open() as stream:
            lines = stream.readlines()
        assert [line.split(":")[0][2:] for line in lines if line[0] == "#"] == list(ORIGIN)
        return list(csv.DictReader(line for line in lines if line[0] != "#"))

    found = rows("report-engines")
    assert {(row["model"], row["engine"]) for row in found} == {
        (model, engine) for model in ("pinhole", "thin", "paraxial", "exact") for engine in ("golden", "fast", "twin")
    }
    exact = {row["engine"]: row for row in found if (row["model"], row["rays"]) == ("exact", "chief")}
    # The promises of each engine (docs/reference/optics.md, rtl.md), microradian and nm.
    assert 0.0 < float(exact["golden"]["own_max_urad"]) < 1e-6
    assert 0.0 < float(exact["fast"]["own_max_urad"]) < 2.0
    assert 0.0 < float(exact["twin"]["own_max_urad"]) < 1.0
    assert 0.0 < float(exact["twin"]["own_max_nm"]) < 2.0
    assert float(exact["twin"]["view_db"]) > 50.0
    assert exact["golden"]["view_db"] == ""
    assert float(exact["golden"]["relative"]) == 1.0
    assert all(float(row["rays_per_second"]) > 0 and float(row["rays_per_second_spread"]) >= 0 for row in found)

    rtl = {row["configuration"]: row for row in rows("report-rtl")}
    assert float(rtl["widest-square"]["max_urad"]) < 1.0 < float(rtl["compact-square"]["max_urad"]) < 60.0
    assert float(rtl["widest-square"]["lut"]) > float(rtl["compact-square"]["lut"])
    assert float(rtl["widest-square"]["image_db"]) > 50.0
    assert float(rtl["widest-square"]["image_db"]) > float(rtl["compact-square"]["image_db"])

    renderer = [row for row in rows("report-renderer") if row["integrator"] == "path"]
    noise = [float(row["noise"]) for row in renderer]
    assert noise == sorted(noise, reverse=True)
    # Four times the samples halve the noise.
    assert 1.5 < noise[0] / noise[1] < 2.5

    growth = rows("report-growth")
    assert {row["with"] for row in growth} == {"pixels", "lenslets", "triangles", "lights", "threads", "samples"}
    assert all(float(row["memory_mb"]) > 50 for row in growth if row["with"] == "pixels")

    steps = [row["step"] for row in rows("report-budget")]
    assert (steps[0], steps[-1]) == ("configuration", "all")


def test_a_run_that_was_kept_has_not_moved_against_itself(made):
    folder, result = made
    stored = read_stored(folder, TABLES)
    found = compare({key: result[key] for key in ORIGIN}, list(stored.tables.values()), stored)
    assert found.compared > 200
    assert (found.moved, found.new, found.gone, found.differs) == ((), 0, 0, ())


def test_the_report_of_a_users_display(tmp_path, capsys):
    """A display file that lies outside the project."""
    text = (Path(SCENES) / "displays/vga-square.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace("vga-square", "mine"))
    assert report(tmp_path / "new", "--quick", "--json", display=tmp_path / "mine.toml") == 0
    result = json.loads(capsys.readouterr().out)
    assert list(result["tables"]) == ["report-engines"]
    rows = result["tables"]["report-engines"]
    assert {row["display"] for row in rows} == {"mine"}
    assert {row["engine"] for row in rows} == {"golden", "fast", "twin"}
    check_page((tmp_path / "new/report.html").read_text(), result, images=1, tables=1)
    assert result["command"].startswith(f"lippmann report --display {tmp_path}/mine.toml --scenes ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("new", "--display", SHIPPED, "--display", SHIPPED),
            "two displays have the name .*; give each display its own name",
        ),
        (("file", "--display", SHIPPED), "file: cannot be made.*; choose another folder"),
        (("file/below", "--display", SHIPPED), "below: cannot be made"),
        (("taken", "--display", SHIPPED), r"report\.html: is a folder"),
        (("new", "--scenes", "taken"), "lacks the project's scenes; correct --scenes"),
    ],
)
def test_what_cannot_be_done_is_refused_before_any_work(tmp_path, monkeypatch, refusal_of, words, said):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    Path("taken/report.html").mkdir(parents=True)
    assert re.search(said, refusal_of("report", "--quick", "--scenes", SCENES, "-o", *words))
    assert not Path("new").exists()


def test_runs_that_cannot_be_compared_with_are_refused(tmp_path, capsys):
    def refused(folder, *options):
        assert report(tmp_path / folder, "--quick", *options) == 2
        (line,) = capsys.readouterr().err.splitlines()
        return line

    against = ("--against", str(tmp_path))
    said = refused("new", *against)
    assert "contains no earlier report" in said
    assert "report-*.csv" in said
    (tmp_path / "report-growth.csv").write_text("# machine: one\nwith,size\npixels,3\n")
    assert "report-growth.csv: contains no pair of columns NAME and NAME_spread; remove it" in refused("new", *against)
    assert "report-growth.csv: contains no pair of columns" in refused(".")
    assert [path.name for path in tmp_path.iterdir()] == ["report-growth.csv"]
