// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 2 of the ray trace, builds with a square grid: finds the lenslet whose cell contains the
/// pixel's point, and measures the point from that lenslet's centre.
///
/// The index i and the coordinate x measured from the lenslet's centre, in [-1/2, 1/2), are
///
///   i = floor(x + 1/2),   local x = x - i.
///
/// The same formulas give j and local y from y. The inputs x_i and y_i are signed, in pitches, with
/// F fraction bits. The local coordinates are signed with F fraction bits. Output beyond_o reports
/// that an index wraps. The latency is lenslet_latency(GridSquare) clocks.
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

  // Subtracting the 1/2 that was added inverts the fraction's top bit, which becomes the sign.
  assign i_o = x_q[L-1:F];
  assign j_o = y_q[L-1:F];
  assign x_o = (F+2)'($signed({~x_q[F-1], x_q[F-2:0]}));
  assign y_o = (F+2)'($signed({~y_q[F-1], y_q[F-2:0]}));

endmodule

`default_nettype wire
