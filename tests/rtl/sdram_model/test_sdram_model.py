"""The model of the SDRAM against command sequences: it names what the data sheet does not allow, and nothing else."""

import subprocess
from pathlib import Path

import pytest
from lippmann.simulation.compilation import cached_file
from runner import BUILD, TOP

MAIN = Path(__file__).with_name("main.cpp")
MODEL = TOP / "sim" / "board" / "sdram.h"

#: Each case is named after the rule that it breaks, alone; what follows a colon may be a remark.
RULES = [
    "tCK", "tRCD", "tRP", "tRAS min", "tRAS max", "tRC", "tRFC", "tRRD", "tWR", "tMRD", "CAS latency",
    "power-up 100 us", "before initialisation", "initialisation: AUTO REFRESH before PRECHARGE ALL",
    "initialisation: LOAD MODE REGISTER before PRECHARGE ALL", "initialisation: fewer than 2 AUTO REFRESH",
    "refresh interval", "ACTIVE to an open bank", "READ of a closed bank", "WRITE to a closed bank",
    "AUTO REFRESH with an open row", "LOAD MODE REGISTER with an open row", "DQ contention", "DQ not driven",
    "address out of range", "auto precharge: not modelled", "burst longer than 1: not modelled",
    "mode register: reserved bits", "BURST TERMINATE: not modelled", "SELF REFRESH: not modelled",
]  # fmt: skip
REMARKS = {
    "tCK: latency 2", "tRCD: write", "tRP: refresh", "tRP: mode", "tRFC: refresh", "power-up 100 us: after CKE was low",
    "before initialisation: after CKE was low", "refresh interval: every 7.83 us",
    "DQ contention: while the chip lets go",
}  # fmt: skip
LEGAL = {"legal", "legal: refreshes every 7.8 us", "legal: 8192 refreshes at once, every 63.9 ms"}


def build(program: Path) -> None:
    subprocess.run(["g++", "-std=gnu++17", "-O1", "-Wall", "-Wextra", "-Werror", MAIN, "-o", program], check=True)


@pytest.fixture(scope="module")
def model():
    program = cached_file(BUILD / "sdram-model", [MAIN, MODEL], build)
    return lambda *words: subprocess.run([program, *words], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("case", sorted(LEGAL))
def test_what_is_allowed_is_not_reported(model, case):
    assert model(case) == ""


@pytest.mark.parametrize("case", [*RULES, *sorted(REMARKS)])
def test_a_planted_violation_is_named(model, case):
    rule = case.rpartition(":")[0] if case in REMARKS else case
    wanted = {rule}
    if case == "initialisation: LOAD MODE REGISTER before PRECHARGE ALL":
        wanted.add("initialisation: fewer than 2 AUTO REFRESH")
    assert set(model(case).splitlines()) == wanted


def test_every_rule_has_its_case(model):
    assert set(model().splitlines()) == {*RULES, *REMARKS, *LEGAL}
    # The names in the model, those that are put together there spelled out here.
    text = MODEL.read_text()
    assert all(f'"{rule}"' in text for rule in RULES)
    assert text.count("report(") + text.count('idle("') >= len(RULES)
