// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3 of the ray trace (near-eye displays): computes the pixel's point relative to its
/// lenslet's centre.
///
/// On a display for a near eye, a pixel belongs to the lenslet through which the eye sees the
/// pixel; the pixel may lie under a neighbouring lenslet. Input x is measured from the lenslet's
/// centre C to the point where the line from the pixel to the eye crosses the aperture plane. Let D
/// be the distance from the panel to the aperture plane, E the eye's distance from that plane, s =
/// D / (D + E), and A the panel point in front of the eye. The pixel's point from the lenslet's
/// centre is (x + (C - A) s) / (1 - s). The module computes (1 - s) times this point. In formulas,
/// all words are integers, and a b >> k is the product of `lipp_multiplier` truncated by k bits:
///
///   t_x  = (x << 2) + (16 C_x s >> 14) + o_x + 2,   x' = t_x >> 2,   y' likewise.
///
/// The host includes the factor 1 / (1 - s) in the coefficients of slope and point. The centre C is
/// in half pitches and half rows: (2 i + j, 2 j) on a hexagonal grid, (2 i, 2 j) on a square grid.
/// The word s has F + 11 fraction bits, and the offset o = -s A has F + 2.
///
/// The outputs have W + 2 bits, F of them fraction bits, in [-8, 8). Output beyond_o reports that
/// x' or y' is outside [-8, 8). The latency is converge_latency(F) clocks.
module lipp_converge #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // 1: cross terms use multiplier cells
  parameter int Grid = lipp_optics_pkg::GridSquare
) (
  input  logic                                         clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] i_i,  // index i of the ray's lenslet
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] j_i,
  input  logic signed [F+1:0]                          x_i,  // point x from C, 2^-F pitches
  input  logic signed [F+1:0]                          y_i,  // point y from C, 2^-F rows
  input  logic signed [F+8:0]                          share_i,  // s, F + 11 fraction bits
  input  logic signed [F+8:0]                          offset_x_i,  // o_x = -s A_x, in 2^-(F+2)
  input  logic signed [F+8:0]                          offset_y_i,
  output logic signed [F+3:0]                          x_o,  // pixel's x times 1 - s, 2^-F pitches
  output logic signed [F+3:0]                          y_o,
  output logic                                         beyond_o  // 1: x_o or y_o overflows
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

  // ---- compute C, the lenslet's centre, in half pitches and half rows ----
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
    // The word x << 2 ends in two zero bits. Setting bit 1 adds the rounding constant 2.
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
