"""The manifests name what is in rtl/, in an order that tools can read, and FuseSoC builds a user's design with them."""

import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner
from clone import TOP, clone, files
from lippmann.errors import LippmannError
from lippmann.simulation.toolchain import PREFIX, rtl_folders, rtl_sources, verilator_environment
from tools.generate_manifests import main

EXAMPLE = "docs/how-to/example-design"
#: All but those of the FPGA boards, which only `make bitstream` reads.
SOURCES = [name for name in files("rtl") if name.endswith(".sv") and name.count("/") == 2]
#: Modules with a form of each device; black boxes of the device's own cells.
CELLS = {
    "mult18", "wide_product", "gated_sum", "small_product", "row_multiplier", "ring", "block_ring", "memory_1w1r",
}  # fmt: skip
GENERIC = {name for name in SOURCES if not name.startswith("rtl/ecp5/")}
REPLACED = {name for name in GENERIC if Path(name).stem.removeprefix(PREFIX) in CELLS}
ECP5 = {f"rtl/ecp5/{PREFIX}{module}.sv" for module in CELLS}
BLACK_BOXES = "rtl/ecp5/black_boxes.v"


def file_list(name):
    """The files of rtl/NAME, by their paths in the checkout."""
    lines = [line for line in (TOP / "rtl" / name).read_text().splitlines() if not line.startswith("//")]
    return [f"rtl/{line}" for line in lines]


def bender_files(*targets):
    """What `bender script` selects: the groups whose target holds."""
    names = {"any": lambda *some: any(some), "all": lambda *some: all(some)}
    found = []
    for group in yaml.safe_load((TOP / "Bender.yml").read_text())["sources"]:
        rule = re.sub(r"\bnot\b", "not ", group.get("target", "True"))
        known = {word: word in targets for word in re.findall(r"\w+", rule)} | {"True": True} | names
        if eval(rule, {"__builtins__": {}}, known):
            found += group["files"]
    return found


def core_files(*flags):
    """What FuseSoC selects from the core's default target."""
    core = yaml.safe_load((TOP / "rtl/lippmann.core").read_text().removeprefix("CAPI=2:"))
    found = []
    for rule in core["targets"]["default"]["filesets"]:
        *conditions, name = re.findall(r"!?\w+", rule)
        if all((word[0] != "!") == (word.lstrip("!") in flags) for word in conditions):
            found += [f"rtl/{file}" for file in core["filesets"][name]["files"]]
    assert found.count("rtl/registers/lint.vlt") == 1  # which only Verilator reads
    return [name for name in found if not name.endswith(".vlt")]


def test_the_committed_files_are_those_that_the_command_makes(monkeypatch, tmp_path):
    shutil.copytree(TOP / "rtl", tmp_path / "rtl")
    shutil.copy(TOP / "pyproject.toml", tmp_path)
    names = ["Bender.yml", "rtl/lippmann.core", "rtl/lippmann.f", "rtl/lippmann_ecp5.f"]
    for name in names:
        (tmp_path / name).unlink(missing_ok=True)
    monkeypatch.setattr("tools.generate_manifests.repository", lambda: tmp_path)
    assert sorted(CliRunner().invoke(main).stdout.split()) == names
    for name in names:
        assert (tmp_path / name).read_text() == (TOP / name).read_text(), f"{name}: run make manifests"
    assert "-m tools.generate_manifests\n" in (TOP / "Makefile").read_text()


def test_every_file_stands_in_the_list_once():
    parts = tomllib.loads((TOP / "rtl/sources.toml").read_text())
    parts |= parts.pop("devices")
    named = [f"rtl/{folder}/{PREFIX}{name}.sv" for folder, names in parts.items() for name in names]
    assert sorted(named) == SOURCES
    assert len(SOURCES) > 70


@pytest.mark.parametrize(
    ("select", "kinds"),
    [
        (lambda: file_list("lippmann.f"), GENERIC),
        (bender_files, GENERIC),
        (core_files, GENERIC),
        (lambda: file_list("lippmann_ecp5.f"), GENERIC - REPLACED | ECP5),
        (lambda: bender_files("ecp5"), GENERIC - REPLACED | ECP5),
        (lambda: core_files("ecp5"), GENERIC - REPLACED | ECP5),
        (lambda: bender_files("ecp5", "black_boxes"), GENERIC - REPLACED | ECP5 | {BLACK_BOXES}),
        (lambda: core_files("ecp5", "black_boxes"), GENERIC - REPLACED | ECP5 | {BLACK_BOXES}),
    ],
)
def test_each_manifest_has_each_file_once_and_packages_before_their_users(select, kinds):
    found = select()
    assert len(REPLACED) == len(CELLS)
    assert sorted(found) == sorted(kinds)
    stems = [Path(name).stem for name in found]
    for place, name in enumerate(found):
        code = re.sub(r"//.*", "", (TOP / name).read_text())
        for package in re.findall(rf"\b({PREFIX}\w+_pkg)::", code):
            assert stems.index(package) < place or package == stems[place], f"{package} after {name}"


def test_a_folder_uses_itself_and_those_above_it_only():
    folders = rtl_folders(TOP)
    of = {path.stem: place for place, some in enumerate(folders.values()) for path in some}
    for place, some in enumerate(folders.values()):
        for path in some:
            used = set(re.findall(rf"\b{PREFIX}\w+\b", re.sub(r"//.*", "", path.read_text()))) & of.keys()
            assert max(of[name] for name in used) <= place, path.name


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda rtl: (rtl / "optics/lipp_new.sv").write_text(""), "lacks rtl/optics/lipp_new.sv; correct the list"),
        (lambda rtl: (rtl / "ecp5/lipp_ring.sv").unlink(), "lists the missing file rtl/ecp5/lipp_ring.sv"),
        (lambda rtl: (rtl / "common/lipp_fifo.sv").unlink(), "lists the missing file rtl/common/lipp_fifo.sv"),
    ],
)
def test_a_list_that_is_not_that_of_the_files_is_refused(tmp_path, change, said):
    shutil.copytree(TOP / "rtl", tmp_path / "rtl")
    assert rtl_sources(tmp_path)
    change(tmp_path / "rtl")
    with pytest.raises(LippmannError, match=f"^rtl/sources.toml {said}"):
        rtl_sources(tmp_path)


@pytest.mark.parametrize(
    ("top", "cells", "place"),
    [
        ("lipp_board", "", "the checkout"),
        ("lipp_optics_block", "", "another folder"),
        ("lipp_optics_block", "_ecp5", "the checkout"),
        ("lipp_board", "_ecp5", "another folder"),
    ],
)
def test_verilator_reads_a_file_list(top, cells, place, tmp_path):
    folder = TOP if place == "the checkout" else tmp_path
    rtl = "rtl" if folder == TOP else str(TOP / "rtl")
    command = ["verilator", "--lint-only", f"{rtl}/registers/lint.vlt", "-F", f"{rtl}/lippmann{cells}.f"]
    command += ["--top-module", top]
    if cells:
        command += [f"{rtl}/ecp5/black_boxes.v", "-Wno-PINMISSING"]
    done = subprocess.run(command, cwd=folder, env=verilator_environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr


@pytest.mark.full  # minutes of a compiler, even without optimisation
def test_the_how_to_builds_a_module_with_verilator(place):
    """The lines as printed, in a clone; they failed without the option for the precompiled header."""
    page = (place / "docs/how-to/use-the-rtl-in-your-design.md").read_text()
    lines = re.search(r"^```sh\n(export .*\nverilator .*)\n```$", page, re.M)[1]
    (place / ".venv").symlink_to(sys.prefix)
    environment = os.environ | {"MAKEFLAGS": "OPT_FAST=-O0 OPT_SLOW=-O0 OPT_GLOBAL=-O0"}
    command = ["bash", "-euo", "pipefail", "-c", lines]
    done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    assert (place / re.search(r"The result is `(\S+)`", page)[1]).is_file()


# ---- the example design ----


def test_the_rays_of_the_example_are_those_of_the_twin():
    made = runpy.run_path(str(TOP / EXAMPLE / "make_data.py"))
    texts = made["texts"]()
    assert texts.keys() == {"display_pkg.sv", "expected.mem"}
    for name, text in texts.items():
        assert (TOP / EXAMPLE / name).read_text() == text, f"run {EXAMPLE}/make_data.py"
    words = [int(line, 16) for line in texts["expected.mem"].split()]
    assert len(set(words)) == len(words) == 768
    assert not any(word & 7 for word in words)  # status ok


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return clone(tmp_path_factory.mktemp("clone"))


def fusesoc(place, target, core):
    """Run a target as a user does who has the tools on the PATH; return what was said and the folder of the build."""
    tools = verilator_environment()
    path = os.pathsep.join([str(Path(sys.executable).parent), tools["PATH"]])
    # FuseSoC keeps a library's settings of the user's; none here. yosys' translation stays in its own cache.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"PATH": path, "XDG_CONFIG_HOME": str(place / "config")}
    command = ["fusesoc", "--cores-root", "rtl", "--cores-root", EXAMPLE, "run", "--target", target, core]
    done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    return done.stdout + done.stderr, place / "build" / f"{core.replace(':', '_')}" / target


BOARD = "lippmann:example:board"


@pytest.mark.parametrize(
    ("target", "core", "once", "absent"),
    [
        ("lint", "lippmann:lippmann:rtl", "lipp_board.sv", "board.sv"),
        ("lint", BOARD, "fifo.sv delay.sv board.sv lipp_fifo.sv lipp_delay.sv lipp_board.sv", "axi_optics.sv"),
        ("lint_axi", BOARD, "axi_optics.sv", "board.sv"),
    ],
)
def test_fusesoc_lints_the_board_and_the_examples_beside_modules_of_like_names(place, target, core, once, absent):
    said, _ = fusesoc(place, target, core)
    assert "Warning" not in said
    (listed,) = (place / "build").glob(f"{core.replace(':', '_')}_*/{target}/*.vc")
    names = [Path(line).name for line in listed.read_text().splitlines()]
    assert [names.count(name) for name in once.split()] == [1] * len(once.split())
    assert absent not in names


def test_the_axi_example_names_the_ports_of_its_adapters():
    """Each port of an AXI adapter's bus side is a port of the example: direction, width and name."""

    def ports(path):
        code = re.sub(r"//.*", "", (TOP / path).read_text()).replace("AddressBits-1", "8")
        header = code[code.index("module ") : code.index(");")]
        found = re.findall(r"(input|output)\s+logic\s*(\[[^]]*\])?\s*((?:s_axil|s_axis|m_axis)_\w+)", header)
        return {name: (direction, width) for direction, width, name in found}

    adapters = ("axil_to_apb", "axis_to_rays", "axis_from_rays")
    expected = {name: port for one in adapters for name, port in ports(f"rtl/bus/{PREFIX}{one}.sv").items()}
    assert len(expected) == 19 + 5 + 5
    assert ports(f"{EXAMPLE}/axi_optics.sv") == expected


@pytest.mark.full  # its lint is quick
def test_fusesoc_simulates_the_example(place):
    said, _ = fusesoc(place, "sim", BOARD)
    assert "768 rays as expected" in said
    (work,) = (place / "build").glob("lippmann_example_board_*/sim")
    run = [str(work / "Vtestbench")]
    for seed in (2, 3):
        assert "768 rays" in subprocess.check_output([*run, f"+seed={seed}"], cwd=work, text=True)
    # A bit of one ray.
    expected = (work / "expected.mem").read_text().splitlines()
    expected[500] = f"{int(expected[500], 16) ^ 8:035x}"
    (work / "expected.mem").write_text("\n".join(expected) + "\n")
    done = subprocess.run(run, cwd=work, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "ray 500: " in done.stdout + done.stderr


@pytest.mark.full
def test_fusesoc_synthesises_the_example_with_the_cells_of_ecp5(place):
    said, _ = fusesoc(place, "synth", BOARD)
    counts = {cell: int(count) for count, cell in re.findall(r"^\s*(\d+)\s+([A-Z]\w+)\s*$", said, re.M)}
    # As placed alone: pinhole-compact in docs/generated/reports/synthesis.csv, a build of F = 16 without aims.
    assert counts["MULT18X18D"] == 16
    assert counts["DP16KD"] >= 8
    assert counts["TRELLIS_FF"] > 2000
