// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 6 of the ray trace (plano side to the viewer): traces the ray from the dome to the flat
/// face, and refracts the ray out of the glass.
///
/// The dome's vertex is at z = 0. Lengths are in radii of curvature R. The ray starts at the point
/// N on the dome, at z = N_z - 1, and follows the direction d to the flat face at z = -T/R, where T
/// is the thickness of the lenslet. In the formulas all words are integers, a b >> k is the product
/// of `lipp_multiplier` truncated by k bits, and M = 2^(F+3) - 1. The steps are
///
///   g    = max((dx dx >> F-3) + (dy dy >> F-3), 0) >> 2
///   y    = M - g
///   r    = min(rsqrt(y), 2^(F+1) - 1)
///   u    = (N_z + 1 - 2 zc) >> 1
///   l    = ((u r >> F-1) + 1) >> 1
///   X    = ((N_x << 3) + (l dx >> F-3) + 4) >> 3,  Y likewise
///   C'   = 2^(F+3) - (g n2 >> F)
///   d'_x = saturate(((dx n >> F-3) + 4) >> 3),  d'_y likewise
///   d'_z = sqrt(min(max(C', 0), M)),  reflected ((y r >> F+1) + 1) >> 1.
///
/// Word g is the squared sine and y the squared cosine in the glass; g, y and C' have F + 3
/// fraction bits. `lipp_rsqrt` reads the bits of y as 4 y, so r = 1 / (2 dz). Word u is the axial
/// distance from N to the flat face, zc = 1 - T/R, and l is the length of the path. The words u,
/// zc, l, n and n2 = n^2 have F fraction bits. Directions, N, r, X and Y have F + 1 fraction bits.
/// Output reflected_o reports total internal reflection, C' <= 0; such a ray keeps its direction in
/// the glass. Output beyond_o reports that g is 1 or more, or that C' is above 1. For a ray that is
/// not reflected, beyond_o also reports that y is below 1/4 (an illegal input of `lipp_rsqrt`),
/// that u, l, X or Y does not fit its word, or that d'_x or d'_y is outside [-1, 1]. Rounding
/// errors do not set beyond_o. The latency is leave_flat_latency(F) clocks.
module lipp_leave_flat #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0  // 1: cross terms use multiplier cells
) (
  input  logic                clk_i,
  input  logic signed [F+1:0] nx_i,  // unit normal N, F + 1 fraction bits
  input  logic signed [F+1:0] ny_i,
  input  logic signed [F+1:0] nz_i,
  input  logic signed [F+1:0] dx_i,  // direction d in the glass, F + 1 fraction bits
  input  logic signed [F+1:0] dy_i,
  input  logic signed [F+3:0] zc_i,            // zc = 1 - T/R, F fraction bits
  input  logic signed [F+2:0] index_i,         // refractive index n, F fraction bits
  input  logic signed [F+3:0] index_square_i,  // n^2, F fraction bits
  output logic signed [F+3:0] x_o,   // point (X, Y) on the flat face, F + 1 fraction bits
  output logic signed [F+3:0] y_o,
  output logic signed [F+1:0] dx_o,  // direction d' of the exit ray, F + 1 fraction bits
  output logic signed [F+1:0] dy_o,
  output logic signed [F+1:0] dz_o,
  output logic                reflected_o,
  output logic                beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wf = W + 2;
  localparam int Total = leave_flat_latency(F);

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_leave_flat: F must be 14 to 23");
  end

  // ---- compute g, the squared sine in the glass ----
  localparam int SquareDrop = F - 3;
  localparam int Wq = 2 * W - SquareDrop;
  localparam int SquareLatency = mul_latency(W, W) + 2;
  localparam int SineLatency = SquareLatency + mul_latency(Wf, Wf) + 2;
  logic signed [Wq-1:0] dx2, dy2;
  logic signed [Wq:0] sum_q;
  logic [Wq-2:0] g_d;
  logic [F+2:0] cos2_q, g_q;
  logic reflects_q, reflects, steep;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(SquareDrop),
      .Square(1'b1)) i_dx2 (
    .clk_i, .a_i(dx_i), .b_i(dx_i), .p_o(dx2)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(SquareDrop),
      .Square(1'b1)) i_dy2 (
    .clk_i, .a_i(dy_i), .b_i(dy_i), .p_o(dy2)
  );
  assign g_d = sum_q[Wq] ? '0 : sum_q[Wq:2];
  always_ff @(posedge clk_i) begin
    sum_q <= (Wq + 1)'(dx2) + (Wq + 1)'(dy2);
    cos2_q <= ~(F + 3)'(g_d);
    g_q <= (F + 3)'(g_d);
    reflects_q <= |g_d[Wq-2:F+3];
  end
  lipp_delay #(.Width(2), .Cycles(SineLatency - SquareLatency)) i_steep (
    .clk_i, .d_i({reflects_q, cos2_q[F+2:F+1] == '0}), .q_o({reflects, steep})
  );

  // ---- compute l, the length of the path to the flat face ----
  localparam int PathDrop = F - 2 + 1;
  localparam int Wl = Wf + W - PathDrop;
  logic [F+1:0] inverse;
  logic signed [W-1:0] half_inverse;  // r, limited because its word cannot contain 1
  logic signed [Wf-1:0] depth_early_q, depth, path_q;
  logic signed [Wl-1:0] path;
  logic signed [Wl-2:0] path_d;
  logic depth_beyond_q, depth_beyond, depth_beyond_late, path_beyond_q, path_beyond;
  lipp_rsqrt #(.F(F)) i_rsqrt (.clk_i, .x_i(cos2_q), .y_o(inverse));
  assign half_inverse = inverse[F+1] ? {1'b0, {(F + 1){1'b1}}} : $signed(inverse);
  // floor((nz + 1) / 2) - zc is computed as floor((nz + (1 - 2 zc)) / 2), which saves an adder.
  logic signed [Wf+1:0] half_less_zc_q, depth_d;
  assign depth_d = (Wf + 2)'(nz_i) + half_less_zc_q;
  always_ff @(posedge clk_i) begin
    half_less_zc_q <= (Wf + 2)'(1) - ((Wf + 2)'(zc_i) <<< 1);
    depth_early_q <= Wf'(depth_d >>> 1);
    depth_beyond_q <= depth_d != (Wf + 2)'($signed(depth_d[Wf:0]));
  end
  lipp_delay #(.Width(Wf + 1), .Cycles(SquareLatency + rsqrt_latency() - 1)) i_depth (
    .clk_i, .d_i({depth_early_q, depth_beyond_q}), .q_o({depth, depth_beyond})
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(W), .Drop(PathDrop)) i_path (
    .clk_i, .a_i(depth), .b_i(half_inverse), .p_o(path)
  );
  lipp_delay #(.Width(1), .Cycles(mul_latency(Wf, W))) i_depth_beyond (
    .clk_i, .d_i(depth_beyond), .q_o(depth_beyond_late)
  );
  assign path_d = (Wl - 1)'((path + Wl'(1)) >>> 1);
  always_ff @(posedge clk_i) begin
    path_q <= Wf'(path_d);
    path_beyond_q <= depth_beyond_late || path_d != (Wl - 1)'($signed(path_d[Wf-1:0]));
  end

  // ---- compute X and Y, the point on the flat face ----
  localparam int PathLatency = SquareLatency + rsqrt_latency() + mul_latency(Wf, W) + 1;
  localparam int PointDrop = F - Guard;
  localparam int Wx = Wf + W - PointDrop;
  localparam int PointLatency = PathLatency + mul_latency(Wf, W) + 2;
  logic signed [W-1:0] dx_late, dy_late, nx_late, ny_late;
  logic signed [Wx-1:0] lx, ly, x_q, y_q;
  logic signed [Wx-Guard-1:0] x, y;
  logic signed [Wf-1:0] x_q2, y_q2;
  logic point_beyond_q, point_beyond;
  lipp_delay #(.Width(2 * W), .Cycles(PathLatency)) i_d (
    .clk_i, .d_i({dx_i, dy_i}), .q_o({dx_late, dy_late})
  );
  lipp_delay #(.Width(2 * W), .Cycles(PathLatency + mul_latency(Wf, W))) i_n (
    .clk_i, .d_i({nx_i, ny_i}), .q_o({nx_late, ny_late})
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(W), .Drop(PointDrop)) i_lx (
    .clk_i, .a_i(path_q), .b_i(dx_late), .p_o(lx)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(W), .Drop(PointDrop)) i_ly (
    .clk_i, .a_i(path_q), .b_i(dy_late), .p_o(ly)
  );
  always_ff @(posedge clk_i) begin
    x_q <= ((Wx'(nx_late) <<< Guard) | Wx'(4)) + lx;
    y_q <= ((Wx'(ny_late) <<< Guard) | Wx'(4)) + ly;
    x_q2 <= Wf'(x);
    y_q2 <= Wf'(y);
    point_beyond_q <= path_beyond || x != (Wx - Guard)'($signed(x[Wf-1:0]))
        || y != (Wx - Guard)'($signed(y[Wf-1:0]));
  end
  assign x = (Wx - Guard)'(x_q >>> Guard);
  assign y = (Wx - Guard)'(y_q >>> Guard);
  lipp_delay #(.Width(1), .Cycles(mul_latency(Wf, W) + 1)) i_path_beyond (
    .clk_i, .d_i(path_beyond_q), .q_o(path_beyond)
  );
  lipp_delay #(.Width(2 * Wf + 1), .Cycles(Total - PointLatency)) i_point (
    .clk_i, .d_i({x_q2, y_q2, point_beyond_q}), .q_o({x_o, y_o, point_beyond})
  );

  // ---- compute the direction in the air ----
  localparam int SineDrop = F;
  localparam int Ws = 2 * Wf - SineDrop;
  localparam logic [F+2:0] Most = '1;
  logic signed [Ws-1:0] sine, c_q;
  // The upper bits detect an overflow; a comparator would add a carry chain to the timing path.
  logic above;
  assign above = !c_q[Ws-1] && c_q[Ws-2:F+3] != '0;
  logic [F+2:0] clamped_q;
  localparam logic signed [Ws-1:0] OverOne = (Ws'(1) <<< (F + 3)) + (Ws'(1) <<< SquareSlack);
  logic reflected_q, reflected, over_q, over_late, steep_late;
  logic signed [W-1:0] dz_air_early, dz_air;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(Wf), .Drop(SineDrop)) i_sine (
    .clk_i, .a_i($signed({1'b0, g_q})), .b_i(index_square_i), .p_o(sine)
  );
  always_ff @(posedge clk_i) begin
    c_q <= (Ws'(1) <<< (F + 3)) - sine;
    reflected_q <= c_q <= 0;
    over_q <= c_q >= OverOne;
    clamped_q <= c_q[Ws-1] ? '0 : above ? Most : (F + 3)'(c_q);
  end
  lipp_sqrt #(.F(F), .Normalise(1'b1)) i_sqrt (.clk_i, .x_i(clamped_q), .y_o(dz_air_early));

  localparam int OutDrop = F - Guard;
  localparam int Wo = 2 * W + 1 - OutDrop;
  logic signed [Wo-1:0] ox, oy;
  logic signed [Wo-1:0] ox_q, oy_q;
  logic signed [W-1:0] dx_air, dy_air, dx_air_late, dy_air_late;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W + 1), .Drop(OutDrop)) i_ox (
    .clk_i, .a_i(dx_i), .b_i(index_i), .p_o(ox)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W + 1), .Drop(OutDrop)) i_oy (
    .clk_i, .a_i(dy_i), .b_i(index_i), .p_o(oy)
  );
  always_ff @(posedge clk_i) begin
    ox_q <= ox + Wo'(4);
    oy_q <= oy + Wo'(4);
  end
  logic dx_beyond, dy_beyond, air_beyond;
  lipp_saturate #(.From(Wo - Guard), .To(W)) i_dx (
    .clk_i, .d_i((Wo - Guard)'(ox_q >>> Guard)), .q_o(dx_air), .beyond_o(dx_beyond)
  );
  lipp_saturate #(.From(Wo - Guard), .To(W)) i_dy (
    .clk_i, .d_i((Wo - Guard)'(oy_q >>> Guard)), .q_o(dy_air), .beyond_o(dy_beyond)
  );

  // ---- compute the direction of a reflected ray ----
  localparam int GlassDrop = F + 1;
  localparam int Wg = Wf + W - GlassDrop;
  logic signed [Wf-1:0] cos2_late;
  logic signed [Wg-1:0] glass;
  logic signed [W-1:0] dz_glass_q, dz_glass, dx_glass, dy_glass;
  lipp_delay #(.Width(Wf), .Cycles(rsqrt_latency())) i_rest (
    .clk_i, .d_i({1'b0, cos2_q}), .q_o(cos2_late)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wf), .Wb(W), .Drop(GlassDrop)) i_glass (
    .clk_i, .a_i(cos2_late), .b_i(half_inverse), .p_o(glass)
  );
  always_ff @(posedge clk_i) dz_glass_q <= W'((glass + Wg'(1)) >>> 1);

  localparam int Last = Total - 1;
  lipp_delay #(.Width(W), .Cycles(Last - PathLatency)) i_dz_glass (
    .clk_i, .d_i(dz_glass_q), .q_o(dz_glass)
  );
  lipp_delay #(.Width(2 * W), .Cycles(Last)) i_d_glass (
    .clk_i, .d_i({dx_i, dy_i}), .q_o({dx_glass, dy_glass})
  );
  lipp_delay #(.Width(2 * W + 1), .Cycles(Last - mul_latency(W, W + 1) - 2)) i_d_air (
    .clk_i, .d_i({dx_air, dy_air, dx_beyond || dy_beyond}),
    .q_o({dx_air_late, dy_air_late, air_beyond})
  );
  lipp_delay #(.Width(W), .Cycles(Last - SineLatency - sqrt_latency(1'b1))) i_dz_air (
    .clk_i, .d_i(dz_air_early), .q_o(dz_air)
  );
  lipp_delay #(.Width(3), .Cycles(Last - SineLatency)) i_reflected (
    .clk_i, .d_i({reflected_q, over_q || reflects, steep}), .q_o({reflected, over_late, steep_late})
  );
  logic beyond_q;
  always_ff @(posedge clk_i) begin
    dx_o <= reflected ? dx_glass : dx_air_late;
    dy_o <= reflected ? dy_glass : dy_air_late;
    dz_o <= reflected ? dz_glass : dz_air;
    reflected_o <= reflected;
    beyond_q <= over_late || (!reflected && (steep_late || air_beyond));
  end
  assign beyond_o = beyond_q || (!reflected_o && point_beyond);

endmodule

`default_nettype wire
