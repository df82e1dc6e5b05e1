"""The layers of the package, which `make lint` checks."""

import shutil
import subprocess
import sys
from pathlib import Path

from lippmann.simulation.toolchain import repository

TOP = repository()


def linted(top):
    """What lint-imports says of a folder, as `make lint` calls it."""
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-logo", "--no-cache"]
    done = subprocess.run(command, cwd=top, env={"PYTHONPATH": str(top / "host")}, capture_output=True, text=True,
                          check=False)  # fmt: skip
    return done.returncode, done.stdout


def test_an_import_that_runs_upward_fails(tmp_path):
    shutil.copytree(TOP / "host", tmp_path / "host", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    shutil.copy(TOP / "pyproject.toml", tmp_path)
    assert "lippmann.optics.rays -> lippmann.cli" not in linted(tmp_path)[1]
    rays = tmp_path / "host/lippmann/optics/rays.py"
    rays.write_text(f"{rays.read_text()}\n\ndef late():\n    import lippmann.cli\n")
    code, said = linted(tmp_path)
    assert code == 1
    assert "lippmann.optics is not allowed to import lippmann.cli" in said
    assert "lippmann.optics.rays -> lippmann.cli" in said


def test_make_lint_checks_the_layers():
    makefile = (TOP / "Makefile").read_text()
    recipes = {name: makefile.split(f"\n{name}:")[1].split("\n\n")[0] for name in ("lint", "lint-imports")}
    assert "lint-imports" in recipes["lint"]
    assert "$(BIN)/lint-imports" in recipes["lint-imports"]
