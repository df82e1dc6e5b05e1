// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3 of the ray trace: finds the lenslet at which the ray aims.
///
/// The inputs are the pixel's point (x, y) and the aperture point (a, b). Both points are measured
/// from the centre of the pixel's lenslet (i, j), in pitches along x and in rows along y. The ray
/// aims at the lenslet whose cell contains the aperture point (a, b). Let (di, dj) be the step from
/// the pixel's lenslet to the lenslet aimed at. The output indices are (i + di, j + dj). The output
/// points are measured from the centre of the lenslet aimed at:
///
///   x' = x - di                (square grid)
///   x' = x - di - dj/2         (hexagonal grid)
///   y' = y - dj.
///
/// The same formulas give the aperture point (a', b') from (a, b). All points have F fraction bits,
/// and all results are exact.
///
/// Output stray_o reports that the lenslet aimed at is not the pixel's lenslet. Output beyond_o
/// reports that x' or y' is outside [-2, 2), or that an index wraps. The latency is
/// aim_latency(Grid) clocks.
module lipp_aim #(
  parameter int F = 23,
  parameter int Grid = lipp_optics_pkg::GridSquare
) (
  input  logic                                         clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] i_i,  // index i of the pixel's lenslet
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] j_i,
  input  logic signed [F+1:0]                          x_i,  // pixel's point x, 2^-F pitches
  input  logic signed [F+1:0]                          y_i,  // pixel's point y, 2^-F rows
  input  logic signed [F+1:0]                          a_i,  // aperture point a, 2^-F pitches
  input  logic signed [F+1:0]                          b_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] i_o,  // index i of the lenslet aimed at
  output logic signed [lipp_optics_pkg::IndexBits-1:0] j_o,
  output logic signed [F+1:0]                          x_o,  // pixel's x, measured from (i_o, j_o)
  output logic signed [F+1:0]                          y_o,
  output logic signed [F+1:0]                          a_o,  // aperture a, measured from (i_o, j_o)
  output logic signed [F+1:0]                          b_o,
  output logic                                         stray_o,  // 1: ray aims at another lenslet
  output logic                                         beyond_o  // 1: an output word overflows
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int L = IndexBits + F;
  localparam int Wait = lenslet_latency(Grid);

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_aim: F must be 14 to 23");
  end
  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "lipp_aim: Grid must be GridSquare or GridHex");
  end

  logic signed [IndexBits-1:0] di, dj, i_late, j_late;
  logic signed [W-1:0] a, b, x_late, y_late;
  logic unused_beyond;  // always 0: points in [-2, 2) cannot wrap an index
  if (Grid == GridHex) begin : gen_hex
    lipp_lenslet_hex #(.F(F)) i_lenslet (
      .clk_i, .x_i(L'(a_i)), .y_i(L'(b_i)), .i_o(di), .j_o(dj), .x_o(a), .y_o(b),
      .beyond_o(unused_beyond)
    );
  end else begin : gen_square
    lipp_lenslet_square #(.F(F)) i_lenslet (
      .clk_i, .x_i(L'(a_i)), .y_i(L'(b_i)), .i_o(di), .j_o(dj), .x_o(a), .y_o(b),
      .beyond_o(unused_beyond)
    );
  end
  lipp_delay #(.Width(2 * IndexBits + 2 * W), .Cycles(Wait)) i_match (
    .clk_i, .d_i({i_i, j_i, x_i, y_i}), .q_o({i_late, j_late, x_late, y_late})
  );

  // The step (di, dj) is at most 3 lenslets, because aperture points are in [-2, 2).
  localparam int Ws = W + 3;
  logic signed [Ws-1:0] x_d, y_d;
  logic signed [Ws-1:0] step_x, step_y;
  assign step_y = Ws'(dj) <<< F;
  assign step_x = (Ws'(di) <<< F) + (Grid == GridHex ? Ws'(dj) <<< (F - 1) : '0);
  assign x_d = Ws'(x_late) - step_x;
  assign y_d = Ws'(y_late) - step_y;
  logic signed [IndexBits:0] i_d, j_d;
  assign i_d = (IndexBits + 1)'(i_late) + (IndexBits + 1)'(di);
  assign j_d = (IndexBits + 1)'(j_late) + (IndexBits + 1)'(dj);

  always_ff @(posedge clk_i) begin
    i_o <= IndexBits'(i_d);
    j_o <= IndexBits'(j_d);
    x_o <= W'(x_d);
    y_o <= W'(y_d);
    a_o <= a;
    b_o <= b;
    stray_o <= di != '0 || dj != '0;
    beyond_o <= x_d != Ws'($signed(x_d[W-1:0])) || y_d != Ws'($signed(y_d[W-1:0]))
        || i_d[IndexBits] != i_d[IndexBits-1] || j_d[IndexBits] != j_d[IndexBits-1];
  end

endmodule

`default_nettype wire
