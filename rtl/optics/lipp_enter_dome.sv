// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 4 of the ray trace (plano side to the viewer): refracts the ray into the glass at the dome.
///
/// The direction in the glass is
///
///   d' = e/n - (cos' - cos/n) N,
///
/// where e is the unit direction in the air, n the refractive index, N the unit normal, cos and
/// cos' the cosines of incidence and refraction angle. The module computes d'_x and d'_y, and
/// `lipp_leave_flat` computes d'_z. In the formulas all words are integers, a b >> k is the product
/// of `lipp_multiplier` truncated by k bits, and M = 2^(F+3) - 1. The steps are
///
///   C'   = 2^(F+3) - (s i2 >> F)
///   cos' = sqrt(min(max(C', 0), M))
///   k    = (4 cos' - (cos i >> F-1) + 4) >> 3
///   d'_x = saturate(((e_x i >> F-2) - (k N_x >> F-3) + 4) >> 3),  d'_y likewise.
///
/// Directions, N and the cosines have F + 1 fraction bits. The squared sine s = 1 - cos^2 and the
/// squared cosine C' have F + 3 fraction bits, and k has F. Word i is 1/n with F + 1 fraction bits,
/// i2 is 1/n^2 with F. Output beyond_o reports that C' is below 0 or above 1, or that the direction
/// is outside [-1, 1], by more than rounding errors. The latency is dome_latency(F) clocks.
module lipp_enter_dome #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0  // 1: cross terms use multiplier cells
) (
  input  logic                clk_i,
  input  logic signed [F+1:0] nx_i,  // unit normal N, F + 1 fraction bits
  input  logic signed [F+1:0] ny_i,
  input  logic signed [F+1:0] cos_i,
  input  logic signed [F+3:0] s_i,   // squared sine of incidence, F + 3 fraction bits
  input  logic signed [F+1:0] ex_i,  // direction e in the air, F + 1 fraction bits
  input  logic signed [F+1:0] ey_i,
  input  logic signed [F+1:0] index_inverse_i,         // 1/n, F + 1 fraction bits
  input  logic signed [F+3:0] index_inverse_square_i,  // 1/n^2, F fraction bits
  output logic signed [F+1:0] dx_o,  // direction d' in the glass, F + 1 fraction bits
  output logic signed [F+1:0] dy_o,
  output logic                beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wf = W + 2;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_enter_dome: F must be 14 to 23");
  end

  // ---- compute the squared cosine in the glass ----
  localparam int SineDrop = F;
  localparam int Ws = 2 * Wf - SineDrop;
  localparam logic [F+2:0] Most = '1;
  logic signed [Ws-1:0] sine, c_q;
  // The upper bits detect an overflow; a comparator would add a carry chain to the timing path.
  logic above;
  assign above = !c_q[Ws-1] && c_q[Ws-2:F+3] != '0;
  localparam logic signed [Ws-1:0] OverOne = (Ws'(1) <<< (F + 3)) + (Ws'(1) <<< SquareSlack);
  logic [F+2:0] clamped_q;
  logic over_q, over;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(Wf), .Drop(SineDrop)) i_sine (
    .clk_i, .a_i(s_i), .b_i(index_inverse_square_i), .p_o(sine)
  );
  always_ff @(posedge clk_i) begin
    c_q <= (Ws'(1) <<< (F + 3)) - sine;
    over_q <= c_q < 0 || c_q >= OverOne;
    clamped_q <= c_q[Ws-1] ? '0 : above ? Most : (F + 3)'(c_q);
  end
  logic signed [W-1:0] cos_glass;
  lipp_sqrt #(.F(F), .Normalise(1'b1)) i_sqrt (.clk_i, .x_i(clamped_q), .y_o(cos_glass));

  // ---- compute k, the factor of the normal ----
  localparam int CosDrop = F - 1;
  localparam int CosLatency = mul_latency(Wf, Wf) + 2 + sqrt_latency(1'b1);
  localparam int Wc = 2 * W - CosDrop;
  logic signed [Wc-1:0] cos_air_early, cos_air, bend_wide_q;
  logic signed [W-1:0] bend_q;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(CosDrop)) i_cos (
    .clk_i, .a_i(cos_i), .b_i(index_inverse_i), .p_o(cos_air_early)
  );
  lipp_delay #(.Width(Wc), .Cycles(CosLatency - mul_latency(W, W))) i_cos_match (
    .clk_i, .d_i(cos_air_early), .q_o(cos_air)
  );
  always_ff @(posedge clk_i) begin
    bend_wide_q <= (Wc'(cos_glass) <<< 2) - cos_air;
    bend_q <= W'((bend_wide_q + Wc'(4)) >>> Guard);
  end

  // ---- compute the direction in the glass ----
  localparam int BendDrop = F - Guard;
  localparam int RatioDrop = F + 1 - Guard;
  localparam int Wp = 2 * W - BendDrop;
  localparam int BendLatency = bend_latency(F);
  logic signed [W-1:0] nx, ny;
  logic signed [Wp-1:0] kx, ky, dx_q, dy_q, dx_q2, dy_q2;
  logic signed [Wp-2:0] tx_early, ty_early, tx, ty;
  lipp_delay #(.Width(2 * W), .Cycles(BendLatency)) i_normal (
    .clk_i, .d_i({nx_i, ny_i}), .q_o({nx, ny})
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(RatioDrop)) i_tx (
    .clk_i, .a_i(ex_i), .b_i(index_inverse_i), .p_o(tx_early)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(RatioDrop)) i_ty (
    .clk_i, .a_i(ey_i), .b_i(index_inverse_i), .p_o(ty_early)
  );
  lipp_delay #(.Width(2 * (Wp - 1)), .Cycles(BendLatency)) i_t (
    .clk_i, .d_i({tx_early, ty_early}), .q_o({tx, ty})
  );
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(BendDrop)
  ) i_kx (.clk_i, .a_i(bend_q), .b_i(nx), .p_o(kx));
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(BendDrop)
  ) i_ky (.clk_i, .a_i(bend_q), .b_i(ny), .p_o(ky));
  always_ff @(posedge clk_i) begin
    dx_q <= Wp'(tx) - kx;
    dy_q <= Wp'(ty) - ky;
    dx_q2 <= dx_q + Wp'(4);
    dy_q2 <= dy_q + Wp'(4);
  end
  logic [1:0] out_beyond;
  lipp_saturate #(.From(Wp - Guard), .To(W)) i_dx (
    .clk_i, .d_i((Wp - Guard)'(dx_q2 >>> Guard)), .q_o(dx_o), .beyond_o(out_beyond[0])
  );
  lipp_saturate #(.From(Wp - Guard), .To(W)) i_dy (
    .clk_i, .d_i((Wp - Guard)'(dy_q2 >>> Guard)), .q_o(dy_o), .beyond_o(out_beyond[1])
  );
  lipp_delay #(.Width(1), .Cycles(dome_latency(F) - mul_latency(Wf, Wf) - 2)) i_over (
    .clk_i, .d_i(over_q), .q_o(over)
  );
  assign beyond_o = over || |out_beyond;

endmodule

`default_nettype wire
