// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Sum of two words, each of whose bits has a gate: s = (a & x) + (b & y). Combinational.
///
/// Two rows of a product are such a sum: the word, the word shifted, and a bit of the other factor
/// at the gates of each. A family whose carry chains have room for the gates replaces this module
/// (rtl/ecp5/): the gates then take no logic of their own.
module lipp_gated_sum #(
  parameter int W = 18  // bits of the words and of the sum
) (
  input  logic [W-1:0] a_i,
  input  logic [W-1:0] x_i,  // gates of a
  input  logic [W-1:0] b_i,
  input  logic [W-1:0] y_i,  // gates of b
  output logic [W-1:0] s_o
);

  if (W < 1) begin : gen_illegal
    $fatal(1, "lipp_gated_sum: W must be 1 or more");
  end

  assign s_o = (a_i & x_i) + (b_i & y_i);

endmodule

`default_nettype wire
