"""The kept reports, that of the hard cases too, are whole and keep what is promised."""

import csv
import itertools
import re

import pytest
from lippmann.conformance.figures import read_stored
from lippmann.conformance.hard_cases import CASES
from lippmann.optics.rays import ENGINES, MODELS
from lippmann.simulation.toolchain import repository
from tools.full_report import TABLES, WHOLE, on_front
from tools.hard_case_errors import measure_formulas
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


def rows_of(name):
    with (REPORTS / f"{name}.csv").open() as stream:
        return list(csv.DictReader(line for line in stream if line[0] != "#"))


def test_golden_and_fast_keep_their_bounds_on_every_case():
    rows = rows_of("hard-cases")
    assert {row["set"].split("/")[0] for row in rows} == set(CASES)
    assert {(row["grid"], row["plano_side"]) for row in rows} == {
        (grid, side) for grid in ("square", "hex") for side in ("panel", "viewer")
    }
    for row in rows:
        bound = 4.0 if row["engine"] == "golden" else 2.0
        assert float(row["bound"]) == bound
        assert float(row["worst"]) <= bound, row
        assert row["not_a_number"] == row["outside_band"] == "0", row


def test_nothing_overflows_unseen_and_rtl_is_the_twin():
    rows = rows_of("hard-cases-fixed")
    assert all(row["overflowed"] == "0" for row in rows)
    simulated = [row for row in rows if row["words_differ"]]
    assert all(row["words_differ"] == "0" for row in simulated)
    assert len(simulated) > 100
    assert all(row["why"] for row in rows if int(row["refused"]))


def test_every_formula_gains():
    gains = measure_formulas(7)
    assert len(gains) >= 12
    for gain in gains:
        assert gain["chosen"] < gain["naive"], gain
    # No term grows with R: as many digits at 10^6 mm as at 1.5.
    feet = [gain for gain in gains if gain["formula"] == "perpendicular foot" and gain["number_format"] == "float32"]
    assert max(gain["chosen"] for gain in feet) < 3 * min(gain["chosen"] for gain in feet)


def test_every_case_is_in_the_reference():
    page = (repository() / "docs/reference/stability.md").read_text()
    assert not [name for name in CASES if f"`{name}`" not in page]
