// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Delays a word by 2 or more clocks in a ring of Cycles - 1 entries: q(t) = d(t - Cycles).
///
/// In each clock one entry is read and then overwritten, so a word is read when the address has
/// passed all entries of the ring once. The output register adds one clock to the delay. The
/// initial address does not matter after one pass through the ring. Synthesis for an FPGA family
/// may replace this module by the family's memory cells (rtl/ecp5/). Synthesis keeps the module's
/// hierarchy, because merged rings of the same length would share one address counter.
(* keep_hierarchy *)
module lipp_ring #(
  parameter int Width = 1,
  parameter int Cycles = 4
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  if (Width < 1 || Cycles < 2) begin : gen_illegal
    $fatal(1, "lipp_ring: Width must be 1 or more and Cycles 2 or more");
  end

  // The array's size is a power of two, so that a simulator need not check the address range.
  localparam int PlaceBits = Cycles > 3 ? $clog2(Cycles - 1) : 1;
  localparam logic [PlaceBits-1:0] Last = PlaceBits'(Cycles - 2);

  logic [Width-1:0] places[1 << PlaceBits];
  // Some simulators start a register without reset or initial value as unknown.
  /* verilator lint_off PROCASSINIT */
  logic [PlaceBits-1:0] at_q = '0;
  /* verilator lint_on PROCASSINIT */

  always_ff @(posedge clk_i) begin
    at_q <= at_q == Last ? '0 : at_q + 1'b1;
    places[at_q] <= d_i;
    q_o <= places[at_q];
  end

endmodule

`default_nettype wire
