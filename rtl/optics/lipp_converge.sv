// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3, displays for a near eye: the pixel's point relative to the centre of its lenslet.
///
/// The pixel belongs to the lenslet through which the eye sees it, and may lie under a neighbour.
/// The lattice coordinates are those of the line from pixel to eye where it crosses the apertures'
/// plane: x is that point in the cell. The pixel itself is at (C - A) s / (1 - s) farther, where C
/// is the lenslet's centre, A the point in front of the eye and s = D / (D + E). So
///
///   t_x  = (x << 2) + (16 C_x s >> 14) + o_x + 2,   x' = t_x >> 2,   y' likewise
///
/// is 1 - s times the pixel's point; the coefficients of slope and point contain 1 / (1 - s).
/// As integers, where a b >> k is the product that `lipp_multiplier` truncates by k bits; C in half
/// pitches and half rows: (2 i + j, 2 j) (square: (2 i, 2 j)). s has F + 11 fraction bits, o = -s A
/// has F + 2.
///
/// Output: W + 2 bits with F fraction bits, [-8, 8). beyond_o: x' or y' is outside that range.
/// Latency converge_latency(F).
module lipp_converge #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // cross terms of products in multiplier cells
  parameter int Grid = lipp_optics_pkg::GridSquare
) (
  input  logic                                         clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] i_i,  // the ray's lenslet
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] j_i,
  input  logic signed [F+1:0]                          x_i,  // wide, pitches: point in its cell
  input  logic signed [F+1:0]                          y_i,  // wide, rows
  input  logic signed [F+8:0]                          share_i,  // s
  input  logic signed [F+8:0]                          offset_x_i,  // o
  input  logic signed [F+8:0]                          offset_y_i,
  output logic signed [F+3:0]                          x_o,  // point from its centre
  output logic signed [F+3:0]                          y_o,
  output logic                                         beyond_o  // x_o or y_o overflows
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int Wx = F + 4;
  localparam int Ws = F + 9;
  localparam int Drop = 14;
  localparam int Wp = MulBits + Ws - Drop;
  localparam int Wt = Wp + 1;

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_converge: F must be 14 to 23");
  end
  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "lipp_converge: Grid must be GridSquare or GridHex");
  end

  // ---- the lenslet's centre in half pitches and half rows ----
  localparam int Wc = IndexBits + 2;
  logic signed [Wc-1:0] centre_x, centre_y;
  assign centre_x = (Wc'(i_i) <<< 1) + (Grid == GridHex ? Wc'(j_i) : '0);
  assign centre_y = Wc'(j_i) <<< 1;

  logic [1:0] beyond_q;
  assign beyond_o = |beyond_q;
  for (genvar k = 0; k < 2; k++) begin : gen_axis
    logic signed [F+1:0] point;
    logic signed [Wc-1:0] centre;
    logic signed [Ws-1:0] offset;
    assign point = k == 0 ? x_i : y_i;
    assign centre = k == 0 ? centre_x : centre_y;
    assign offset = k == 0 ? offset_x_i : offset_y_i;

    logic signed [Wp-1:0] product;
    lipp_multiplier #(.CrossCells(CrossCells), .Wa(MulBits), .Wb(Ws), .Drop(Drop)) i_product (
      .clk_i, .a_i({centre, 4'b0}), .b_i(share_i), .p_o(product)
    );
    // x << 2 has two zero bits below F; the rounding constant, half a unit, is set in the first.
    logic signed [Ws:0] sum_q, sum_late;
    always_ff @(posedge clk_i) sum_q <= ((Ws + 1)'(point) <<< 2 | (Ws + 1)'(2)) + (Ws + 1)'(offset);
    lipp_delay #(.Width(Ws + 1), .Cycles(mul_latency(MulBits, Ws) - 1)) i_sum_match (
      .clk_i, .d_i(sum_q), .q_o(sum_late)
    );
    logic signed [Wt-1:0] total_q;
    logic signed [Wt-3:0] total;
    assign total = (Wt - 2)'(total_q >>> 2);
    logic signed [Wx-1:0] local_q;
    always_ff @(posedge clk_i) begin
      total_q <= Wt'(product) + Wt'(sum_late);
      local_q <= Wx'(total);
      beyond_q[k] <= total != (Wt - 2)'($signed(total[Wx-1:0]));
    end
    if (k == 0) begin : gen_x
      assign x_o = local_q;
    end else begin : gen_y
      assign y_o = local_q;
    end
  end

endmodule

`default_nettype wire
