// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 2, square grid: the lenslet whose cell contains a point, and the point relative to its
/// centre.
///
///   i = floor(x + 1/2),   local x = x - i in [-1/2, 1/2), likewise j and y
///
/// Input x_i, y_i: signed, F fraction bits, in pitches. Output: indices, and wide words.
/// beyond_o: an index wraps. Latency lenslet_latency(GridSquare).
module lipp_lenslet_square #(
  parameter int F = 23
) (
  input  logic                                           clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits+F-1:0] x_i,
  input  logic signed [lipp_optics_pkg::IndexBits+F-1:0] y_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0]   i_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0]   j_o,
  output logic signed [F+1:0]                            x_o,
  output logic signed [F+1:0]                            y_o,
  output logic                                           beyond_o
);
  import lipp_optics_pkg::*;

  localparam int L = IndexBits + F;
  localparam logic [L-1:0] Half = L'(1) << (F - 1);

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_lenslet_square: F must be 14 to 23");
  end

  logic [L:0] x_q, y_q;
  always_ff @(posedge clk_i) begin
    x_q <= {x_i[L-1], x_i} + {1'b0, Half};
    y_q <= {y_i[L-1], y_i} + {1'b0, Half};
  end
  assign beyond_o = x_q[L] != x_q[L-1] || y_q[L] != y_q[L-1];

  // Subtracting the half again inverts the fraction's top bit, which becomes the sign.
  assign i_o = x_q[L-1:F];
  assign j_o = y_q[L-1:F];
  assign x_o = (F+2)'($signed({~x_q[F-1], x_q[F-2:0]}));
  assign y_o = (F+2)'($signed({~y_q[F-1], y_q[F-2:0]}));

endmodule

`default_nettype wire
