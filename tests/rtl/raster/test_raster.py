"""raster, against its twin."""

import subprocess

import pytest
from lippmann.sim.tools import optics_sources, repository, verilator_environment
from runner import compiled, seed, simulate


def lint(top, *options):
    """What Verilator says of a top: its exit status and its messages."""
    command = ["verilator", "--lint-only", "--quiet-stats", "--top-module", top, *options]
    sources = map(str, optics_sources(repository()))
    run = subprocess.run([*command, *sources], env=verilator_environment(), capture_output=True, text=True, check=False)
    return run.returncode, run.stdout + run.stderr


@pytest.mark.parametrize("f", [14, 23])
def test_raster_equals_the_twin(f):
    folder = compiled("raster", {"F": f})
    simulate(folder, "raster", "raster_frames", seed(), {"RASTER_F": str(f)})


@pytest.mark.full
def test_raster_with_the_most_samples():
    folder = compiled("raster", {"F": 23})
    simulate(folder, "raster", "raster_frames", seed(), {"RASTER_F": "23", "RASTER_LONG": "1"})


@pytest.mark.parametrize("f", [13, 24])
def test_illegal_fraction_bits_stop_elaboration(f):
    status, messages = lint("raster", "-Wno-lint", f"-GF={f}")
    assert status != 0
    assert "raster: F must be 14 to 23" in messages
