"""The kept report of the hard cases holds what is promised, and the formulas gain what the page says."""

import csv

from lippmann.conformance.hard_cases import CASES
from lippmann.simulation.toolchain import repository
from tools.hard_case_errors import measure_formulas

REPORTS = repository() / "docs/generated/reports"


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
