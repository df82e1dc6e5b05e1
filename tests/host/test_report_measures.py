"""What the report measures, keeps and compares: against closed forms, and on made-up figures."""

import dataclasses
import math

import numpy as np
import pytest
from lippmann.base.tones import decode
from lippmann.conformance import engine_report
from lippmann.conformance.engine_report import in_turn, middle
from lippmann.conformance.fifty_digits import true_rays
from lippmann.conformance.figures import Figures, Measured, compare, has_moved, read_figures, read_stored, write_csv
from lippmann.conformance.pages import TEMPLATES, Page
from lippmann.display.description import load_display
from lippmann.engines import trace
from lippmann.errors import InputError
from lippmann.optics.rays import Status
from lippmann.simulation.toolchain import repository
from tools import full_report, renderer_speed
from tools.full_report import pareto_front
from tools.renderer_speed import noise_levels

SCENES = repository() / "scenes"
DEPTHS = (-165.0, 78.0)


def shipped(name):
    return load_display(SCENES / f"displays/{name}.toml")


@pytest.mark.parametrize("angle", [1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("shift_mm", [0.0, 2e-6, 1e-3])
def test_errors_of_turned_and_shifted_rays(angle, shift_mm):
    """Rays along the axis, all of them turned about y and moved along x: chord, shift, shift + z tan."""
    display = shipped("paper-square")
    true = trace(display, np.array([[1200.5, 1200.5], [900.5, 300.5], [10.5, 2000.5]]), None, "pinhole")
    true = dataclasses.replace(true, local_mm=np.zeros((3, 3)), direction=np.tile([0.0, 0.0, 1.0], (3, 1)))
    turned = np.tile([math.sin(angle), 0.0, math.cos(angle)], (3, 1))
    turned[2] = [0.0, 0.0, 1.0]  # one in three is right
    local = np.tile([shift_mm, 0.0, 0.0], (3, 1))
    found = engine_report.errors(true, dataclasses.replace(true, local_mm=local, direction=turned), DEPTHS)
    chord, far = 2.0 * math.sin(angle / 2.0), abs(shift_mm - 165.0 * math.tan(angle))
    near = shift_mm + 78.0 * math.tan(angle)
    assert found["max_urad"] == pytest.approx(1e6 * chord, rel=1e-6)
    assert found["rms_urad"] == pytest.approx(1e6 * chord * math.sqrt(2 / 3), rel=1e-6)
    assert found["max_nm"] == found["rms_nm"] == pytest.approx(1e6 * shift_mm)
    assert found["max_mm"] == pytest.approx(max(far, near, shift_mm), rel=1e-9)
    squares = 2 * max(far, near) ** 2 + shift_mm**2
    assert found["rms_mm"] == pytest.approx(math.sqrt(squares / 3), rel=1e-9)
    assert found["other_fates"] == 0


def test_rays_of_other_fates_are_counted_and_not_compared():
    display = shipped("paper-square")
    true = trace(display, np.full((4, 2), 1200.5))
    status, lenslet = true.status.copy(), true.lenslet.copy()
    status[0] = int(Status.MISSED)
    lenslet[1, 0] += 1
    # Lost in both, each in its own way: no other fate.
    status[3], blocked = int(Status.MISSED), true.status.copy()
    blocked[3] = int(Status.BLOCKED)
    true = dataclasses.replace(true, status=blocked)
    wrong = true.direction.copy()
    wrong[:2] = (1.0, 0.0, 0.0)
    found = engine_report.errors(
        true, dataclasses.replace(true, status=status, lenslet=lenslet, direction=wrong), DEPTHS
    )
    assert found["other_fates"] == 2
    assert found["max_urad"] == found["max_mm"] == 0.0


@pytest.mark.parametrize("name", ["paper-square", "paper-hex", "uhd-8k"])
@pytest.mark.parametrize("aperture", ["chief", "full"])
def test_every_engine_takes_the_sample_as_it_is(mi, name, aperture):
    """The twin's words hold pixels and aims exactly; golden agrees with 50 digits to a float64's rounding."""
    sample = engine_report.random_rays(shipped(name), aperture, 12, 5)
    twin = sample.trace("twin")
    assert (twin.pixel == sample.pixels).all()
    found = engine_report.errors(true_rays(sample), sample.trace(), DEPTHS)
    assert found["other_fates"] == 0
    assert 0.0 < found["max_urad"] < 1e-6
    assert found["max_mm"] < 1e-10
    assert len(sample.select(slice(5)).pixels) == 5


def test_a_display_that_no_word_holds_is_measured_without_the_twin(caplog):
    display = shipped("vga-square")
    thin = dataclasses.replace(display, array=dataclasses.replace(display.array, index=1.05, radius_mm=0.9))
    assert engine_report.engines_for(display) == ["golden", "fast", "twin", "rtl"]
    assert caplog.text == ""
    assert engine_report.engines_for(thin) == ["golden", "fast"]
    assert "vga-square: the twin and the RTL are not measured: register index: 1.05" in caplog.text


@pytest.mark.parametrize("levels", [0.5, 2.0, 8.0])
def test_noise_is_its_standard_deviation(levels):
    seed = 3
    print(f"seed {seed}")
    random = np.random.default_rng(seed)
    pictures = (decode(0.5 + random.normal(0.0, levels / 255.0, (200, 200, 3)), "srgb") for _ in range(2))
    # Of 120,000 values: the estimate's own deviation is 0.2 %.
    assert noise_levels(*pictures) == pytest.approx(levels, rel=0.01)


@pytest.mark.parametrize(("most", "size"), [(3000, (3000, 2160)), (9000, (3840, 2160))])
def test_the_middle_of_a_panel(most, size):
    display = shipped("uhd-4k")
    small = middle(display, most)
    assert (small.panel.width_px, small.panel.height_px) == size
    assert small.array == display.array
    # Its centre is the panel's centre: the ray of the pixel that far from it is the same.
    corner = np.array([[10.5, 20.5]])
    away = 0.5 * (np.array([3840, 2160]) - size)
    one, other = trace(display, corner + away), trace(small, corner)
    assert np.allclose(one.origin_mm, other.origin_mm, rtol=0, atol=1e-12)
    assert np.allclose(one.direction, other.direction, rtol=0, atol=1e-15)


@pytest.mark.parametrize("power", [-1.0, 0.0, 0.5, 1.0, 2.0])
def test_exponent_of_a_power_law(power):
    sizes = np.array([1, 2, 5, 30])
    assert renderer_speed.exponent(sizes, 3.0 * sizes**power) == pytest.approx(power, abs=1e-12)
    assert renderer_speed.exponent([4], [1.0]) is None


def test_missing_figures_of_place_and_route_are_told(monkeypatch, tmp_path):
    (tmp_path / "docs/generated/reports").mkdir(parents=True)
    (tmp_path / full_report.SYNTHESIS).write_text("# machine: one\nconfiguration,lut\nwidest-square,5\n")
    monkeypatch.setattr(full_report, "repository", lambda: tmp_path)
    with pytest.raises(InputError, match=r"synthesis\.csv: has no figures of place-and-route .*; run make synth"):
        full_report.placed()


def test_the_front_counts_cells_clock_and_error():
    def row(name, lut, mhz, error, display="one", rays="chief"):
        cost = {"lut": lut, "mult18x18d": 43, "dp16kd": 50, "ramw": 76, "mhz": mhz}
        figures = {key: None if mhz is None else Measured(value) for key, value in cost.items()}
        return {"configuration": name, "display": display, "rays": rays, **figures, "max_mm": Measured(error)}

    rows = [
        row("small", 5000, 180, 1e-2),
        row("exact", 20000, 160, 1e-5),
        row("worse", 20000, 150, 1e-5),  # slower than "exact", else alike
        row("fast", 20000, 200, 1e-3),
        row("unplaced", None, None, 1e-9),
        row("elsewhere", 90000, 10, 1.0, display="other"),
        row("aims", 90000, 10, 1.0, rays="full"),
    ]
    found = full_report.on_front(Figures("report-rtl", ("configuration", "display", "rays"), rows))
    assert found == {"small": True, "exact": True, "worse": False, "fast": True, "elsewhere": True, "aims": True}


@pytest.mark.parametrize(("everybody", "others"), [(100.0, "70 of 100"), (10.0, "0 of 10"), (None, None)])
def test_load_tells_the_work_that_was_not_ours(monkeypatch, everybody, others):
    """Nothing of it where no /proc tells what everybody did."""
    start = engine_report.Load(0.25, 1000.0, 50.0)
    now = engine_report.Load(9.0, None if everybody is None else 1000.0 + everybody, 80.0)
    monkeypatch.setattr(engine_report.Load, "now", lambda: now)
    told = "" if others is None else f"; {others} s of processor time since then were other programs'"
    assert engine_report.load_since(start) == f"average 0.2 at the start{told}"


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
    with pytest.raises(InputError, match=r"report-other\.csv: is from another run than report-made\.csv"):
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
    assert "1 of 2 values changed" in told(found, tmp_path)
    assert "| report-made | fast | rate | 400 | 300 | 0.75 |" in told(found, tmp_path)


@pytest.mark.parametrize(
    ("key", "compares", "said"),
    [
        ("command", False, "differ in command"),
        ("seed", False, "differ in seed"),
        ("machine", True, f"machine, now {ORIGIN['machine']}, before other"),
        ("versions", True, f"versions, now {ORIGIN['versions']}, before other"),
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
    assert "no values are compared" in told(found, tmp_path)


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
