"""Figures with their spread, kept and read again; what moved; the Pareto front. All on made-up data."""

import numpy as np
import pytest
from lippmann.conformance.engine_report import in_turn
from lippmann.conformance.figures import Figures, Measured, compare, has_moved, read_figures, read_stored, write_csv
from lippmann.conformance.pages import TEMPLATES, Page
from lippmann.errors import InputError
from tools.full_report import pareto_front

ORIGIN = {"machine": "one", "date": "2026-01-01", "command": "lippmann report", "versions": "1", "seed": "0"}


def made(values, name="report-made", **others):
    """A table of one key, "engine", and one figure, "rate", from pairs of median and spread."""
    rows = [
        {"engine": key, "rate": None if value is None else Measured(*value), **others} for key, value in values.items()
    ]
    return Figures(name, ("engine",), rows)


def kept(folder, *tables, origin=None):
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        write_csv(folder / f"{table.name}.csv", origin or ORIGIN, table.flat())
    return read_stored(folder, [table.name for table in tables])


def told(found, folder):
    """The section of the report that tells a comparison."""
    (folder / "moves.md").write_text((TEMPLATES / "report-changes.md").read_text())
    return Page("moves", ORIGIN, context={"comparison": found}, templates=folder).text()


@pytest.mark.parametrize(
    ("repeats", "median", "spread"),
    [([3.0], 3.0, 0.0), ([3.0, 1.0, 2.0], 2.0, 2.0), ([4.0, 1.0, 2.0, 3.0], 2.5, 3.0), ([5.0, 5.0], 5.0, 0.0)],
)
def test_figure_is_median_and_range(repeats, median, spread):
    assert Measured.of(repeats) == Measured(median, spread)


def test_tables_come_back_as_they_were_kept(tmp_path):
    rows = [
        {"engine": "fast, with a comma", "bits": 16, "rate": Measured(0.1 + 0.2, 1e-17), "db": None},
        {"engine": "golden", "bits": 23, "rate": Measured(1e300), "db": Measured(-12.5, 3.0)},
    ]
    stored = kept(tmp_path, Figures("report-made", ("engine", "bits"), rows))
    assert stored.origin == ORIGIN
    table = stored.tables["report-made"]
    assert table.keys == ("engine", "bits")
    assert table.figures == ("rate", "db")
    assert table.rows == rows


@pytest.mark.parametrize("missing", ["report-made", "report-other"])
def test_a_run_that_lacks_a_table_is_read_without_it(tmp_path, missing):
    """Its figures are new then; that a broken table be removed is what the error about it advises."""
    tables = [made({"fast": (1.0, 0.0)}, name) for name in ("report-made", "report-other")]
    kept(tmp_path, *tables)
    (tmp_path / f"{missing}.csv").unlink()
    stored = read_stored(tmp_path, ["report-made", "report-other"])
    assert set(stored.tables) == {"report-made", "report-other"} - {missing}
    found = compare(ORIGIN, tables, stored)
    assert (found.compared, found.new, found.gone, found.moved) == (1, 1, 0, ())


def test_tables_of_two_runs_are_refused(tmp_path):
    kept(tmp_path, made({"fast": (1.0, 0.0)}))
    kept(tmp_path, made({"fast": (1.0, 0.0)}, "report-other"), origin={**ORIGIN, "date": "2026-02-02"})
    with pytest.raises(InputError, match=r"report-other\.csv: is of another run than report-made\.csv"):
        read_stored(tmp_path, ["report-made", "report-other"])


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"engine,rate\nfast,1\n",  # no spread
        b"rate,rate_spread\n1,2\n",  # nothing names the row
        b"engine,rate,rate_spread\nfast,1\n",
        b"engine,rate,rate_spread\nfast,1,2,3\n",
        b"engine,rate,rate_spread\nfast,quick,2\n",
        b"engine,rate,rate_spread\nfast,1,\n",
        b"engine,rate,rate_spread\nfast,nan,1\n",
        b"engine,rate,rate_spread\nfast,1,-1\n",
        b"\xff\xfe\x00engine",
    ],
)
def test_broken_tables_are_refused_in_one_line(tmp_path, content):
    path = tmp_path / "report-made.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"report-made\.csv: .*; remove it, or name another run's folder") as caught:
        read_figures(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("before", "now", "moved"),
    [
        ((10.0, 1.0), (10.0, 1.0), False),
        ((10.0, 1.0), (12.0, 1.0), False),  # apart by just both spreads
        ((10.0, 1.0), (12.1, 1.0), True),
        ((12.1, 1.0), (10.0, 1.0), True),
        ((10.0, 0.0), (12.0, 2.5), False),  # the one is noisy
        ((10.0, 2.5), (12.0, 0.0), False),
        ((10.0, 0.0), (10.0 * (1 + 1e-5), 0.0), True),
        ((10.0, 0.0), (10.0 * (1 + 1e-7), 0.0), False),  # other roundings
        ((0.0, 0.0), (1e-12, 0.0), True),
        ((0.0, 0.0), (0.0, 0.0), False),
    ],
)
def test_what_has_moved(before, now, moved):
    assert has_moved(Measured(*before), Measured(*now)) is moved


@pytest.mark.parametrize("rounds", [3, 5])
def test_noise_alone_is_hardly_ever_called_a_move(rounds):
    seed = 11
    print(f"seed {seed}")
    runs = np.random.default_rng(seed).normal(100.0, 4.0, (2000, 2, rounds))
    alarms = sum(has_moved(Measured.of(a), Measured.of(b)) for a, b in runs)
    assert alarms <= 2000 * 0.02
    assert all(has_moved(Measured.of(a), Measured.of(b + 100.0)) for a, b in runs)


def test_comparison_tells_the_moves_and_no_others(tmp_path):
    before = kept(tmp_path, made({"golden": (10.0, 1.0), "fast": (400.0, 9.0), "gone": (1.0, 0.0), "twin": None}))
    now = made({"golden": (10.5, 1.0), "fast": (300.0, 9.0), "twin": (2.0, 0.1), "rtl": (4.0, 0.0)})
    found = compare(ORIGIN, [now], before)
    assert (found.compared, found.new, found.gone) == (2, 2, 1)
    (move,) = found.moved
    assert (move.table, move.row, move.figure) == ("report-made", "fast", "rate")
    assert (move.before, move.now) == (Measured(400.0, 9.0), Measured(300.0, 9.0))
    assert move.ratio == 0.75
    assert "1 of 2 figures moved" in told(found, tmp_path)
    assert "| report-made | fast | rate | 400 | 300 | 0.75 |" in told(found, tmp_path)


@pytest.mark.parametrize(
    ("key", "compares", "said"),
    [
        ("command", False, "command differ"),
        ("seed", False, "seed differ"),
        ("machine", True, f"machine, now {ORIGIN['machine']}, then other"),
        ("versions", True, f"versions, now {ORIGIN['versions']}, then other"),
    ],
)
def test_a_run_of_another_origin_is_told_and_only_compared_where_it_measured_the_same(tmp_path, key, compares, said):
    before = kept(tmp_path, made({"fast": (1.0, 0.0)}), origin={**ORIGIN, key: "other"})
    found = compare(ORIGIN, [made({"fast": (2.0, 0.0)})], before)
    assert (found.differs, found.changed) == (((), (key,)) if compares else ((key,), ()))
    assert (found.compared, len(found.moved)) == (compares, compares)
    assert said in told(found, tmp_path)


def test_without_a_run_before_nothing_is_compared(tmp_path):
    found = compare(ORIGIN, [made({"fast": (1.0, 0.0)})], None)
    assert (dict(found.before), found.moved) == ({}, ())
    assert "nothing to compare with" in told(found, tmp_path)


def test_works_are_done_in_turn():
    calls = []

    def work(name):
        return lambda: calls.append(name) or float(len(calls))

    assert in_turn({"a": work("a"), "b": work("b")}, 3) == {"a": [1.0, 3.0, 5.0], "b": [2.0, 4.0, 6.0]}
    assert calls == ["a", "b"] * 3


@pytest.mark.parametrize("respects", [1, 2, 3, 6])
def test_pareto_front_holds_what_nothing_beats(respects):
    seed = 100 + respects
    print(f"seed {seed}")
    costs = np.random.default_rng(seed).integers(0, 5, (60, respects))

    def beats(a, b):
        return all(x <= y for x, y in zip(a, b, strict=True)) and any(x < y for x, y in zip(a, b, strict=True))

    front = pareto_front(costs)
    assert front.tolist() == [not any(beats(a, b) for a in costs) for b in costs]
    # What is not on the front is beaten by something that is.
    assert all(any(beats(a, b) for a in costs[front]) for b in costs[~front])
