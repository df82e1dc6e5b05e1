// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 6 of the ray trace (plano side to the panel): refracts the ray out of glass at the dome.
///
/// The direction in the air is
///
///   d' = n d + (cos' - n cos) N,
///
/// where d is the unit direction in the glass, n the refractive index, N the unit normal, and cos
/// and cos' are the cosines of incidence and refraction. The flat face keeps the tangential part,
/// so n d_x = e_x and n d_y = e_y, where e is the direction in the air before the flat face. In the
/// formulas all words are integers, a b >> k is the product of `lipp_multiplier` truncated by k
/// bits, and M = 2^(F+3) - 1. The steps are
///
///   C'   = 2^(F+3) - (s n2 >> F)
///   cos' = sqrt(min(max(C', 0), M))
///   k    = (4 cos' - (cos n >> F-2) + 4) >> 3
///   d'_x = saturate(((e_x << 3-E) + (k N_x >> F-3) + 4) >> 3),  d'_y likewise
///   d'_z = saturate(((dz n >> F-3+3E) + (k N_z >> F-3) + 4) >> 3).
///
/// Words e_x and e_y have F + 1 + E fraction bits with E = extra_bits(F), and dz has F + 1 + 3 E.
/// The squared sine s = 1 - cos^2 and the squared cosine C' have F + 3 fraction bits. The words n,
/// n2 = n^2 and k have F fraction bits. N, the cosines and the exit direction d' have F + 1
/// fraction bits. Output reflected_o reports total internal reflection, C' <= 0. Output beyond_o
/// reports that C' is above 1, or, for a ray that is not reflected, that k does not fit its word or
/// the direction is outside [-1, 1]. Rounding errors do not set beyond_o. The latency is
/// dome_latency(F) clocks.
module lipp_leave_dome #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0, // 1: cross terms use multiplier cells
  localparam int E = lipp_optics_pkg::extra_bits(F),
  localparam int Wt = F + 2 + E,
  localparam int Wz = F + 2 + 3 * E
) (
  input  logic                 clk_i,
  input  logic signed [F+1:0]  nx_i,  // unit normal N, F + 1 fraction bits
  input  logic signed [F+1:0]  ny_i,
  input  logic signed [F+1:0]  nz_i,
  input  logic signed [F+1:0]  cos_i,
  input  logic signed [F+3:0]  s_i,  // squared sine of incidence, F + 3 fraction bits
  input  logic signed [Wt-1:0] ex_i,  // e in the air before the flat face, F + 1 + E fraction bits
  input  logic signed [Wt-1:0] ey_i,
  input  logic signed [Wz-1:0] dz_i,  // axial direction in the glass, F + 1 + 3 E fraction bits
  input  logic signed [F+2:0]  index_i,  // refractive index n, F fraction bits
  input  logic signed [F+3:0]  index_square_i,  // n^2, F fraction bits
  output logic signed [F+1:0]  dx_o,  // exit direction in the air, F + 1 fraction bits
  output logic signed [F+1:0]  dy_o,
  output logic signed [F+1:0]  dz_o,
  output logic                 reflected_o,
  output logic                 beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wf = W + 2;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_leave_dome: F must be 14 to 23");
  end

  // ---- compute the squared cosine in the air ----
  localparam int SineDrop = F;
  localparam int Ws = 2 * Wf - SineDrop;
  localparam logic [F+2:0] Most = '1;
  logic signed [Ws-1:0] sine, c_q;
  // The upper bits detect an overflow; a comparator would add a carry chain to the timing path.
  logic above;
  assign above = !c_q[Ws-1] && c_q[Ws-2:F+3] != '0;
  logic [F+2:0] clamped_q;
  localparam logic signed [Ws-1:0] OverOne = (Ws'(1) <<< (F + 3)) + (Ws'(1) <<< SquareSlack);
  logic reflected_q, over_q;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(Wf), .Drop(SineDrop)) i_sine (
    .clk_i, .a_i(s_i), .b_i(index_square_i), .p_o(sine)
  );
  always_ff @(posedge clk_i) begin
    c_q <= (Ws'(1) <<< (F + 3)) - sine;
    reflected_q <= c_q <= 0;
    over_q <= c_q >= OverOne;
    clamped_q <= c_q[Ws-1] ? '0 : above ? Most : (F + 3)'(c_q);
  end
  logic signed [W-1:0] cos_air;
  lipp_sqrt #(.F(F), .Normalise(1'b1)) i_sqrt (.clk_i, .x_i(clamped_q), .y_o(cos_air));

  // ---- compute k, the factor of the normal ----
  localparam int CosDrop = F - 2;
  localparam int CosLatency = mul_latency(Wf, Wf) + 2 + sqrt_latency(1'b1);
  localparam int Wc = 2 * W + 1 - CosDrop;
  logic signed [Wc-1:0] cos_glass_early, cos_glass, bend_wide_q;
  logic signed [Wc-Guard-1:0] bend;
  logic signed [W-1:0] bend_q;
  logic bend_beyond_q, bend_beyond;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W + 1), .Drop(CosDrop)) i_cos (
    .clk_i, .a_i(cos_i), .b_i(index_i), .p_o(cos_glass_early)
  );
  lipp_delay #(.Width(Wc), .Cycles(CosLatency - mul_latency(W, W + 1))) i_cos_match (
    .clk_i, .d_i(cos_glass_early), .q_o(cos_glass)
  );
  assign bend = (Wc - Guard)'((bend_wide_q + Wc'(4)) >>> Guard);
  always_ff @(posedge clk_i) begin
    bend_wide_q <= (Wc'(cos_air) <<< 2) - cos_glass;
    bend_q <= W'(bend);
    bend_beyond_q <= bend != (Wc - Guard)'($signed(bend[W-1:0]));
  end

  // ---- compute the direction in the air ----
  localparam int Drop = F - Guard;
  localparam int Wk = 2 * W - Drop;
  localparam int Wp = Wk + 1;
  localparam int BendLatency = bend_latency(F);
  logic signed [W-1:0] nx, ny, nz;
  logic signed [Wt-1:0] ex, ey;
  logic signed [Wk-1:0] kx, ky, kz;
  logic signed [Wp-1:0] axial_early, axial, dx_q, dy_q, dz_q;
  lipp_delay #(.Width(3 * W), .Cycles(BendLatency)) i_normal (
    .clk_i, .d_i({nx_i, ny_i, nz_i}), .q_o({nx, ny, nz})
  );
  lipp_delay #(.Width(2 * Wt), .Cycles(BendLatency + mul_latency(W, W))) i_e (
    .clk_i, .d_i({ex_i, ey_i}), .q_o({ex, ey})
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wz), .Wb(W + 1), .Drop(Drop + 3 * E)) i_axial (
    .clk_i, .a_i(dz_i), .b_i(index_i), .p_o(axial_early)
  );
  lipp_delay #(
    .Width(Wp), .Cycles(BendLatency + mul_latency(W, W) - mul_latency(Wz, W + 1))
  ) i_axial_match (.clk_i, .d_i(axial_early), .q_o(axial));
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)
  ) i_kx (.clk_i, .a_i(bend_q), .b_i(nx), .p_o(kx));
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)
  ) i_ky (.clk_i, .a_i(bend_q), .b_i(ny), .p_o(ky));
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)
  ) i_kz (.clk_i, .a_i(bend_q), .b_i(nz), .p_o(kz));
  always_ff @(posedge clk_i) begin
    dx_q <= (Wp'(ex) <<< (Guard - E)) + Wp'(kx);
    dy_q <= (Wp'(ey) <<< (Guard - E)) + Wp'(ky);
    dz_q <= axial + Wp'(kz);
  end

  logic signed [Wp-Guard-1:0] dx_r, dy_r, dz_r;
  logic signed [Wp-1:0] dx_half, dy_half, dz_half;
  assign dx_half = dx_q + Wp'(4);
  assign dy_half = dy_q + Wp'(4);
  assign dz_half = dz_q + Wp'(4);
  assign dx_r = (Wp - Guard)'(dx_half >>> Guard);
  assign dy_r = (Wp - Guard)'(dy_half >>> Guard);
  assign dz_r = (Wp - Guard)'(dz_half >>> Guard);
  logic signed [Wp-Guard-1:0] dx_q2, dy_q2, dz_q2;
  always_ff @(posedge clk_i) begin
    dx_q2 <= dx_r;
    dy_q2 <= dy_r;
    dz_q2 <= dz_r;
  end
  logic [2:0] out_beyond;
  lipp_saturate #(.From(Wp - Guard), .To(W)) i_dx (
    .clk_i, .d_i(dx_q2), .q_o(dx_o), .beyond_o(out_beyond[0])
  );
  lipp_saturate #(.From(Wp - Guard), .To(W)) i_dy (
    .clk_i, .d_i(dy_q2), .q_o(dy_o), .beyond_o(out_beyond[1])
  );
  lipp_saturate #(.From(Wp - Guard), .To(W)) i_dz (
    .clk_i, .d_i(dz_q2), .q_o(dz_o), .beyond_o(out_beyond[2])
  );

  logic over;
  lipp_delay #(.Width(2), .Cycles(dome_latency(F) - mul_latency(Wf, Wf) - 2)) i_reflected (
    .clk_i, .d_i({reflected_q, over_q}), .q_o({reflected_o, over})
  );
  lipp_delay #(.Width(1), .Cycles(dome_latency(F) - BendLatency)) i_bend_beyond (
    .clk_i, .d_i(bend_beyond_q), .q_o(bend_beyond)
  );
  assign beyond_o = over || (!reflected_o && (bend_beyond || |out_beyond));

endmodule

`default_nettype wire
