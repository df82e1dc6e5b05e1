"""The proofs of sim/formal hold, their covers are reached, and a broken design fails each of them."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from lippmann.simulation.toolchain import PREFIX
from tools.formal import run_proof, tasks

TOP = Path(__file__).resolve().parents[2]
FORMAL = TOP / "sim" / "formal"
TOOLS = Path(sys.executable).parent

# The proofs and covers of each .sby file.
BOTH = ("prove", "cover")
LATENCIES = (1, 44, 65, 173, 244, 292, 461)
TASKS = {
    "async_fifo": BOTH,
    "axil_to_apb": BOTH,
    "dispatcher": ("prove", "prove_scene", "cover"),
    "draw_frame": ("prove_1", "prove_2", "prove_4", "cover_1"),
    "fifo": ("prove_4", "prove_128", "prove_256", "cover_8"),
    "memory_1w1r": BOTH,
    "flow_control": (*(f"prove{order}_{n}" for order in ("", "_order") for n in LATENCIES), "cover_3", "full_3"),
    **dict.fromkeys(("frame_gate", "pulse_sync", "ray_stream", "sdram_arbiter", "wishbone_to_apb"), BOTH),
}
PROOFS = [f"{name} {task}" for name, tasks in TASKS.items() for task in tasks]

# A fault put into the RTL, and the assertion that it must break from reset on (no induction: a trace of the fault).
# By proof and file: (text, its replacement, assertions of which one must fail)
DESIGN_FAULTS = {
    ("async_fifo bmc", "async_fifo.sv"): {
        "binary count brought over": ("read_after ^ (read_after >> 1)", "read_after", "one_bit|gray"),
        "word written while there is no place": ("C'(3) << (AddressBits - 1)", "C'(1) << (AddressBits - 1)",
            "room|inside"),
        "word read while there is none": ("read = read_gray_q != written_gray && ", "read = ", "room|inside|in_order"),
    },
    ("axil_to_apb bmc", "axil_to_apb.sv"): {
        "an answer is withdrawn before it is taken": ("|| (s_axil_bvalid && !s_axil_bready)", "",
            "write_answered|b_stable"),
        "a write begins without its data": ("write_may = aw_q && w_q && ", "write_may = aw_q && ", "write_asked"),
        "a read is done twice": ("s_axil_arready)) && !start_read;", "s_axil_arready));", "read_asked|places"),
        "an answer takes the place of the one before it": (" && (!s_axil_rvalid || s_axil_rready)", "",
            "room|r_stable"),
        "a write waits as long as reads come": ("!(read_may && m_apb_pwrite)", "!read_may", "turns|begins"),
        "the access changes as the next address comes": ("if (start_write || start_read) begin\n      m_apb_paddr",
            "begin\n      m_apb_paddr", "apb_access"),
    },
    ("wishbone_to_apb bmc", "wishbone_to_apb.sv"): {
        "a cycle is done twice": ("!m_apb_psel && !s_wb_ack && !s_wb_err", "!m_apb_psel", "begins|one_clock"),
        "a cycle given up is answered": ("{2{request}} & {ack_q, err_q}", "{ack_q, err_q}", "answered"),
    },
    ("dispatcher bmc", "ray_access.sv"): {
        "the bus is asked once and no more": (
            "if (on_bus) bus_pending_q <= !heard;", "if (on_bus) bus_pending_q <= 1'b1;",
            "answered|todo|bus|asked"),
        "an abort waits for rays for ever": ("heard && !(occupied || running || busy)", "heard && occupied",
            "few_looks|polls"),
    },
    ("dispatcher bmc", "dispatcher.sv"): {
        "a reply waits for words that it does not have": ("words_q == '0 ? Receive : Words;", "Words;",
            "answered|todo|reply|words"),
    },
    ("dispatcher bmc", "request_reader.sv"): {
        "a request is not read while the reply to the one before it is sent": ("if (next_i) state_q <= Kind;",
            "if (next_i && 1'b0) state_q <= Kind;", "answered|todo|one_at_a_time|unsent"),
    },
    ("dispatcher bmc_scene", "ray_access.sv"): {
        "an abort waits while the scene is drawn": (
            "if (drawn_i && op_i != OpResult) begin\n            done_o <= 1'b1;",
            "if (drawn_i && op_i != OpResult) begin\n            done_o <= op_i != OpAbort;", "answered|todo|part"),
    },
    ("draw_frame bmc_1", "pixel_feed.sv"): {
        "a late pixel is shown at the next one's place": ("assign drop = !draws_q || late_q != '0;",
            "assign drop = !draws_q;", "pixel_in_place|late"),
        "a late frame goes on in the next one": ("assign drop = !draws_q || late_q", "assign drop = late_q",
            "pixel_in_place|late|whole"),
        "a black pixel is not counted": ("want_i && shown_i && !hit_o", "want_i && draws_q && !hit_o",
            "in_time_or_counted"),
    },
    ("draw_frame bmc_1", "draw_frame.sv"): {
        "registers are taken while they are written": ("begin_i && complete && !hold_i", "begin_i && complete",
            "taken_between|one_set"),
        "registers are taken within a late frame": ("begin_i && complete && !hold_i", "begin_i && !hold_i",
            "taken_between|one_set"),
        "a row has a ray too few": ("PanelBits'(Width - 1)", "PanelBits'(Width - 2)", "rays|walk|place"),
    },
    ("fifo bmc_8", "fifo.sv"): {
        "read pointer stands still": ("read_at_q + 1'b1", "read_at_q", "in_order|memory"),
        "word asked for without a place": ("level_d < 3'd4", "level_d < 3'd5", "held|flags"),
        "write pointer stands still": ("write_at_q + AddressBits'(write_i)", "write_at_q", "in_order|memory"),
        "output moves on during a stall": ("assign take = valid_o && ready_i", "assign take = valid_o",
            "stable|held|count"),
        "word asked for while none is stored": ("some_q && free_q", "free_q", "four_clocks|count|flags"),
    },
    ("memory_1w1r bmc", "memory_1w1r.sv"): {
        "memory answers a clock early": ("read_data_o <= word_q", "read_data_o <= words[read_at_i]", "as_written"),
    },
    ("flow_control bmc_full", "flow_control.sv"): {
        "no credit: rays enter while there is no room": (
            "reserved_q < (AddressBits + 1)'(Room - 2) && !hold_i", "!hold_i",
            "room|promise|open"),
        "one place too many given away": ("(AddressBits + 1)'(Room - 2)", "(AddressBits + 1)'(Room - 1)",
            "room|promise|open"),
    },
    ("flow_control bmc", "flow_control.sv"): {
        "idle before the last ray has left": ("idle_o <= reserved_q == '0 && !entered",
            "idle_o <= gen_marks[0].valid_q == '0", "idle"),
        "a ray that leaves frees no place": (" - (AddressBits + 1)'(departed_q[1])", "", "taken|idle|open|places"),
        "mark comes out a clock late": ("assign enter = accept;", "assign enter = accept && ready_o && valid_q == '0;",
            "places|entered|in_order|counted|latency|waiting"),
        "hold ignored": ("(Room - 2) && !hold_i", "(Room - 2)", "hold"),
        "idle while a ray enters": ("!entered && !accept", "!entered", "idle"),
    },
    ("flow_control bmc_65", "flow_control.sv"): {
        "marks a clock early behind stage 64": ("gen_marks[k-1].valid_q[63]", "gen_marks[k-1].valid_q[62]",
            "places|entered|counted|latency|waiting"),
    },
    ("flow_control bmc_order", "flow_control.sv"): {
        "ray stored a clock early": ("valid_q[(Held-1)%64]", "valid_q[(Held-2)%64]", "in_order|waiting|watch"),
    },
    ("frame_gate bmc", "frame_gate.sv"): {
        "optics change within a frame": ("apply_waits_o && !within_d && !take_o", "apply_waits_o && !take_o",
            "between"),
        "change decided a clock too late": ("apply_waits_o && !within_d", "apply_waits_o && !within_q",
            "between|answered"),
        "input open during a change": ("raster_valid_i) && !take_o", "raster_valid_i)", "passed_on|closed"),
        "request of a change forgotten": ("apply_i || (apply_waits_o && !take_o)", "apply_i", "waits|answered"),
        "request during a change forgotten": ("apply_i || (apply_waits_o && !take_o)",
            "(apply_i || apply_waits_o) && !take_o", "waits|answered"),
        "start forgotten while the raster runs": ("start_i || (start_waits_o && !begin_o && !abort_i)", "start_i",
            "waits|begins"),
        "source changes as soon as it is written": ("if (take_o) stream_o", "stream_o", "changes"),
        "frame begins before the change that it waits for": ("apply_waits_o && !within_d",
            "apply_waits_o && !start_waits_o && !within_d", "in_time|answered|time"),
    },
    ("pulse_sync bmc", "pulse_sync.sv"): {
        "pulse accepted while one is on its way": ("from_pulse_i && !from_busy_o", "from_pulse_i",
            "one_for_one|way|late"),
    },
    ("ray_stream bmc", "config_bank.sv"): {
        "copy taken while rays are on the way": ("pending_q && idle_i && !copy_q", "pending_q && !copy_q",
            "copy_idle|only_idle|one_configuration"),
        "request forgotten": ("apply_i || (pending_q && !copy_q)", "pending_q && !copy_q", "steady|taken_over"),
        "no copy after reset": ("pending_q <= 1'b1;", "pending_q <= 1'b0;", "steady|taken_over"),
    },
    ("sdram_arbiter bmc", "sdram_arbiter.sv"): {
        "show waits as long as write has transactions": ("!(show_served_q && write_valid_i)", "!write_valid_i", "show"),
        "write waits as long as show has transactions": (
            "show_valid_i && !(show_served_q && write_valid_i)", "show_valid_i",
            "write"),
        "a transaction is taken from two clients": ("ready_i && !show_o && !write_o", "ready_i && !show_o",
            "one|in_order"),
        "a transaction is done for another client": ("write_o ? write_i : read_i", "read_valid_i ? read_i : write_i",
            "whose"),
        "the last turn is forgotten": ("show_served_q <= show_o;", "show_served_q <= 1'b1;", "show"),
    },
}  # fmt: skip
FAULTS = {name: (*where, *fault) for where, faults in DESIGN_FAULTS.items() for name, fault in faults.items()}

# For every commit: the first of each proof that takes no long search.
FIRST = {fault[0]: name for name, fault in reversed(FAULTS.items())}
QUICK = {name for proof, name in FIRST.items() if proof not in ("dispatcher bmc_scene", "flow_control bmc_65")}


def sby(folder: Path, name: str, task: str) -> tuple[str, str]:
    """Run one task of a .sby file in folder/sim/formal; give its verdict and what it wrote."""
    return run_proof(folder / "sim" / "formal", name, task, folder / "out" / f"{name}_{task}")


def checkout(folder: Path) -> Path:
    """Copy what the proofs read."""
    for name in ("formal", "checks"):
        shutil.copytree(TOP / "sim" / name, folder / "sim" / name)
    shutil.copytree(TOP / "rtl", folder / "rtl")
    return folder


def labels(folder: Path, word: str) -> set[str]:
    """The names of all statements of one kind in the design that yosys made of a task."""
    text = (folder / "model" / "design_smt2.smt2").read_text()
    return set(re.findall(rf"; yosys-smt2-{word} \d+ (\S+)", text))


# Long covers, whose assumptions a broken design shows to have runs; the dispatcher of a board without a scene;
# latencies of which 1 and 65 have each part; sizes between the least and the most; and the proof that is a page's
# command, which is run as it stands there.
LONG = {
    "async_fifo cover",
    "dispatcher prove",
    "dispatcher cover",
    "draw_frame prove_2",
    "fifo prove_4",
    "fifo prove_128",
    *(f"flow_control prove{order}_{n}" for order in ("", "_order") for n in LATENCIES if n not in (1, 65)),
}


@pytest.mark.parametrize("proof", [pytest.param(p, marks=pytest.mark.full) if p in LONG else p for p in PROOFS])
def test_proof(proof: str, tmp_path: Path) -> None:
    name, task = proof.split()
    verdict, log = sby(checkout(tmp_path), name, task)
    assert verdict == "PASS", log
    if task.startswith("prove"):
        assert "successful proof by k-induction" in log
        assert len(labels(tmp_path / "out" / f"{name}_{task}", "assert")) >= 3  # it had something to prove
    else:
        reached = set(re.findall(r"Reached cover statement in step \d+ at \S+: (\S+)", log))
        there = labels(tmp_path / "out" / f"{name}_{task}", "cover")
        assert reached == there
        assert len(there) >= 2


@pytest.mark.parametrize("fault", [f if f in QUICK else pytest.param(f, marks=pytest.mark.full) for f in FAULTS])
def test_a_broken_design_fails(fault: str, tmp_path: Path) -> None:
    proof, file, text, replacement, broken = FAULTS[fault]
    (path,) = (path for path in (checkout(tmp_path) / "rtl").rglob(PREFIX + file) if path.parent.name != "ecp5")
    source = path.read_text()
    assert source.count(text) == 1, f"{file} has changed: give this fault its new text"
    path.write_text(source.replace(text, replacement))
    verdict, log = sby(tmp_path, *proof.split())
    assert verdict == "FAIL", log
    failed = re.findall(r"failed assertion (.+?) at ", log)
    assert failed
    assert any(re.search(broken, name) for name in failed), failed


def test_every_task_is_run() -> None:
    there = {f"{name} {task}" for name, found in tasks(FORMAL).items() for task in found}
    assert there == {*PROOFS, *(fault[0] for fault in FAULTS.values())}


def test_the_documented_command_runs_anywhere_and_leaves_nothing(tmp_path: Path) -> None:
    page = (TOP / "docs/developers/formal.md").read_text()
    (command,) = re.findall(r"^```sh\n(python -m .*)\n```$", page, re.MULTILINE)

    def untracked() -> str:
        status = ["git", "-C", str(TOP), "status", "--porcelain", "--untracked-files=all"]
        return subprocess.run(status, capture_output=True, text=True, check=True).stdout

    before = untracked()
    ours = {**os.environ, "PATH": f"{TOOLS}{os.pathsep}{os.environ['PATH']}"}
    run = subprocess.run(shlex.split(command), cwd=tmp_path, env=ours, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "fifo prove_4: PASS" in run.stderr
    assert untracked() == before
    assert not list(tmp_path.iterdir())
    command = [*shlex.split(command)[:-1], "prove_9"]
    wrong = subprocess.run(command, cwd=tmp_path, env=ours, capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("lippmann: sim/formal/fifo.sby has no task 'prove_9'; choose from prove_4, ")
