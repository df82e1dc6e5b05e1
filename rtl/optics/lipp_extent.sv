// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Checks if lenslet (i, j) exists, because an array may be smaller than its panel.
///
/// Let c be the lenslet's distance from the array's centre along the rows, in half pitches. Lenslet
/// (i, j) does not exist, and missing_o is high, if
///
///   |c| > along   or   |j| > across.
///
/// On a hexagonal grid c = 2 i + j, on a square grid c = 2 i. The module computes the signs of
/// along - c, along + c, across - j and across + j. The latency is extent_latency() clocks.
module lipp_extent #(
  parameter int Grid = lipp_optics_pkg::GridSquare
) (
  input  logic                                         clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] i_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] j_i,
  input  logic signed [lipp_optics_pkg::IndexBits+1:0] along_i,  // maximum |c|, in half pitches
  input  logic signed [lipp_optics_pkg::IndexBits:0]   across_i,  // maximum |j|, in rows
  output logic                                         missing_o
);
  import lipp_optics_pkg::*;

  localparam int Wc = IndexBits + 2;
  localparam int Wj = IndexBits + 1;

  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "lipp_extent: Grid must be GridSquare or GridHex");
  end

  // Registers for both limits shorten the timing path from the configuration registers.
  logic signed [Wc-1:0] c_q, along_q;
  logic signed [Wj-1:0] j_q, across_q;
  logic signed [Wc:0] right_q, left_q;
  logic signed [Wj:0] up_q, down_q;
  always_ff @(posedge clk_i) begin
    along_q <= along_i;
    across_q <= across_i;
    c_q <= (Wc'(i_i) <<< 1) + (Grid == GridHex ? Wc'(j_i) : '0);
    j_q <= Wj'(j_i);
    right_q <= (Wc + 1)'(along_q) - (Wc + 1)'(c_q);
    left_q <= (Wc + 1)'(along_q) + (Wc + 1)'(c_q);
    up_q <= (Wj + 1)'(across_q) - (Wj + 1)'(j_q);
    down_q <= (Wj + 1)'(across_q) + (Wj + 1)'(j_q);
    missing_o <= right_q[Wc] || left_q[Wc] || up_q[Wj] || down_q[Wj];
  end
  logic unused_bits;
  assign unused_bits = ^{right_q[Wc-1:0], left_q[Wc-1:0], up_q[Wj-1:0], down_q[Wj-1:0]};

endmodule

`default_nettype wire
