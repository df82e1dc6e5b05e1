// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3: the lenslet that a ray aims at.
///
/// The aperture point (a, b) is measured from the centre of the pixel's lenslet: in pitches, and b
/// in rows on a hexagonal grid. The ray's own lenslet is the one whose cell contains the aperture
/// point. (di, dj) is the step from the pixel's lenslet to it. The outputs are measured from its
/// centre:
///
///   x' = x - di (hexagonal: x - di - dj/2),   y' = y - dj,   a', b' likewise (all exact).
///
/// stray_o: the lenslet differs from the pixel's. beyond_o: x' or y' is outside [-2, 2), or an
/// index wraps.
/// Latency aim_latency(Grid).
module lipp_aim #(
  parameter int F = 23,
  parameter int Grid = lipp_optics_pkg::GridSquare
) (
  input  logic                                         clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] i_i,  // the pixel's lenslet
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] j_i,
  input  logic signed [F+1:0]                          x_i,  // wide, pitches: point from its centre
  input  logic signed [F+1:0]                          y_i,  // wide, rows
  input  logic signed [F+1:0]                          a_i,  // wide: aperture point likewise
  input  logic signed [F+1:0]                          b_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] i_o,  // lenslet aimed at
  output logic signed [lipp_optics_pkg::IndexBits-1:0] j_o,
  output logic signed [F+1:0]                          x_o,  // wide: point relative to its centre
  output logic signed [F+1:0]                          y_o,
  output logic signed [F+1:0]                          a_o,  // wide: aperture point relative to it
  output logic signed [F+1:0]                          b_o,
  output logic                                         stray_o,  // lenslet is not the pixel's
  output logic                                         beyond_o  // a word overflows
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
  logic unused_beyond;  // aims are far from the ends of the lattice's words
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

  // A step is at most 3 lenslets: aims lie within [-2, 2).
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
