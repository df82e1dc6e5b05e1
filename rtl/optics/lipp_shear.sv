// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3 of the ray trace (sheared lattices): converts lattice coordinates to x along the rows.
///
/// Each row of a sheared lattice is shifted by s times the height of the row. A point with the
/// lattice coordinates x in pitches and y in rows, from its lenslet's centre, is x + g y pitches to
/// the right of that centre. The factor g is s times the distance between rows, divided by the
/// pitch. In the formula all words are integers, and y g >> k is the product of `lipp_multiplier`
/// truncated by k bits. The result is
///
///   x'   = ((x << 3) + (y g >> F-3) + 4) >> 3.
///
/// All words have F fraction bits. The output has W + 2 bits, in [-8, 8). Output beyond_o reports
/// that x' is outside [-8, 8). The latency is shear_latency(F) clocks.
module lipp_shear #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // 1: cross terms use multiplier cells
  parameter int Wx = F + 2          // width of x and y in bits, F + 2 or more
) (
  input  logic                 clk_i,
  input  logic signed [Wx-1:0] x_i,  // lattice coordinate x in pitches, F fraction bits
  input  logic signed [Wx-1:0] y_i,  // lattice coordinate y in rows, F fraction bits
  input  logic signed [F+3:0]  g_i,  // (x shift per row) / pitch, F fraction bits
  output logic signed [F+3:0]  x_o,
  output logic                 beyond_o
);
  import lipp_math_pkg::*;

  localparam int Wo = F + 4;
  localparam int Drop = F - Guard;
  localparam int Wp = Wx + Wo - Drop;
  localparam int Wt = Wp + 1;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_shear: F must be 14 to 23");
  end
  if (Wx < F + 2 || Wx > Wo) begin : gen_illegal_width
    $fatal(1, "lipp_shear: Wx must be F + 2 to F + 4");
  end

  logic signed [Wp-1:0] product;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wx), .Wb(Wo), .Drop(Drop)) i_product (
    .clk_i, .a_i(y_i), .b_i(g_i), .p_o(product)
  );
  logic signed [Wx-1:0] x_late;
  lipp_delay #(.Width(Wx), .Cycles(mul_latency(Wx, Wo))) i_x_match (.clk_i, .d_i(x_i),
      .q_o(x_late));

  // The word x << 3 ends in three zero bits. Setting bit 2 adds the rounding constant 4.
  logic signed [Wt-1:0] total_q;
  logic signed [Wt-Guard-1:0] total;
  assign total = (Wt - Guard)'(total_q >>> Guard);
  always_ff @(posedge clk_i) begin
    total_q <= ((Wt'(x_late) <<< Guard) | Wt'(4)) + Wt'(product);
    x_o <= Wo'(total);
    beyond_o <= total != (Wt - Guard)'($signed(total[Wo-1:0]));
  end

endmodule

`default_nettype wire
