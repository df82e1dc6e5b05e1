"""The layers of the package, which `make lint` checks."""

import shutil
import subprocess
import sys
from pathlib import Path

from lippmann.simulation.toolchain import repository

TOP = repository()


def test_an_import_that_runs_upward_fails(tmp_path):
    shutil.copytree(TOP / "host", tmp_path / "host", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    shutil.copy(TOP / "pyproject.toml", tmp_path)
    rays = tmp_path / "host/lippmann/optics/rays.py"
    rays.write_text(f"{rays.read_text()}\n\ndef late():\n    import lippmann.cli\n")
    # As `make lint` calls it.
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-logo", "--no-cache"]
    done = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path / "host")}, capture_output=True,
                          text=True, check=False)  # fmt: skip
    assert done.returncode == 1
    assert "lippmann.optics is not allowed to import lippmann.cli" in done.stdout
    assert "lippmann.optics.rays -> lippmann.cli" in done.stdout
