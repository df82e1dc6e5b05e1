"""The kept report is whole, and keeps what is promised."""

import itertools
import re

import pytest
from lippmann.conformance.figures import read_stored
from lippmann.optics.rays import ENGINES, MODELS
from lippmann.simulation.toolchain import repository
from tools.full_report import TABLES, WHOLE, on_front
from tools.named_builds import CONFIGURATIONS

REPORTS = repository() / "docs/generated/reports"


@pytest.fixture(scope="module")
def kept():
    return read_stored(REPORTS, TABLES)


def rows(kept, name, **wanted):
    return [row for row in kept.tables[name].rows if all(row[key] == value for key, value in wanted.items())]


def test_it_says_where_it_comes_from(kept):
    assert set(kept.tables) == set(TABLES)
    assert set(kept.origin) == {"machine", "date", "command", "versions", "seed", "load"}
    assert "--quick" not in kept.origin["command"]
    page = (REPORTS / "report.md").read_text()
    plots = re.findall(r"\]\((\S+\.png)\)", page)
    assert len(plots) >= 6
    for plot in plots:
        assert (REPORTS / plot).stat().st_size < 200_000
    for key in ("machine", "date", "command", "versions", "seed"):
        assert page.count(f"{key}: {kept.origin[key]}") > len(plots)


def test_every_engine_and_model_is_there_on_both_grids(kept):
    chief = rows(kept, "report-engines", rays="chief")
    assert {row["grid"] for row in chief} == {"square", "hex"}
    assert {(row["display"], row["model"], row["engine"]) for row in chief} == set(
        itertools.product(WHOLE.displays, MODELS, ENGINES)
    )


def test_engines_keep_their_promises(kept):
    """Of chief rays, docs/reference/optics.md and rtl.md: microradian and nm."""
    for engine, urad, nm in (("golden", 1e-6, 1e-6), ("fast", 2.0, 50.0), ("twin", 1.0, 2.0), ("rtl", 1.0, 2.0)):
        for row in rows(kept, "report-engines", rays="chief", model="exact", engine=engine):
            assert row["own_max_urad"].median <= urad, row
            assert row["own_max_nm"].median <= nm, row
    for row in rows(kept, "report-engines", rays="chief", engine="rtl"):
        (twin,) = rows(kept, "report-engines", **{k: row[k] for k in ("display", "rays", "model")}, engine="twin")
        for key in ("max_urad", "rms_urad", "max_mm", "own_max_urad", "view_db", "direct_db"):
            assert row[key] == twin[key], "RTL and twin are one"


def test_configurations_pictures_and_front(kept):
    table = kept.tables["report-rtl"]
    assert {row["configuration"] for row in table.rows} >= set(CONFIGURATIONS)
    simulated = [row for row in table.rows if row["words_differ"] is not None]
    assert len(simulated) >= 4
    assert all(row["words_differ"].median == 0 for row in simulated)
    for name in ("widest-square", "widest-hex"):
        (row,) = rows(kept, "report-rtl", configuration=name)
        assert row["image_db"].median >= 50.0
        assert row["mhz"] is not None
    assert any(on_front(table).values())
