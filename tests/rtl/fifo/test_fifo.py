"""fifo: order, contract and throughput, under every pair of pauses."""

import re

import pytest
from lippmann.simulation.toolchain import PREFIX
from runner import CHECKS, compiled, run_cocotb, simulate
from tools.lint import folder_of_modules


@pytest.mark.parametrize(
    ("width", "bits"), [(36, 4), *(pytest.param(*p, marks=pytest.mark.full) for p in ((1, 3), (150, 5), (70, 9)))]
)
def test_fifo(width, bits):
    run_cocotb("fifo", {"Width": width, "AddressBits": bits})


def test_the_assertions_of_sim_checks_run_in_simulation():
    """A full fifo is legal; a word more is the writer's fault, which only fifo_checks tells."""
    program = compiled("fifo", {"Width": 36, "AddressBits": 4})
    simulate(program, "fifo", "cocotb_overfill", 1, plusargs={"AddressBits": 4, "more": 0})
    with pytest.raises(AssertionError, match=r"Assertion failed in \S+promise"):
        simulate(program, "fifo", "cocotb_overfill", 1, plusargs={"AddressBits": 4, "more": 1})


def test_each_file_of_sim_checks_is_bound_to_its_module():
    files = sorted(CHECKS.iterdir())
    assert len(files) >= 5
    for path in files:
        module = path.stem.removesuffix("_checks")
        assert module.removeprefix(PREFIX) in folder_of_modules()
        assert re.search(rf"^bind {module} {module}_checks .*i_checks \(", path.read_text(), re.M | re.S), path.name
