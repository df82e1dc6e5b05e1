// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Implements `lipp_block_ring` (a delay of 5 or more clocks) in the block memory of ECP5.
///
/// Ports and behaviour are those of rtl/common/lipp_block_ring.sv. A word is read Cycles - 3 clocks
/// after it was written. The memory has a latency of two clocks, and an output register adds one
/// clock. No address is read and written in the same clock. The read address is derived from the
/// write address, so the initial address does not matter after one clock. Synthesis keeps the
/// module's hierarchy, because merged rings would share one address counter.
(* keep_hierarchy *)
module lipp_block_ring #(
  parameter int Width = 1,
  parameter int Cycles = 5
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  // PlaceBits is at least 3, so that elaboration reaches the error message for an illegal Cycles.
  localparam int PlaceBits = Cycles > 8 ? $clog2(Cycles) : 3;

  if (Width < 1 || Cycles < 5) begin : gen_illegal
    $fatal(1, "lipp_block_ring: Width must be 1 or more and Cycles 5 or more");
  end

  // Some simulators start a register without reset or initial value as unknown.
  /* verilator lint_off PROCASSINIT */
  logic [PlaceBits-1:0] write_at_q = '0;
  /* verilator lint_on PROCASSINIT */
  logic [PlaceBits-1:0] read_at_q;
  always_ff @(posedge clk_i) write_at_q <= write_at_q + 1'b1;
  always_ff @(posedge clk_i) read_at_q <= write_at_q - PlaceBits'(Cycles - 4);

  logic [Width-1:0] word;
  always_ff @(posedge clk_i) q_o <= word;
  lipp_memory_1w1r #(.Width(Width), .AddressBits(PlaceBits)) i_memory (
    .clk_i, .write_i(1'b1), .write_at_i(write_at_q), .write_data_i(d_i),
    .read_at_i(read_at_q), .read_data_o(word)
  );

endmodule

`default_nettype wire
