// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 5 of the ray trace: intersects the ray with the dome.
///
/// The dome is a part of a sphere. Lengths are in radii of curvature, and the sphere's centre is
/// the origin. The ray starts at V = (hx, hy, zc) in the unit direction d = (dx, dy, +-dz). With b
/// = V . d, the cosine between the ray and the normal at the intersection is
///
///   cos = sqrt(1 - |V|^2 + b^2).
///
/// The length from V to the intersection is cos - b for an upward ray, which leaves the glass, and
/// -b - cos for a downward ray, which enters the glass. The intersection is also the unit normal N,
/// because the sphere has radius 1 and its centre is the origin. In the formulas all words are
/// integers, a b >> k is the product of `lipp_multiplier` truncated by k bits, and M = 2^(F+3) - 1.
/// The steps are
///
///   b    = ((hx dx >> F-4+E) + (hy dy >> F-4+E) + (zc dz >> F-4+3E) + 1) >> 1
///   C    = (1 - zc^2) - (hx hx >> F-3) - (hy hy >> F-3) + (b b >> F+5)
///   cos  = sqrt(min(max(C, 0), M)),  s = min(max(2^(F+3) - C, 0), M)
///   l    = (8 cos - b + 8) >> 4,  downward (-8 cos - b + 8) >> 4, missed (2^(F+3) - b + 8) >> 4
///   N_x  = saturate(((hx << 4) + (l dx >> F-3+E) + 4) >> 3),  N_y likewise
///   N_z  = saturate(((zc << 4) + (l dz >> F-3+3E) + 4) >> 3).
///
/// Words dx and dy have F + 1 + E fraction bits with E = extra_bits(F), and dz has F + 1 + 3 E.
/// Word b has F + 4 fraction bits, C and s = sin^2 have F + 3, cos and N have F + 1, and l has F.
/// Output missed_o reports C < 0. Output beyond_o reports that b or l does not fit its word, that C
/// is above 1, or, for a ray that is not missed, that a coordinate of N is outside [-1, 1].
/// Rounding errors do not set beyond_o. A downward ray starts in the plane of the domes' vertices
/// (zc = 1) with dz = -dz_i. For a downward ray, the products with dz_i are truncated before they
/// are subtracted. A downward ray that misses the sphere continues for half a radius from its point
/// nearest to the centre. From the end of this half radius, `lipp_cell_step` leads to the dome that
/// the ray meets next. The latency is meet_dome_latency(F) clocks.
module lipp_meet_dome #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // 1: cross terms use multiplier cells
  parameter bit Upward = 1'b1,
  localparam int E = lipp_optics_pkg::extra_bits(F),
  localparam int Wt = F + 2 + E,
  localparam int Wz = F + 2 + 3 * E
) (
  input  logic                 clk_i,
  input  logic signed [F+2:0]  hx_i,  // x of start point V in radii, F fraction bits
  input  logic signed [F+2:0]  hy_i,
  input  logic signed [Wt-1:0] dx_i,
  input  logic signed [Wt-1:0] dy_i,
  input  logic signed [Wz-1:0] dz_i,
  input  logic signed [F+3:0]  zc_i,  // z of start point V in radii, F fraction bits
  input  logic signed [F+8:0]  oz_i,  // 1 - zc^2, F + 3 fraction bits
  output logic signed [F+1:0]  nx_o,  // intersection and unit normal N, F + 1 fraction bits
  output logic signed [F+1:0]  ny_o,
  output logic signed [F+1:0]  nz_o,
  output logic signed [F+1:0]  cos_o,
  output logic signed [F+3:0]  s_o,  // squared sine 1 - cos^2, F + 3 fraction bits
  output logic                 missed_o,
  output logic                 beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wh = W + 1;
  localparam int Wf = W + 2;
  localparam int Wb = Wf + 4;  // width of b, which has four more fraction bits than V
  localparam int FootLatency = foot_latency(F);

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_meet_dome: F must be 14 to 23");
  end

  // ---- compute b, the distance to V from the ray's point nearest to the centre ----
  localparam int DotDrop = F - 1 - Guard;  // truncated bits, besides the E or 3 E extra bits of d
  localparam int Wd = Wf + W - DotDrop;
  logic signed [Wd-1:0] bx, by, bz, bz_late, bxy_q, b_sum_q;
  logic signed [Wh+W-DotDrop-1:0] bx_early, by_early;
  logic signed [Wd-2:0] b_d;
  logic signed [Wb-1:0] b_q;
  logic b_beyond_q;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wh), .Wb(Wt), .Drop(DotDrop + E)) i_bx (
    .clk_i, .a_i(hx_i), .b_i(dx_i), .p_o(bx_early)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wh), .Wb(Wt), .Drop(DotDrop + E)) i_by (
    .clk_i, .a_i(hy_i), .b_i(dy_i), .p_o(by_early)
  );
  lipp_delay #(.Width(2 * Wd), .Cycles(axial_latency(F) - mul_latency(Wh, Wt))) i_bxy (
    .clk_i, .d_i({Wd'(bx_early), Wd'(by_early)}), .q_o({bx, by})
  );
  if (Upward) begin : gen_bz
    lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(Wz), .Drop(DotDrop + 3 * E)) i_bz (
      .clk_i, .a_i(zc_i), .b_i(dz_i), .p_o(bz)
    );
    lipp_delay #(.Width(Wd), .Cycles(1)) i_bz_match (.clk_i, .d_i(bz), .q_o(bz_late));
  end else begin : gen_dz
    lipp_delay #(.Width(Wd), .Cycles(axial_latency(F) + 1)) i_bz_match (
      .clk_i, .d_i(-((Wd'(dz_i) <<< 4) >>> (3 * E))), .q_o(bz_late)
    );
    assign bz = '0;
    logic unused_bz;
    assign unused_bz = ^{bz, zc_i, oz_i};
  end
  assign b_d = (Wd - 1)'((b_sum_q + Wd'(1)) >>> 1);
  always_ff @(posedge clk_i) begin
    bxy_q <= bx + by;
    b_sum_q <= bxy_q + bz_late;
    b_q <= Wb'(b_d);
    b_beyond_q <= b_d != (Wd - 1)'($signed(b_d[Wb-1:0]));
  end

  // ---- compute C, the squared cosine ----
  localparam int SquareDrop = F - 3;
  localparam int Ws = 2 * Wf - SquareDrop;
  logic signed [2*Wh-SquareDrop-1:0] hx2, hy2;
  logic signed [Ws-1:0] h2_q, origin_term_q, origin_term, b2, c_q;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wh), .Wb(Wh), .Drop(SquareDrop),
      .Square(1'b1)) i_hx2 (
    .clk_i, .a_i(hx_i), .b_i(hx_i), .p_o(hx2)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wh), .Wb(Wh), .Drop(SquareDrop),
      .Square(1'b1)) i_hy2 (
    .clk_i, .a_i(hy_i), .b_i(hy_i), .p_o(hy2)
  );
  always_ff @(posedge clk_i) begin
    h2_q <= Ws'(hx2) + Ws'(hy2);
    origin_term_q <= (Upward ? Ws'(oz_i) : '0) - h2_q;
  end
  lipp_delay #(
    .Width(Ws),
    .Cycles(FootLatency + mul_latency(Wb, Wb) - mul_latency(Wh, Wh) - 2)
  ) i_rest (.clk_i, .d_i(origin_term_q), .q_o(origin_term));
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(Wb), .Wb(Wb), .Drop(SquareDrop + 8), .Square(1'b1)
  ) i_b2 (
    .clk_i, .a_i(b_q), .b_i(b_q), .p_o(b2)
  );
  always_ff @(posedge clk_i) c_q <= origin_term + b2;

  // ---- compute the cosine and the squared sine ----
  // In one clock C is classified and in the next clock the results are selected, because both
  // together would be too slow.
  localparam logic [F+2:0] Most = '1;
  localparam logic signed [Ws-1:0] OverOne = (Ws'(1) <<< (F + 3)) + (Ws'(1) <<< SquareSlack);
  logic [F+2:0] low_q, minus_q, clamped_q, s_q;
  logic above_q, missed_q, missed_q2, over_q, over_q2;
  logic [1:0] zero_q;  // bits 0, 1: lower and upper half of C are 0
  always_ff @(posedge clk_i) begin
    missed_q <= c_q[Ws-1];
    above_q <= !c_q[Ws-1] && c_q[Ws-2:F+3] != '0;
    zero_q <= {c_q[Ws-1:F/2] == '0, c_q[F/2-1:0] == '0};
    over_q <= c_q >= OverOne;
    low_q <= (F + 3)'(c_q);
    // minus_q is 1 - C modulo 1. If the cosine is 0, the squared sine is limited to just below 1.
    minus_q <= (F + 3)'(-c_q);
    {missed_q2, over_q2} <= {missed_q, over_q};
    clamped_q <= missed_q ? '0 : above_q ? Most : low_q;
    s_q <= missed_q || &zero_q ? Most : above_q ? '0 : minus_q;
  end
  logic signed [W-1:0] cos;
  lipp_sqrt #(.F(F), .Normalise(1'b1)) i_sqrt (.clk_i, .x_i(clamped_q), .y_o(cos));

  // ---- compute l, the length of the path to the dome ----
  localparam int LengthLatency = mul_latency(Wb, Wb) + 3 + sqrt_latency(1'b1);  // delay: b to cos
  localparam int Wl = Wb + 1;
  logic signed [Wb-1:0] b_late;
  logic signed [Wl-1:0] scaled_cos, length_d;
  logic signed [Wl-5:0] length;
  logic signed [Wf-1:0] length_q;
  logic signed [W-1:0] cos_q, cos_q2;
  logic b_beyond_late, b_beyond_q2, length_beyond_q;
  logic [Wl-4-Wf:0] length_top_q;  // sign of l, and the upper bits that do not fit its word
  lipp_delay #(.Width(Wb + 1), .Cycles(LengthLatency)) i_b (
    .clk_i, .d_i({b_q, b_beyond_q}), .q_o({b_late, b_beyond_late})
  );
  assign scaled_cos = Wl'(cos) <<< 3;
  assign length_d = (Upward ? scaled_cos : -scaled_cos) - Wl'(b_late);
  // For a missed ray the cosine is set to 0.
  logic missed_late;
  if (Upward) begin : gen_stay
    assign missed_late = 1'b0;
  end else begin : gen_go_on
    lipp_delay #(.Width(1), .Cycles(sqrt_latency(1'b1))) i_missed (
      .clk_i, .d_i(missed_q2), .q_o(missed_late)
    );
  end
  assign length = (Wl - 4)'((length_d + (Wl'(8) | (Wl'(missed_late) <<< (F + 3)))) >>> 4);
  always_ff @(posedge clk_i) begin
    length_q <= Wf'(length);
    length_top_q <= length[Wl-5:Wf-1];
    b_beyond_q2 <= b_beyond_late;
    length_beyond_q <= b_beyond_q2 || (|length_top_q && !(&length_top_q));
    {cos_q, cos_q2} <= {cos, cos_q};
  end

  // ---- compute the intersection N, which is also the normal ----
  localparam int PointDrop = F - Guard;
  localparam int Wn = Wf + W - PointDrop;
  localparam int ReachLatency = FootLatency + LengthLatency + 1;
  logic signed [Wh-1:0] hx_late, hy_late;
  logic signed [Wt-1:0] dx_late, dy_late;
  logic signed [Wz-1:0] dz_late;
  logic signed [Wn-1:0] lx, ly, lx_early, ly_early, lz, nx_q, ny_q, nz_q;
  lipp_delay #(.Width(2 * Wt + Wz), .Cycles(ReachLatency)) i_d (
    .clk_i, .d_i({dx_i, dy_i, dz_i}), .q_o({dx_late, dy_late, dz_late})
  );
  lipp_delay #(.Width(2 * Wh), .Cycles(ReachLatency + axial_latency(F))) i_h (
    .clk_i, .d_i({hx_i, hy_i}), .q_o({hx_late, hy_late})
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(Wt), .Drop(PointDrop + E)) i_lx (
    .clk_i, .a_i(length_q), .b_i(dx_late), .p_o(lx_early)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(Wt), .Drop(PointDrop + E)) i_ly (
    .clk_i, .a_i(length_q), .b_i(dy_late), .p_o(ly_early)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(Wz), .Drop(PointDrop + 3 * E)) i_lz (
    .clk_i, .a_i(length_q), .b_i(dz_late), .p_o(lz)
  );
  lipp_delay #(.Width(2 * Wn), .Cycles(axial_latency(F) - mul_latency(Wf, Wt))) i_lxy (
    .clk_i, .d_i({lx_early, ly_early}), .q_o({lx, ly})
  );
  // The word V << 4 ends in four zero bits. Setting bit 2 adds the rounding constant 4.
  localparam logic signed [Wn-1:0] One = Wn'(1) <<< (F + 4);
  always_ff @(posedge clk_i) begin
    nx_q <= ((Wn'(hx_late) <<< 4) | Wn'(4)) + lx;
    ny_q <= ((Wn'(hy_late) <<< 4) | Wn'(4)) + ly;
    nz_q <= Upward ? ((Wn'(zc_i) <<< 4) | Wn'(4)) + lz : (One | Wn'(4)) - lz;
  end
  logic [2:0] point_beyond;
  lipp_saturate #(.From(Wn - Guard), .To(W)) i_nx (
    .clk_i, .d_i((Wn - Guard)'(nx_q >>> Guard)), .q_o(nx_o), .beyond_o(point_beyond[0])
  );
  lipp_saturate #(.From(Wn - Guard), .To(W)) i_ny (
    .clk_i, .d_i((Wn - Guard)'(ny_q >>> Guard)), .q_o(ny_o), .beyond_o(point_beyond[1])
  );
  lipp_saturate #(.From(Wn - Guard), .To(W)) i_nz (
    .clk_i, .d_i((Wn - Guard)'(nz_q >>> Guard)), .q_o(nz_o), .beyond_o(point_beyond[2])
  );

  // ---- delay earlier results to align them with N ----
  localparam int PointLatency = axial_latency(F) + 2;
  logic length_beyond, over;
  lipp_delay #(.Width(W + 1), .Cycles(PointLatency - 1)) i_cos (
    .clk_i, .d_i({cos_q2, length_beyond_q}), .q_o({cos_o, length_beyond})
  );
  logic [F+2:0] s_late;
  assign s_o = $signed({1'b0, s_late});
  lipp_delay #(.Width(F + 5), .Cycles(sqrt_latency(1'b1) + PointLatency + 1)) i_s (
    .clk_i, .d_i({s_q, missed_q2, over_q2}), .q_o({s_late, missed_o, over})
  );
  assign beyond_o = length_beyond || over || (!missed_o && |point_beyond);

endmodule

`default_nettype wire
