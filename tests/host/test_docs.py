"""What the documentation says works: links lead somewhere, commands parse and run, examples run, the table is current.

Pages are run as a reader would: blocks in their order, in one folder. A ```toml or ```xml block whose first line is a
comment with a file name (`# mine.toml`) is that file. A command stands in a ```sh block and is run, or, here, with the
reason why it is not; the pages in `SLOW` are run by `make test-full`.
"""

import ast
import contextlib
import csv
import importlib
import importlib.util
import io
import itertools
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from unittest import mock

import click
import pytest
from lippmann.base import toml
from lippmann.capturing.capture_setup import load_setup
from lippmann.cli import COMMANDS, cli, run
from lippmann.conformance.error_bounds import load_bounds
from lippmann.display.description import Panel, load_display
from lippmann.layers.layers_and_pictures import LayersFile, PicturesFile
from lippmann.motion.film import load_film
from lippmann.motion.layer_film import LayerFilmFile
from lippmann.scenes.depth_picture import DepthPictureFile
from lippmann.scenes.placement import load_placement
from lippmann.simulation.toolchain import PREFIX
from scene_cases import small_toml

TOP = Path(__file__).parents[2]
PAGES = sorted([*TOP.glob("*.md"), *TOP.glob("docs/**/*.md"), *TOP.glob("scenes/**/*.md")])
#: Pages that readers follow. The others show the examples of `--help`, one by one: they need a board, or a picture.
FOLLOWED = [page for page in PAGES if page.parent.name != "commands"]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FILE_NAME = re.compile(r"(?:#|<!--) (\S+\.(?:toml|xml))\b")
#: Pages whose commands render large panels, many frames or views, or have a board of 640 x 480 pixels.
SLOW = (
    "README.md", "docs/how-to/board.md", "docs/how-to/browser.md", "docs/how-to/draw-on-the-board.md",
    "docs/how-to/film.md", "docs/how-to/layers.md", "docs/how-to/look-at-it.md", "docs/how-to/own-content.md",
    "docs/how-to/own-fpga.md",
)  # fmt: skip
#: Pages whose Python programs run between the commands, as a board that they need is started and stopped there.
PROGRAMS = ("README.md", "docs/how-to/draw-on-the-board.md")
INDENTED = re.compile(
    r"^    ((?:lippmann|make|python3?|pip|git|cd|source|dask|mitsuba|povray|pytest|sudo|export)(?: .*)?)$", re.M
)
#: The page whose commands run as a reader's, each in a process of its own.
PROCESSES = "docs/how-to/check-mounting.md"
#: Commands that last until they are ended, which happens at the end of their page.
SERVERS = ("dask scheduler ", "dask worker ")
#: What a target of the Makefile is, where only that can be run beside other tests; the Makefile is asked.
SAME = {"make demo": "lippmann demo"}
#: Commands that are not run as they stand, and why; those of `lippmann` are parsed all the same.
NOT_RUN = {
    r"git clone |cd lippmann$|source \.venv/": "lead to the checkout and its environment, in which the tests run",
    r"make setup|make test|make$": "are what runs the tests; their targets are looked up",
    r"python scenes/": "make the shipped files again, over those that other tests read; the scripts are looked up",
    r"python -m tools\.formal ": "minutes; tests/rtl/test_formal.py runs every proof; the module is looked up",
    r"python -m tools\.(crossings|netlist) ": (
        "minutes; tests/rtl/test_crossings.py and test_netlist.py run the same; the modules are looked up"
    ),
    r"lippmann export povray .* -o out/pov$|cd out/pov && povray|lippmann capture scenes/seed/full\.xml": (
        "in the report of `make peers`, which runs them (fifteen minutes); test_povray_scene.py runs small ones"
    ),
    r"export PATH=|fusesoc |verilator --cc ": "minutes; tests/rtl/test_manifests.py runs these lines in a clone",
    r"python -m tools.bench seed --quick$": "test_povray_optics.py runs it, and asks for its rows and files",
    r"make bitstream|lippmann board program": "an hour; tests/rtl/boards makes bitstreams; and no board is here",
    r"verilator --binary |lippmann vectors .*(build/bench|stream_cocotb\.py)": "test_foreign_rtl.py runs these lines",
    r"lippmann regress .* mine\.mem": "judges the reader's own design",
    r"lippmann calibrate |lippmann observe check|cp scenes/displays/vga|sed -e 's/\^gap": (
        "minutes of photographs; test_calibration.py runs the same steps on a small panel"
    ),
}


def name_of(page):
    return str(page.relative_to(TOP))


def blocks(page, *languages):
    return [(kind, text) for kind, text in BLOCK.findall(page.read_text()) if kind in languages]


def lines(page):
    """Return the command lines of a page: those of its shell blocks, and indented ones of known programs."""
    shell = [line for _, text in blocks(page, "sh") for line in text.splitlines()]
    indented = INDENTED.findall(BLOCK.sub("", page.read_text()))
    return [line.split(" #")[0].rstrip() for line in shell + indented if line.strip() and line[0] != "#"]


def commands(page):
    return [line for line in lines(page) if line.startswith("lippmann ")]


def runs(line):
    return line.startswith(("lippmann ", "mkdir ", "cc ", *SERVERS, *SAME)) and not any(
        re.match(r, line) for r in NOT_RUN
    )


def anchors(page):
    """Return the anchors of a page's headings, made as forges make them."""
    text = BLOCK.sub("", page.read_text())
    titles = [re.sub(r"[`*\[\]]", "", title) for title in re.findall(r"^#+ (.+)$", text, re.M)]
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    for link in LINK.findall(BLOCK.sub("", page.read_text())):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{link}: no such file"
        assert TOP in target.parents, f"{link} leads out of the repository"
        if anchor:
            assert anchor in anchors(target), f"{link}: no such heading"


def parsed(line):
    """Parse a `lippmann` command; fail the test when it would be refused."""
    words = shlex.split(line)[1:]
    assert words[0] in COMMANDS, line
    top = cli.make_context("lippmann", [words[0]])
    command = cli.get_command(top, words[0])
    try:
        if isinstance(command, click.Group) and words[1] in command.commands:
            command, words = command.commands[words[1]], words[1:]
        command.make_context(words[0], words[1:], parent=top)
    except click.ClickException as error:
        pytest.fail(f"{line}: {error.format_message()}")


@pytest.mark.parametrize("page", [p for p in PAGES if commands(p)], ids=name_of)
def test_commands_parse(page):
    for line in commands(page):
        for part in re.split(r" \| (?=\./|lippmann |python )", line):
            if part.startswith("lippmann "):
                parsed(part)


def test_every_command_is_run_or_has_its_reason():
    every = {line for page in FOLLOWED for line in lines(page)}
    assert len(every) >= 80
    assert not [line for line in every if not runs(line) and not any(re.match(r, line) for r in NOT_RUN)]
    assert not [reason for reason in NOT_RUN if not any(re.match(reason, line) for line in every)], "out of date"
    # One that is run stands in a shell block, which `run_page` reads.
    blocked = {line.split(" #")[0].rstrip() for p in PAGES for _, text in blocks(p, "sh") for line in text.splitlines()}
    assert not [line for line in every if runs(line) and line not in blocked]


def test_what_is_not_run_is_there():
    """Targets, scripts and modules; of commands within the text also the options."""
    targets = re.findall(r"^([a-z-]+):", (TOP / "Makefile").read_text(), re.M)
    for page in PAGES:
        text = page.read_text()
        for target in re.findall(r"^(?:    )?make ([a-z-]+)|`make ([a-z-]+)`", text, re.M):
            assert "".join(target) in targets, f"{name_of(page)}: make {target}"
        for script in re.findall(r"python3? (\S+\.py)", text):
            assert (TOP / script).is_file(), f"{name_of(page)}: {script}"
        # A report names the command that made it, which may have had another name.
        modules = [] if "reports" in page.parts else re.findall(r"python3? -m ((?:lippmann|tools)\.[\w.]+)", text)
        for module in modules:
            assert importlib.util.find_spec(module), f"{name_of(page)}: {module}"
        for line in re.findall(r"`lippmann ([a-z][^`\n]*)`", BLOCK.sub("", text)):
            words = line.split()
            command = cli.get_command(click.Context(cli), words[0])
            assert command, f"{name_of(page)}: lippmann {line}"
            known = {option for p in parameters(command) for option in (*p.opts, *p.secondary_opts)} | {"--help"}
            given = {word.split("=")[0] for word in re.findall(r"--[a-z-]+", line)}
            assert given <= known, f"{name_of(page)}: lippmann {line}"


def is_there(name):
    """Tell whether a dotted name such as `lippmann.fixed.registers.write` stands for something; imports no more."""
    module, _, last = name.rpartition(".")
    with contextlib.suppress(ModuleNotFoundError):
        if importlib.util.find_spec(name):
            return True
    return is_there(module) and hasattr(importlib.import_module(module), last)


def test_each_name_of_the_package_is_there():
    """Dotted names, and names of which a page says the module: "`a` and `b` are in `lippmann.c`"."""
    found = 0
    for page in PAGES:
        if page.name == "CHANGELOG.md":
            continue
        text = " ".join(page.read_text().split())
        for name in re.findall(r"`(lippmann(?:\.[a-zA-Z]\w*)+)`", text):
            assert is_there(name), f"{name_of(page)}: {name}"
        for names, module in re.findall(r"((?:`\w+`(?:, | and )?)+) (?:is|are) in `(lippmann\.[\w.]+)`", text):
            for name in re.findall(r"\w+", names.replace(" and ", " ")):
                assert is_there(f"{module}.{name}"), f"{name_of(page)}: {module} has no {name}"
                found += 1
    assert found >= 7


@pytest.mark.parametrize(("target", "command"), SAME.items())
def test_a_target_is_the_command_that_stands_for_it(target, command):
    # Under another make this one would say which folder it is in.
    words = [*target.split(), "-n", "--no-print-directory"]
    done = subprocess.run(words, check=True, cwd=TOP, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == f".venv/bin/{command}"


def parameters(command):
    below = command.commands.values() if isinstance(command, click.Group) else ()
    return [*command.params, *(p for one in below for p in parameters(one))]


def json_keys(value):
    if isinstance(value, dict):
        return set(value) | {key for item in value.values() for key in json_keys(item)}
    if isinstance(value, list):
        return {key for item in value for key in json_keys(item)}
    return set()


def test_every_json_key_is_documented(tmp_path, capsys):
    display, image = tmp_path / "small.toml", tmp_path / "small.exr"
    display.write_text(small_toml(32, 24))
    film = tmp_path / "film.toml"
    film.write_text(f'scene = "{TOP}/scenes/chart/chart.xml"\nframes = 1\n')
    common = ["--display", str(display), "--json"]
    pages = "\n".join((TOP / f"docs/reference/{name}.md").read_text() for name in ("command-line", "display-file"))
    captured = ("--size", "300", "--samples", "1", "--json", "-o", str(tmp_path / "captured.exr"))
    for arguments in (
        ["inspect", str(display), "--json"],
        ["trace", *common, "--pixels", "9", "-o", str(tmp_path / "rays.npz")],
        ["render", str(TOP / "scenes/chart/chart.xml"), *common, "-o", str(image)],
        ["capture", str(TOP / "scenes/chart/chart.xml"), "--setup", str(TOP / "scenes/setups/plain.toml"), *captured],
        ["observe", str(image), *common, "--eye", "0,0,600", "--width", "8", "-o", str(tmp_path / "view.png")],
        ["animate", str(film), *common, "-o", str(tmp_path / "frames")],
        ["doctor", "--json"],
    ):
        assert run(arguments) == 0
        keys = json_keys(json.loads(capsys.readouterr().out))
        missing = [key for key in keys if f"`{key}`" not in pages]
        assert keys, arguments
        assert not missing, f"{arguments[0]}: {missing} in neither reference page"


#: Panels of more pixels across are cut to a fifth of theirs in each direction for every commit: what the commands do is
#: the same, in a twenty-fifth of the time. The exhaustive tests run the pages with the displays that ship.
WIDE_PX, CUT = 1000, 5
#: Options besides, for every commit, of commands that make many views: what is done is the same for a few.
FEWER = {"lippmann export quilt ": "--columns 3 --rows 2"}


def cut_side(line):
    return f"{line[1]}{int(line[2]) // CUT}"


def reader_folder(folder, whole=True):
    """Make a folder look like the project's top to a reader's commands; not `whole`: with parts of wide panels."""
    if whole:
        for name in ("scenes", "tests"):
            (folder / name).symlink_to(TOP / name)
        return folder
    (folder / "scenes/displays").mkdir(parents=True)
    (folder / "tests").symlink_to(TOP / "tests")
    for path in (TOP / "scenes").iterdir():
        if path.name != "displays":
            (folder / "scenes" / path.name).symlink_to(path)
    for path in (TOP / "scenes/displays").iterdir():
        text = path.read_text()
        if load_display(path).panel.width_px > WIDE_PX:
            text, sides = re.subn(r"^((?:width|height)_px = )(\d+)", cut_side, text, flags=re.M)
            assert sides == 2, path
        (folder / "scenes/displays" / path.name).write_text(text)
    return folder


def called(line, folder, environment, alone):
    """Run a command line in a folder: its exit code and its messages. Most commands run in this process."""
    line = line.split(" #")[0].strip()
    if alone or not line.startswith("lippmann ") or "--background" in line or re.search(r"[|<>&;$*~]", line):
        command = ["/bin/sh", "-c", line]
        done = subprocess.run(command, check=False, cwd=folder, env=environment, capture_output=True, text=True)
        return done.returncode, done.stderr
    desktop = {}
    if line.startswith("lippmann live "):  # on SDL's desktop without a screen, where no user ends it
        desktop, line = {"SDL_VIDEODRIVER": "dummy"}, f"{line} --seconds 0 --samples 4"
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.dict(os.environ, desktop),
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        code = run(shlex.split(line)[1:])
    return code, err.getvalue()


def run_page(page, folder, whole=True):
    """Write a page's files and run its commands, in the page's order; not `whole`: with fewer views."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    servers = []
    try:
        for kind, text in blocks(page, "sh", "toml", "xml", *(["python"] if name_of(page) in PROGRAMS else [])):
            if kind == "python":
                command = [sys.executable, "-W", "error", "-c", text]
                # Without a desktop a window is not shown, which would wait for its user.
                bare = {key: value for key, value in environment.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
                done = subprocess.run(command, check=False, cwd=folder, env=bare, capture_output=True, text=True)
                assert done.returncode == 0, f"{text}\n{done.stderr}"
                continue
            if kind != "sh":
                named = FILE_NAME.match(text)
                if named:
                    (folder / named[1]).write_text(text)
                continue
            for line in filter(runs, text.splitlines()):
                if line.startswith(SERVERS):
                    words = shlex.split(line)
                    with (folder / "server.log").open("ab") as said:
                        servers.append(subprocess.Popen(words, cwd=folder, env=environment, stdout=said, stderr=said))
                    continue
                fewer = [] if whole else [more for start, more in FEWER.items() if line.startswith(start)]
                words = " ".join([SAME.get(line, line), *fewer])
                code, said = called(words, folder, environment, alone=name_of(page) == PROCESSES)
                assert code == 0, f"{line}\n{said}"
    finally:
        for server in servers:
            server.terminate()
        for server in servers:
            server.wait()


RUN = [page for page in FOLLOWED if any(runs(line) for line in lines(page))]


@pytest.mark.parametrize("page", [page for page in RUN if name_of(page) not in SLOW], ids=name_of)
def test_commands_run(page, tmp_path):
    run_page(page, reader_folder(tmp_path, whole=False), whole=False)


@pytest.mark.full
@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_commands_run_as_they_stand(page, tmp_path):
    run_page(page, reader_folder(tmp_path))


#: What the text of a TOML block has, and what reads it; the first that fits.
READERS = [
    (r"^\[depth_picture\]", lambda path: read_as(DepthPictureFile, path)),
    (r"direction_urad", load_bounds),
    (r"\A(# .*\n)?layers = ", lambda path: read_as(LayerFilmFile, path)),
    (r"^\[\[layer\]\]$", lambda path: read_as(LayersFile, path)),
    (r"^\[\[picture\]\]$", lambda path: read_as(PicturesFile, path)),
    (r"\[placement\]", load_placement),
    (r"frames = ", load_film),
    (r"\[object\]", load_setup),
    (r"^\[\w+\]$", load_display),
]


def read_as(form, path):
    return toml.read(form, toml.parse(path.read_text(), "block"), "block")


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "toml")], ids=name_of)
def test_toml_blocks_are_valid(page, tmp_path):
    texts = [text for _, text in blocks(page, "toml")]
    for text in texts:
        reader = next((reader for mark, reader in READERS if re.search(mark, text, re.M)), None)
        (tmp_path / "block.toml").write_text(text)
        if reader is None:  # keys of a table of the page's first block
            name = text.split(" =")[0]
            table = "[panel]\n" if name in Panel.__dataclass_fields__ else "[array]\n"
            others = re.sub(rf"^{name} =.*\n", "", texts[0], flags=re.M)
            (tmp_path / "block.toml").write_text(others.replace(table, table + text))
        (reader or load_display)(tmp_path / "block.toml")


EXAMPLES = {"docs/reference/python.md": "view.png", "docs/reference/mitsuba-sensor.md": "ball.exr"}


@pytest.mark.parametrize(
    ("page", "made", "whole"),
    [
        *((*row, False) for row in EXAMPLES.items()),
        *(
            pytest.param(*row, True, marks=pytest.mark.full)
            for row in (*EXAMPLES.items(), ("docs/how-to/layers.md", "fish.png"))
        ),
    ],
)
def test_python_examples_run(tmp_path, page, made, whole):
    """The page's blocks are one program, run in a process of its own beside the page's files."""
    run_page(TOP / page, reader_folder(tmp_path, whole), whole)
    code = "\n".join(text for _, text in blocks(TOP / page, "python"))
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / made).is_file()


def test_table_of_models_is_current():
    path = TOP / "docs/pictures/make_pictures.py"
    spec = importlib.util.spec_from_file_location("make_pictures", path)
    make_pictures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_pictures)
    assert make_pictures.models_table() in (TOP / "docs/models.md").read_text(), "run make pictures"


def test_pictures_are_small():
    sizes = {p.name: p.stat().st_size for p in (TOP / "docs/pictures").iterdir() if p.suffix in (".png", ".gif")}
    assert sum(sizes.values()) < 2_500_000, sizes
    assert sizes["sweep.gif"] <= 900_000


def test_promises_that_are_not_kept_are_told():
    """Each configuration and display of the error report that is above its promise, with its worst figure."""
    with (TOP / "docs/generated/reports/fixed-point-error.csv").open() as stream:
        every = list(csv.DictReader(line for line in stream if line[0] != "#"))
    rows = [row for row in every if row["kept"] == "False"]
    assert every
    assert {row["kept"] for row in every} <= {"True", "False", ""}
    told = (TOP / "docs/reference/rtl.md").read_text().split("## What differs from golden")[1].split("\n## ")[0]
    for key in {(row["configuration"], row["display"]) for row in rows}:
        worst = max(float(r["max_weighted_urad"]) for r in rows if (r["configuration"], r["display"]) == key)
        assert all(f"`{name}`" in told for name in key)
        assert f"{worst:.2f} microradian, weighted" in told


def test_twin_and_rtl_state_the_same_formulas():
    """Every rounding as an integer formula, word for word in both."""
    modules = [ast.parse(path.read_text()) for path in (TOP / "host/lippmann/fixed").glob("*.py")]
    functions = [node for module in modules for node in module.body if isinstance(node, ast.FunctionDef)]
    twins = {function.name: ast.get_docstring(function, clean=False) for function in functions}
    found = 0
    for source in (TOP / "rtl").glob("*/*.sv"):
        name = source.stem.removeprefix(PREFIX)
        formulas = re.findall(r"^/// {3}(\S+ += .* >> .*)$", source.read_text(), re.M)
        if formulas and name in twins:
            assert "round(" not in "".join(formulas)
            assert [f for f in formulas if f"        {f}\n" not in twins[name]] == [], source.stem
            found += 1
    assert found >= 10


@pytest.mark.parametrize("module", ["aim", "fifo", "optics_block", "raster", "ray_stream"])
def test_ports_carry_their_meaning(module):
    """A comment behind each; or behind the one before, of a pair or a triple; clock, handshake and bus say enough."""
    (source,) = (TOP / "rtl").glob(f"*/{PREFIX}{module}.sv")
    text = source.read_text()
    ports = re.findall(r"^  (?:in|out)put .*?(\w+_n?[io]),?( +// .+)?$", text, re.M)
    assert len(ports) >= 7
    for (_, before), (name, said) in itertools.pairwise(ports):
        evident = re.match(r"rst_ni|(\w+_)?(valid|ready|data)_", name)
        assert said or before or evident or re.match(r"exit_d?z_o", name), name
