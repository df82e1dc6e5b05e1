// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Adds two words a and b after masking each bit: s = (a & x) + (b & y). The module is
/// combinational and drops the carry out.
///
/// Multipliers use the module to add two rows of partial products. In a multiplier, a and b are the
/// first factor and the shifted first factor, and each mask repeats one bit of the second factor.
/// An FPGA family whose carry chains can mask their inputs replaces this module (rtl/ecp5/), so
/// that the masks need no extra logic.
module lipp_gated_sum #(
  parameter int W = 18  // width of the words and of the sum, in bits
) (
  input  logic [W-1:0] a_i,
  input  logic [W-1:0] x_i,  // bit mask x of the word a
  input  logic [W-1:0] b_i,
  input  logic [W-1:0] y_i,  // bit mask y of the word b
  output logic [W-1:0] s_o
);

  if (W < 1) begin : gen_illegal
    $fatal(1, "lipp_gated_sum: W must be 1 or more");
  end

  assign s_o = (a_i & x_i) + (b_i & y_i);

endmodule

`default_nettype wire
