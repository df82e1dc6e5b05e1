// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Delays a word by 5 or more clocks: q(t) = d(t - Cycles). Use this module for long delays.
///
/// lipp_block_ring behaves like `lipp_ring`. lipp_ring is a separate module, so that synthesis for
/// an FPGA family can put only long delays into block memory (rtl/ecp5/).
module lipp_block_ring #(
  parameter int Width = 1,
  parameter int Cycles = 5
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  if (Width < 1 || Cycles < 5) begin : gen_illegal
    $fatal(1, "lipp_block_ring: Width must be 1 or more and Cycles 5 or more");
  end

  lipp_ring #(.Width(Width), .Cycles(Cycles)) i_ring (.clk_i, .d_i, .q_o);

endmodule

`default_nettype wire
