"""The one pipeline, as a trace of calls from the command to the pixels; and the package's layers."""

import shutil
import subprocess
import sys
from pathlib import Path

import lippmann
import pytest
from lippmann.cli import run
from lippmann.simulation.toolchain import repository
from scene_cases import display_toml, focused_display
from test_film import SCENE

ROOT = Path(lippmann.__file__).parent
#: Files of these rooms count, and files that stand at the top: all others serve many callers.
COUNTED = ("api.py", "cli/", "rendering/")
#: What makes pixels: the programs of samples, and the filter that adds them.
PIXEL_MAKERS = {"rendering/shading.py", "rendering/pixel_filter.py"}


def file_runs(frame):
    """Return the files of the package in a call stack, outermost first, each as often as the stack comes back to it."""
    files = []
    while frame is not None:
        code = frame.f_code.co_filename
        # A module that is imported is no step of the pipeline.
        if code.startswith(str(ROOT)) and frame.f_code.co_name != "<module>":
            name = str(Path(code).relative_to(ROOT))
            if not files or files[-1] != name:
                files.append(name)
        frame = frame.f_back
    return tuple(reversed(files))


def trace_calls(words):
    """Run a command; return its exit code and the distinct stacks, as files, in which a function was called."""
    stacks = set()

    def called(frame, event, argument):
        if event == "call" and frame.f_code.co_filename.startswith(str(ROOT)):
            stacks.add(file_runs(frame))

    sys.setprofile(called)
    try:
        code = run(words)
    finally:
        sys.setprofile(None)
    return code, stacks


@pytest.mark.parametrize(("shading", "max_files"), [("each", 11), ("shared", 12)])
def test_a_render_passes_few_files_and_each_once(tmp_path, monkeypatch, mi, capfd, shading, max_files):
    """At most 12 files lie between the command and the pixels, and each is entered once.

    Of the call stack at each call of a function of `host/lippmann`, neighbouring frames of one file count as one. No
    file of `api.py`, `cli/` and `rendering/` may occur twice in a stack. (The loops of `optics/backend.py` call
    functions of the file that asks for the loop; they alone may.) Counted are these files in all stacks that lead from
    the renderer to `PIXEL_MAKERS`, without the trial view that only warns (`rendering/diagnostics.py`). Shared light
    has one more than 11, its lattices.
    """
    monkeypatch.chdir(tmp_path)
    (tmp_path / "three.xml").write_text(SCENE)
    (tmp_path / "small.toml").write_text(display_toml(focused_display("square", width_px=60, height_px=40)))
    words = ["render", "three.xml", "--display", "small.toml", "-o", "a.exr", "--device", "llvm", "--shading", shading]
    code, stacks = trace_calls(words)
    assert code == 0, capfd.readouterr().err
    ours = {tuple(name for name in stack if name.startswith(COUNTED)) for stack in stacks}
    assert not {stack for stack in ours if len(set(stack)) < len(stack)}
    others = {tuple(name for name in stack if not name.startswith("optics/")) for stack in stacks}
    assert not {stack for stack in others if len(set(stack)) < len(stack)}
    to_pixels = [s for s in ours if "rendering/renderer.py" in s and PIXEL_MAKERS & set(s)]
    files = {name for stack in to_pixels if "rendering/diagnostics.py" not in stack for name in stack}
    assert {"cli/render.py", "rendering/executors.py", "rendering/sampling.py", "rendering/lights.py"} <= files
    assert len(files) <= max_files, sorted(files)


def test_an_import_that_runs_upward_fails(tmp_path):
    shutil.copytree(
        repository() / "host", tmp_path / "host", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info")
    )
    shutil.copy(repository() / "pyproject.toml", tmp_path)
    rays = tmp_path / "host/lippmann/optics/rays.py"
    rays.write_text(f"{rays.read_text()}\n\ndef late():\n    import lippmann.cli\n")
    # As `make lint` calls it.
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-logo", "--no-cache"]
    done = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path / "host")}, capture_output=True,
                          text=True, check=False)  # fmt: skip
    assert done.returncode == 1
    assert "lippmann.optics is not allowed to import lippmann.cli" in done.stdout
    assert "lippmann.optics.rays -> lippmann.cli" in done.stdout
