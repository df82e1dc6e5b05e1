// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes the line of an exit ray: slopes, and the point in the plane z = 0 of the domes'
/// vertices.
///
/// The line is in the array's axes, in radii from the array's origin. In the formulas all words are
/// integers, a b >> k is the product of `lipp_row_multiplier` truncated by k bits, and q is 1 /
/// sqrt(4 dz) from `lipp_quadratic`. Words xi, xj and yj are steps between lenslets. The steps are
///
///   r        = q q >> F+2                                    1 / dz, F + 4 fraction bits
///   slope_x  = ((dx r >> F+1) + 4) >> 3,  slope_y likewise    F + 1 fraction bits
///   x_o      = ((xi i >> 31-F) + (xj j >> 31-F) + (x >> 2) - (slope_x z >> F+3) + 2) >> 2
///   y_o      = ((yj j >> 31-F) + (y >> 2) - (slope_y z >> F+3) + 2) >> 2.
///
/// Output draws_o is high if the status is ok or crosstalk, dz is 1/4 or more (at most 75.5 degrees
/// to the axis), and x_o and y_o are in [-2048, 2048).
///
/// The error of a slope m is at most 0.8 + 1.25 |m| units in the last place; its RMS is 0.35 for
/// |m| < 1 (measured with 7 million rays). The error of a position is at most 1.5 + |z| (0.8 + 1.25
/// |m|) / 16 units in the last place, plus 2^(F-34) for each lenslet between the ray and the
/// array's origin. The latency is exit_line_latency(F) clocks.
module lipp_exit_line #(
  parameter int F = 16
) (
  input  logic                                         clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] i_i,  // lenslet i that the ray leaves
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] j_i,
  input  logic signed [F+3:0]                          x_i,  // origin x, 2^-(F+1) radii
  input  logic signed [F+3:0]                          y_i,
  input  logic signed [F+3:0]                          z_i,
  input  logic signed [F+1:0]                          dx_i,  // direction x, F + 1 fraction bits
  input  logic signed [F+1:0]                          dy_i,
  input  logic signed [F+1:0]                          dz_i,
  input  lipp_optics_pkg::ray_status_e                 status_i,
  // The steps between lenslets are in radii with 30 fraction bits. xi_i is the x step to the next
  // lenslet of a row, xj_i and yj_i are the x and y steps to the next row.
  input  logic signed [31:0]                           xi_i,
  input  logic signed [31:0]                           xj_i,
  input  logic signed [31:0]                           yj_i,
  output logic signed [F+8:0]                          x_o,  // x at z = 0, in 2^-(F-3) radii
  output logic signed [F+8:0]                          y_o,
  output logic signed [F+3:0]                          slope_x_o,  // dx / dz, F + 1 fraction bits
  output logic signed [F+3:0]                          slope_y_o,
  output logic                                         draws_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;
  import lipp_scene_pkg::*;

  localparam int W = F + 2;
  localparam int Wl = F + 4;   // width of lengths x, y, z and of slopes
  localparam int Wr = F + 8;   // width of r, which is in [1, 4]

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_exit_line: F must be 14 to 23");
  end

  // ---- compute r = 1 / dz ----
  localparam int SquareLatency = row_latency(F + 6, F + 6);
  localparam int InverseLatency = quadratic_latency() + SquareLatency;
  logic [F+4:0] root;
  logic signed [F+5:0] root_word;
  logic signed [F+9:0] inverse;
  lipp_quadratic #(.F(F), .Root(RootReciprocal)) i_root (
    .clk_i, .x_i({dz_i[F:0], 2'b00}), .y_o(root)
  );
  assign root_word = $signed({1'b0, root});
  lipp_row_multiplier #(
    .Wa(F + 6), .Wb(F + 6), .Drop(F + 2), .Square(1'b1)
  ) i_inverse (.clk_i, .a_i(root_word), .b_i(root_word), .p_o(inverse));

  // This delay matches the latency of r. With registers dx_q, dy_q one ring buffer suffices.
  logic signed [W-1:0] dx_q, dy_q, dx_late, dy_late;
  always_ff @(posedge clk_i) {dx_q, dy_q} <= {dx_i, dy_i};
  lipp_delay #(.Width(2 * W), .Cycles(InverseLatency - 1), .Block(1'b0)) i_direction (
    .clk_i, .d_i({dx_q, dy_q}), .q_o({dx_late, dy_late})
  );

  // ---- compute the slopes ----
  localparam int SlopeLatency = row_latency(W, Wr) + 1;
  localparam int Wm = W + Wr - (F + 1);
  logic signed [Wm-1:0] rise_x, rise_y;
  logic signed [Wl-1:0] slope_x_q, slope_y_q;
  lipp_row_multiplier #(.Wa(W), .Wb(Wr), .Drop(F + 1)) i_slope_x (
    .clk_i, .a_i(dx_late), .b_i(inverse[Wr-1:0]), .p_o(rise_x)
  );
  lipp_row_multiplier #(.Wa(W), .Wb(Wr), .Drop(F + 1)) i_slope_y (
    .clk_i, .a_i(dy_late), .b_i(inverse[Wr-1:0]), .p_o(rise_y)
  );
  always_ff @(posedge clk_i) begin
    slope_x_q <= Wl'((rise_x + Wm'(4)) >>> Guard);
    slope_y_q <= Wl'((rise_y + Wm'(4)) >>> Guard);
  end
  logic unused_inverse;
  assign unused_inverse = ^inverse[F+9:Wr];

  // ---- compute the offset from the ray's origin to z = 0, and the lenslet's centre ----
  localparam int FallLatency = row_latency(Wl, Wl);
  localparam int LatticeLatency = row_latency(32, IndexBits);
  localparam int Wf = Wl + Wl - (F + 3);           // width of the product slope z
  localparam int Wc = 32 + IndexBits - (31 - F);   // width of the lenslet's centre
  localparam int Ws = Wc + 2;
  localparam int PlaceWait = InverseLatency + SlopeLatency;
  logic signed [Wl-1:0] x_later, y_later, z_later;
  logic signed [IndexBits-1:0] i_later, j_later;
  logic signed [Wf-1:0] fall_x, fall_y;
  logic signed [Wc-1:0] centre_xi, centre_xj, centre_yj;
  // These delays have Block = 0, because all block memories are needed for texels.
  lipp_delay #(.Width(Wl), .Cycles(PlaceWait), .Block(1'b0)) i_z (
    .clk_i, .d_i(z_i), .q_o(z_later)
  );
  lipp_delay #(.Width(2 * Wl), .Cycles(PlaceWait + FallLatency), .Block(1'b0)) i_xy (
    .clk_i, .d_i({x_i, y_i}), .q_o({x_later, y_later})
  );
  lipp_delay #(
    .Width(2 * IndexBits), .Cycles(PlaceWait + FallLatency - LatticeLatency), .Block(1'b0)
  ) i_ij (.clk_i, .d_i({i_i, j_i}), .q_o({i_later, j_later}));
  lipp_row_multiplier #(.Wa(Wl), .Wb(Wl), .Drop(F + 3)) i_fall_x (
    .clk_i, .a_i(slope_x_q), .b_i(z_later), .p_o(fall_x)
  );
  lipp_row_multiplier #(.Wa(Wl), .Wb(Wl), .Drop(F + 3)) i_fall_y (
    .clk_i, .a_i(slope_y_q), .b_i(z_later), .p_o(fall_y)
  );
  lipp_row_multiplier #(.Wa(32), .Wb(IndexBits), .Drop(31 - F)) i_centre_xi (
    .clk_i, .a_i(xi_i), .b_i(i_later), .p_o(centre_xi)
  );
  lipp_row_multiplier #(.Wa(32), .Wb(IndexBits), .Drop(31 - F)) i_centre_xj (
    .clk_i, .a_i(xj_i), .b_i(j_later), .p_o(centre_xj)
  );
  lipp_row_multiplier #(.Wa(32), .Wb(IndexBits), .Drop(31 - F)) i_centre_yj (
    .clk_i, .a_i(yj_i), .b_i(j_later), .p_o(centre_yj)
  );

  // ---- add the lenslet's centre, the ray's origin and the offset to z = 0 ----
  logic signed [Wc:0] centre_x_q, centre_y_q;
  logic signed [Wf+1:0] local_x_q, local_y_q;
  logic signed [Ws-1:0] sum_x_q, sum_y_q;
  logic fits_q, draws, draws_q;
  always_ff @(posedge clk_i) begin
    centre_x_q <= (Wc + 1)'(centre_xi) + (Wc + 1)'(centre_xj);
    centre_y_q <= (Wc + 1)'(centre_yj);
    local_x_q <= (Wf + 2)'(x_later >>> 2) - (Wf + 2)'(fall_x);
    local_y_q <= (Wf + 2)'(y_later >>> 2) - (Wf + 2)'(fall_y);
    sum_x_q <= Ws'(centre_x_q) + Ws'(local_x_q);
    sum_y_q <= Ws'(centre_y_q) + Ws'(local_y_q);
  end

  // ---- round the position, and check its range ----
  logic signed [Ws-1:0] round_x_q, round_y_q;
  function automatic logic fits(logic signed [Ws-1:0] word);
    return word[Ws-1:F+10] == {(Ws - F - 10){word[F+10]}};
  endfunction
  always_ff @(posedge clk_i) begin
    round_x_q <= sum_x_q + Ws'(2);
    round_y_q <= sum_y_q + Ws'(2);
    fits_q <= fits(round_x_q) && fits(round_y_q);
    x_o <= round_x_q[F+10:2];
    y_o <= round_y_q[F+10:2];
  end
  logic unused_round;
  assign unused_round = ^{round_x_q[1:0], round_y_q[1:0]};

  lipp_delay #(.Width(2 * Wl), .Cycles(FallLatency + 4)) i_slopes (
    .clk_i, .d_i({slope_x_q, slope_y_q}), .q_o({slope_x_o, slope_y_o})
  );

  // draws_q is high if the ray leaves the lenslet and is not too steep.
  always_ff @(posedge clk_i) begin
    draws_q <= (status_i == StatusOk || status_i == StatusCrosstalk)
        && !dz_i[F+1] && dz_i[F:F-1] != 2'b00;
  end
  lipp_delay #(.Width(1), .Cycles(exit_line_latency(F) - 1), .Block(1'b0)) i_draws (
    .clk_i, .d_i(draws_q), .q_o(draws)
  );
  assign draws_o = draws && fits_q;

endmodule

`default_nettype wire
