"""`vectors --stream | A DESIGN IN ITS BENCH | regress --stream`: foreign RTL, right, and in test-full with faults."""

import os
import re
import subprocess
import sys

import pytest
from lippmann.simulation.toolchain import repository

TOP = repository()
FOREIGN = TOP / "tests" / "foreign"
sys.path.insert(0, str(FOREIGN))
from design_faults import DESIGN_DISPLAYS, DESIGN_FAULTS  # noqa: E402

SOURCES = {name: (FOREIGN / name).read_text() for name in ("pinhole.sv", "stream_bench.sv")}
HOW_TO = (TOP / "docs/how-to/regress.md").read_text()
#: The how-to's lines: the PATH, the compilation, and the pipes of the two benches.
ON_PATH, COMPILE, PIPE, COCOTB = re.search(
    r"^```\w+\n(export .*)\n(verilator .*)\n(lippmann .*)\n(lippmann .*)\n```$", HOW_TO, re.M
).groups()
LIPPMANN = f"{sys.executable} -m lippmann"
WRONG = re.compile(r"^(\S+): \d+ of \d+ rays wrong, the first is \d+; stage: [^;]*; (.*)$", re.M)


def shell(*lines, folder):
    """Run lines as a reader would, with no Verilator on the PATH; the compilation without optimisation."""
    # Verilator's makefiles set these, and only make's own flags override them.
    flags = " ".join(f"{name}=-O0" for name in ("OPT_FAST", "OPT_SLOW", "OPT_GLOBAL"))
    environment = os.environ | {"MAKEFLAGS": flags}
    environment.pop("PYTEST_CURRENT_TEST", None)  # cocotb takes it for a test around its own
    command = ["bash", "-euo", "pipefail", "-c", "\n".join(lines)]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def reader_folder(folder):
    """Return a folder that looks like the project's top."""
    (folder / ".venv").symlink_to(sys.prefix)
    for name in ("scenes", "tests"):
        (folder / name).symlink_to(TOP / name)
    for name, text in DESIGN_DISPLAYS.items():
        (folder / f"{name}.toml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """Return a reader's folder with the bench compiled by the how-to's lines."""
    folder = reader_folder(tmp_path_factory.mktemp("reader"))
    done = shell(ON_PATH, COMPILE, folder=folder)
    assert done.returncode == 0, done.stderr
    return folder


def judged(folder, display, options, random):
    """Ask a compiled bench for rays of a display, and return what regress makes of its answers."""
    vectors = f"{LIPPMANN} vectors --display {display} --model pinhole --stream --random {random} {options}"
    return shell(f"{vectors} | ./build/bench +verilator+quiet | {LIPPMANN} regress --stream", folder=folder)


def shown():
    """Return the verdict that the how-to shows under its lines."""
    return re.search(rf"{re.escape(COCOTB)}\n```\n\n    (\d+ rays in \d+ sets: right)\n", HOW_TO)[1]


def test_the_how_to_compiles_and_judges_the_design(reader):
    done = shell(ON_PATH, PIPE, folder=reader)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[0] == shown()


def test_the_how_to_runs_the_cocotb_bench(reader):
    done = shell(ON_PATH, COCOTB, folder=reader)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == shown()


def test_the_benches_begin_with_the_lines_of_the_how_to():
    head = SOURCES["stream_bench.sv"].partition("\nmodule ")[0]
    assert re.findall(r"^///   (.*)$", head, re.M) == [ON_PATH, COMPILE, PIPE]
    head = (FOREIGN / "stream_cocotb.py").read_text().split('"""')[1]
    assert re.findall(r"^    (.*)$", head, re.M) == [ON_PATH, COCOTB]


@pytest.mark.parametrize("turn", [0.0, 9.0, -133.0])
def test_the_design_is_right(turn, reader):
    text = DESIGN_DISPLAYS["plain"].replace("rotation_deg = 9.0", f"rotation_deg = {turn}")
    (reader / "turned.toml").write_text(text)
    done = judged(reader, "turned.toml", "--case chief-ray", 3000)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[0] == "3048 rays in 2 sets: right"


@pytest.mark.parametrize(
    ("options", "name", "why"),
    [
        ("--model exact", "chief-ray", "give --model pinhole"),
        ("--model pinhole --words", "chief-ray", "without --words"),
        ("--model pinhole --case skewed", "skewed/measured", "of plain square lenslets"),
        ("--model pinhole --case converged", "converged/near", "of plain square lenslets"),
    ],
)
def test_the_bench_says_why_it_stops(options, name, why, reader):
    """At stderr; the stream is cut there, and no word of the simulator is taken for an answer."""
    case = "" if "--case" in options else "--case chief-ray"
    vectors = f"{LIPPMANN} vectors --display plain.toml --stream {case} {options}"
    done = shell(f"{vectors} | ./build/bench +verilator+quiet | {LIPPMANN} regress --stream", folder=reader)
    assert done.returncode == 2
    reason, ended = sorted(done.stderr.splitlines(), reverse=True)
    assert reason.startswith(f"stream_bench: the set {name} is not ")
    assert why in reason
    assert f"is truncated in the set {name}, after 0 of its rays" in ended


@pytest.mark.parametrize(
    ("file", "old", "new", "options", "said"),
    [
        pytest.param(
            "stream_cocotb.py", 'self.value["pitch_x"] * i', 'self.value["pitch"] * i', "--model pinhole",
            ["in answer", "KeyError: 'pitch'", "the test in the simulator failed"], marks=pytest.mark.full,
        ),
        pytest.param(
            "pinhole.sv", "", "", "--model exact", ["ValueError: the stream is not in ", "give --model pinhole"],
            marks=pytest.mark.full,
        ),
        ("pinhole.sv", "endmodule", "endmodul", "--model pinhole", ["pinhole.sv:74", "syntax error"]),
    ],
    ids=["answer", "model", "design"],
)  # fmt: skip
def test_the_cocotb_bench_says_why_it_fails(file, old, new, options, said, tmp_path):
    """The end of the log, at stderr, and exit code 1; the notes before stay, so that regress calls the stream cut."""
    folder = reader_folder(tmp_path)
    for path in (FOREIGN / "pinhole.sv", FOREIGN / "stream_cocotb.py"):
        text = path.read_text()
        assert old in text or path.name != file
        (folder / path.name).write_text(text.replace(old, new) if path.name == file else text)
    vectors = f"{LIPPMANN} vectors --display plain.toml --stream --case chief-ray {options}"
    done = shell(ON_PATH, f"{vectors} | python stream_cocotb.py", folder=folder)
    assert done.returncode == 1
    assert all(word in done.stderr for word in said), done.stderr
    assert len(done.stderr.splitlines()) <= 30
    assert not re.search(r"^\d", done.stdout, re.M)
    (folder / "answers").write_text(done.stdout)
    ended = shell(f"{LIPPMANN} regress --stream < answers", folder=folder)
    assert ended.returncode == 2
    assert ("is empty" if file == "pinhole.sv" and old else "is truncated in the set chief-ray") in ended.stderr


def test_the_cocotb_bench_says_that_verilator_is_missing(tmp_path):
    done = shell(f"PATH=/nowhere {sys.executable} {FOREIGN / 'stream_cocotb.py'} < /dev/null", folder=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("stream_cocotb: ERROR: verilator executable not found")
    assert "first lines" in done.stderr


def said_of(name, folder):
    """Return the fault that regress names for a planted one: that of the last set that is wrong."""
    (folder / "build").mkdir(exist_ok=True)
    texts, fault = dict(SOURCES), DESIGN_FAULTS[name]
    for old, new in fault.edits:
        (file,) = [file for file, text in texts.items() if old in text]
        texts[file] = texts[file].replace(old, new)
    for file, text in texts.items():
        (folder / "build" / file).write_text(text)
    line = COMPILE.replace("tests/foreign/", "build/").replace("--binary", "--binary -Wno-fatal")
    done = shell(ON_PATH, line, folder=folder)
    assert done.returncode == 0, f"{name}: {done.stderr}"
    done = judged(folder, f"{fault.display}.toml", f"--case {fault.case}", 2000)
    assert (done.returncode, done.stderr) == (4, ""), f"{name}: no ray is wrong"
    return WRONG.findall(done.stdout)[-1][1]


@pytest.mark.full  # minutes
def test_faults_of_the_design_are_named(tmp_path, reader):
    assert len(DESIGN_FAULTS) == 30
    for display, case in {(fault.display, fault.case) for fault in DESIGN_FAULTS.values()}:
        done = judged(reader, f"{display}.toml", f"--case {case}", 2000)
        assert (done.returncode, done.stderr) == (0, ""), f"{display}, {case}: not without a fault"
    workshop = reader_folder(tmp_path)
    said = {name: said_of(name, workshop) for name in DESIGN_FAULTS}
    unnamed = {name: fault for name, fault in said.items() if not re.fullmatch(DESIGN_FAULTS[name].said, fault)}
    assert len(unnamed) <= 2, "\n".join(f"{name}: {fault}" for name, fault in unnamed.items())
