// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Implements `lipp_ring` (a delay of 2 to 17 clocks) in the distributed memory of ECP5.
///
/// Ports and behaviour are those of rtl/common/lipp_ring.sv. A word is read Cycles - 1 clocks after
/// it was written, and the output register adds one clock. The read address is derived from the
/// write address, so the initial address does not matter after one clock. Synthesis keeps the
/// module's hierarchy, because merged rings would share one address counter.
(* keep_hierarchy *)
module lipp_ring #(
  parameter int Width = 1,
  parameter int Cycles = 4
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  // An entry is read in the clock in which it is overwritten, so 16 entries delay up to 16 clocks.
  localparam int PlaceBits = Cycles > 2 ? $clog2(Cycles - 1) : 1;
  localparam int Places = 1 << PlaceBits;

  if (Width < 1 || Cycles < 2 || Cycles > 17) begin : gen_illegal
    $fatal(1, "lipp_ring: Width must be 1 or more and Cycles 2 to 17");
  end

  (* ram_style = "distributed" *) logic [Width-1:0] places[Places];
  // Some simulators start a register without reset or initial value as unknown.
  /* verilator lint_off PROCASSINIT */
  logic [PlaceBits-1:0] write_at_q = '0;
  /* verilator lint_on PROCASSINIT */
  logic [PlaceBits-1:0] read_at_q;

  always_ff @(posedge clk_i) write_at_q <= write_at_q + 1'b1;
  always_ff @(posedge clk_i) read_at_q <= write_at_q - PlaceBits'(Cycles - 2);
  always_ff @(posedge clk_i) places[write_at_q] <= d_i;
  always_ff @(posedge clk_i) q_o <= places[read_at_q];

endmodule

`default_nettype wire
