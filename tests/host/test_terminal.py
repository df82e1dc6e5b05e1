"""What files and names bring to the terminal, and to other programs."""

import logging
import subprocess
import sys
import warnings
from pathlib import Path

import click
import numpy as np
import pytest
from lippmann import errors
from lippmann.cli import output, progress_bar, run
from lippmann.motion.video import write_video
from lippmann.rendering import executors as cluster
from scene_cases import small_toml

NAMED = 'name = "evil\\u001b]0;title\\u0007\\u009b31m\\u202etxt\\u007f"\n' + small_toml(64, 64, "dpi = 254")
SHOWN = r"evil\x1b]0;title\x07\x9b31m\u202etxt\x7f"


def test_control_characters_of_names_are_shown(tmp_path, capsys):
    (tmp_path / "d.toml").write_text(NAMED)
    assert run(["inspect", str(tmp_path / "d.toml")]) == 0
    out = capsys.readouterr().out
    assert SHOWN in out
    assert not errors.CONTROLS.search(out)
    odd = tmp_path / "no\x1b[2Jsuch.toml"
    assert run(["inspect", str(odd)]) == 2
    err = capsys.readouterr().err
    assert r"no\x1b[2Jsuch.toml: no such file" in err
    assert not errors.CONTROLS.search(err)


def test_a_name_of_two_lines_is_refused(tmp_path, capsys):
    (tmp_path / "d.toml").write_text(NAMED.replace("evil", r"two\nlines"))
    assert run(["inspect", str(tmp_path / "d.toml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("d.toml: name: has a line break; write the name on one line")


def test_bytes_that_are_no_text_in_a_name(tmp_path):
    """In a process of its own: its arguments are bytes."""
    done = subprocess.run(
        [sys.executable.encode(), b"-m", b"lippmann", b"inspect", b"\xff\x1b.toml"],
        capture_output=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert b"\x1b" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_ordinary_text_stays():
    text = "Größe µm 3 × 4\n\tαβ → 日本 – “x”"
    assert errors.printable(text) == text


@pytest.fixture
def log_lines(monkeypatch):
    """The lines that a progress bar logs, by a clock that moves on ten seconds at each report."""
    clock, lines = {"s": 0.0}, []
    monkeypatch.setattr(progress_bar.time, "monotonic", lambda: clock["s"])
    monkeypatch.setattr(progress_bar, "log", lines.append)

    def lines_of(reports, total, starts_s=0.0):
        clock["s"] = 0.0
        with click.Context(click.Command("x"), info_name="x") as context:
            context.params["as_json"] = True
            with progress_bar.progress_bar("render") as progress:
                clock["s"] = starts_s
                for done in reports:
                    clock["s"] += 10.0
                    progress(done, total)
        return lines

    return lines_of


@pytest.mark.parametrize(
    ("reports", "total", "starts_s", "min_rate_s", "lines"),
    [
        # What an earlier run did took no time: 50 rows in ten seconds.
        ((100, 150, 200, 250, 300, 400), 400, 0.0, None, ["50 % after 30 s, about 40 s left",
                                                          "100 % after 60 s, about 0 s left"]),
        # A board is compiled for 33 s first: the first reports say nothing of 33,000 tiles.
        ((0, 1000, 2000, 3000), 33_000, 33.0, None, ["3 % after 53 s, about 320 s left"]),
        # No rate yet.
        ((0, 6), 33_000, 25.0, 15.0, ["0 % after 45 s"]),
    ],
)  # fmt: skip
def test_long_work_tells_its_progress_in_a_log(log_lines, monkeypatch, reports, total, starts_s, min_rate_s, lines):
    monkeypatch.setattr(progress_bar, "MIN_RATE_S", min_rate_s or progress_bar.MIN_RATE_S)
    assert log_lines(reports, total, starts_s) == [f"render: {line}" for line in lines]


@pytest.mark.parametrize("as_json", [False, True])
def test_the_command_line_writes_logs_and_warnings_to_stderr(as_json, capsys):
    @click.command()
    @click.option("--json", "as_json", is_flag=True)
    def command(as_json):
        logging.getLogger("lippmann").info("placed by \x1b[1mhand")
        for _ in range(2):
            warnings.warn("the scene has no light", errors.LippmannWarning, stacklevel=1)
        output.emit({"rows": 3}, "3 rows")

    assert run(["--json"] if as_json else [], command) == 0
    out, err = capsys.readouterr()
    assert out == ('{"rows": 3}\n' if as_json else "3 rows\n")
    assert err == "placed by \\x1b[1mhand\n" + 2 * "note: the scene has no light\n"
    logging.getLogger("lippmann").info("no command runs")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", ["a:b.mkv", "-x.mkv", "concat:a|b.mkv", "%03d.mkv", "http://x.mkv"])
def test_names_of_videos_are_files(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    path = Path(name.replace("/", ""))
    frames = [np.full((8, 8, 3), k, np.uint8) for k in range(3)]
    write_video(path, frames, 8, 8, 10.0)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_workers_on_this_machine_stay_on_it():
    command_of = cluster._worker_command
    assert command_of("tcp://127.0.0.1:8786") == "dask worker tcp://127.0.0.1:8786 --host 127.0.0.1 --no-dashboard"
    assert command_of("tcp://far:8786") == "dask worker tcp://far:8786 --no-dashboard"
