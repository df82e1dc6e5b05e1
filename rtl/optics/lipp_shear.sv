// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3, sheared lattices: a point's x in pitches along the rows, from its lattice coordinates.
///
/// The rows of a sheared lattice are moved by s times their height. A point that is x pitches and y
/// rows from its lenslet's centre, counted along the lattice, so is x + g y pitches to the right of
/// it, where g is s times the distance of rows / pitch:
///
///   x'   = ((x << 3) + (y g >> F-3) + 4) >> 3
///
/// as integers, y g >> k the product that `lipp_multiplier` truncates by k bits. All words have F
/// fraction bits. Output: W + 2 bits, [-8, 8). beyond_o: x' is outside that range.
/// Latency shear_latency(F).
module lipp_shear #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // cross terms of products in multiplier cells
  parameter int Wx = F + 2          // bits of x and y, a wide word or more
) (
  input  logic                 clk_i,
  input  logic signed [Wx-1:0] x_i,  // pitches
  input  logic signed [Wx-1:0] y_i,  // rows
  input  logic signed [F+3:0]  g_i,  // far
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

  // x << 3 has three zero bits below F; the rounding constant, half a unit, is set in the first.
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
