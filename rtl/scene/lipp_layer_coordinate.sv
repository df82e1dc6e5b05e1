// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes the texture coordinate (s, t) at which a ray's line meets a layer.
///
/// In the formulas all words are integers, and a b >> k is the product of `lipp_row_multiplier`
/// truncated by k bits. (x, y) is where the ray's line meets z = 0, and (s0, t0), a, b, c, d and
/// depth are registers of the layer. The steps are
///
///   X'  = (2 (infinite ? 0 : x) + 1 + (depth slope_x >> F)) >> 1       F - 3 fraction bits
///   Y'  = (2 (infinite ? 0 : y) + 1 + (depth slope_y >> F)) >> 1
///   s_o = (s0 + h + (a X' >> A+F-19) + (b Y' >> A+F-19)) >> 8           8 fraction bits
///   t_o = (t0 + h + (c X' >> A+F-19) + (d Y' >> A+F-19)) >> 8.
///
/// A build reads the upper A = coefficient_bits(F) of the 24 fraction bits of a, b, c and d, and
/// the upper F - 3 of the 20 fraction bits of depth. With Bilinear = 1, h = 2^7 - 2^15, which
/// subtracts half a texel and rounds. With Bilinear = 0, h = 0, so that the integer part of s_o is
/// floor(s). Output beyond_o reports that X' or Y' is outside [-2048, 2048), or that s_o or t_o
/// does not fit its word.
///
/// Let ds be the error of s before its last truncation, in texels, relative to an exact computation
/// from the same line and registers. The bound of ds is
///
///   |ds| <= (|a| + |b|) (2^-(F-2) + |depth| 2^-(F+2)) + 2^-15 + [F < 20] 2^-A (|X'| + |Y'|).
///
/// The last term of the bound is present only in builds with F < 20, which truncate a and b. At F =
/// 23, |ds| is therefore at most 2^-12 if |a| + |b| <= 128 and (|a| + |b|) |depth| <= 4096. At F =
/// 16, the optics' direction error is 14 urad, twice a slope's last bit. The latency is
/// layer_latency(F) clocks.
module lipp_layer_coordinate #(
  parameter int F = 16,
  parameter bit Bilinear = 1'b0
) (
  input  logic                                clk_i,
  input  logic signed [F+8:0]                 x_i,  // x of the line at z = 0, F - 3 fraction bits
  input  logic signed [F+8:0]                 y_i,
  input  logic signed [F+3:0]                 slope_x_i,  // slope dx / dz, F + 1 fraction bits
  input  logic signed [F+3:0]                 slope_y_i,
  input  logic signed [31:0]                  s0_i,  // s0 in texels, 16 fraction bits
  input  logic signed [31:0]                  t0_i,
  input  logic signed [31:0]                  depth_i,  // depth in radii, 20 fraction bits
  input  logic signed [31:0]                  a_i,  // a, texels per radius, 24 fraction bits
  input  logic signed [31:0]                  b_i,
  input  logic signed [31:0]                  c_i,
  input  logic signed [31:0]                  d_i,
  input  logic                                infinite_i,
  output logic signed [lipp_scene_pkg::CoordinateBits-1:0] s_o,  // coordinate s in 2^-8 texels
  output logic signed [lipp_scene_pkg::CoordinateBits-1:0] t_o,
  output logic                                beyond_o
);
  import lipp_math_pkg::*;
  import lipp_scene_pkg::*;

  localparam int Wx = F + 9;
  localparam int Wl = F + 4;
  localparam int Coefficient = coefficient_bits(F);
  localparam int Wa = Coefficient + 8;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_layer_coordinate: F must be 14 to 23");
  end

  // ---- intersect the line with the layer's plane ----
  localparam int DepthLatency = row_latency(Wx, Wl);
  localparam int Wp = Wx + Wl - F;
  localparam int Ws = Wp + 2;
  logic signed [Wx-1:0] depth, x_late, y_late;
  logic signed [Wp-1:0] step_x, step_y;
  logic [Ws-1:0] plane_x, plane_y;
  logic signed [Ws-1:0] plane_x_q, plane_y_q;
  assign depth = Wx'(depth_i >>> (32 - Wx));
  lipp_row_multiplier #(.Wa(Wx), .Wb(Wl), .Drop(F)) i_step_x (
    .clk_i, .a_i(depth), .b_i(slope_x_i), .p_o(step_x)
  );
  lipp_row_multiplier #(.Wa(Wx), .Wb(Wl), .Drop(F)) i_step_y (
    .clk_i, .a_i(depth), .b_i(slope_y_i), .p_o(step_y)
  );
  // For a sky layer, x and y are set to 0 after this delay, so that all layers can share one delay.
  lipp_delay #(.Width(2 * Wx), .Cycles(DepthLatency)) i_position (
    .clk_i, .d_i({x_i, y_i}), .q_o({x_late, y_late})
  );
  lipp_gated_sum #(.W(Ws)) i_plane_x (
    .a_i(Ws'($signed({x_late, 1'b1}))), .x_i({{(Ws - 1){!infinite_i}}, 1'b1}), .b_i(Ws'(step_x)),
    .y_i('1), .s_o(plane_x)
  );
  lipp_gated_sum #(.W(Ws)) i_plane_y (
    .a_i(Ws'($signed({y_late, 1'b1}))), .x_i({{(Ws - 1){!infinite_i}}, 1'b1}), .b_i(Ws'(step_y)),
    .y_i('1), .s_o(plane_y)
  );
  always_ff @(posedge clk_i) begin
    plane_x_q <= plane_x;
    plane_y_q <= plane_y;
  end

  // ---- convert the intersection to texels ----
  localparam int TexelLatency = row_latency(Wa, Wx);
  localparam int Drop = Coefficient + F - 19;
  localparam int Wt = Wa + Wx - Drop;  // width of a product with 16 fraction bits
  localparam logic signed [32:0] Half = Bilinear ? 33'sd128 - 33'sd32768 : 33'sd0;
  logic signed [Wx-1:0] at_x, at_y;
  logic signed [3:0][Wa-1:0] coefficient;
  logic signed [3:0][Wt-1:0] part;
  assign at_x = plane_x_q[Wx:1];
  assign at_y = plane_y_q[Wx:1];
  assign coefficient = {
    Wa'(a_i >>> (32 - Wa)), Wa'(b_i >>> (32 - Wa)), Wa'(c_i >>> (32 - Wa)), Wa'(d_i >>> (32 - Wa))
  };
  for (genvar k = 0; k < 4; k++) begin : gen_part
    lipp_row_multiplier #(.Wa(Wa), .Wb(Wx), .Drop(Drop)) i_part (
      .clk_i, .a_i(coefficient[k]), .b_i(k % 2 == 1 ? at_x : at_y), .p_o(part[k])
    );
  end

  // The modules lipp_gated_sum add three words with less logic than a sum that synthesis infers.
  logic signed [32:0] zero_s_q, zero_t_q;
  logic [Wt+1:0] parts_s, parts_t, sum_s, sum_t;
  logic signed [Wt+1:0] sum_s_q, sum_t_q;
  assign parts_s = (Wt + 2)'($signed(part[3])) + (Wt + 2)'($signed(part[2]));
  assign parts_t = (Wt + 2)'($signed(part[1])) + (Wt + 2)'($signed(part[0]));
  lipp_gated_sum #(.W(Wt + 2)) i_sum_s (
    .a_i(parts_s), .x_i('1), .b_i((Wt + 2)'(zero_s_q)), .y_i('1), .s_o(sum_s)
  );
  lipp_gated_sum #(.W(Wt + 2)) i_sum_t (
    .a_i(parts_t), .x_i('1), .b_i((Wt + 2)'(zero_t_q)), .y_i('1), .s_o(sum_t)
  );
  always_ff @(posedge clk_i) begin
    zero_s_q <= 33'(s0_i) + Half;
    zero_t_q <= 33'(t0_i) + Half;
    sum_s_q <= sum_s;
    sum_t_q <= sum_t;
  end

  // ---- output the coordinate, and check its range ----
  localparam int Top = CoordinateBits + 7;  // index of the sum's bit that is the coordinate's sign
  logic off_plane_q, off_plane, off_texels;
  always_ff @(posedge clk_i) begin
    off_plane_q <= plane_x_q[Ws-1:Wx] != {(Ws - Wx){plane_x_q[Ws-1]}}
        || plane_y_q[Ws-1:Wx] != {(Ws - Wx){plane_y_q[Ws-1]}};
  end
  assign off_texels = sum_s_q[Wt+1:Top] != {(Wt + 2 - Top){sum_s_q[Wt+1]}}
      || sum_t_q[Wt+1:Top] != {(Wt + 2 - Top){sum_t_q[Wt+1]}};
  assign s_o = sum_s_q[Top:8];
  assign t_o = sum_t_q[Top:8];
  assign beyond_o = off_plane || off_texels;
  lipp_delay #(.Width(1), .Cycles(TexelLatency)) i_off_plane (
    .clk_i, .d_i(off_plane_q), .q_o(off_plane)
  );
  logic unused_bits;
  assign unused_bits = ^{plane_x_q[0], plane_y_q[0], sum_s_q[7:0], sum_t_q[7:0]};

endmodule

`default_nettype wire
