// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// `lipp_ring` in ECP5's distributed memory, for 2 to 17 cycles.
///
/// Ports and behaviour are those of rtl/common/lipp_ring.sv. A word is read Cycles - 1 clocks after
/// it was written, and the output register adds one clock. The read address is derived from the
/// write address, so the initial address does not matter after one clock. The hierarchy is kept in
/// synthesis, because merged rings would share their counters.
(* keep_hierarchy *)
module lipp_ring #(
  parameter int Width = 1,
  parameter int Cycles = 4
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  // Each entry is read before it is written, so with 16 entries a word may wait 16 clocks.
  localparam int PlaceBits = Cycles > 2 ? $clog2(Cycles - 1) : 1;
  localparam int Places = 1 << PlaceBits;

  if (Width < 1 || Cycles < 2 || Cycles > 17) begin : gen_illegal
    $fatal(1, "lipp_ring: Width must be 1 or more and Cycles 2 to 17");
  end

  (* ram_style = "distributed" *) logic [Width-1:0] places[Places];
  logic [PlaceBits-1:0] write_at_q, read_at_q;
  initial write_at_q = '0;  // needed by simulators that start with unknown register values

  always_ff @(posedge clk_i) write_at_q <= write_at_q + 1'b1;
  always_ff @(posedge clk_i) read_at_q <= write_at_q - PlaceBits'(Cycles - 2);
  always_ff @(posedge clk_i) places[write_at_q] <= d_i;
  always_ff @(posedge clk_i) q_o <= places[read_at_q];

endmodule

`default_nettype wire
