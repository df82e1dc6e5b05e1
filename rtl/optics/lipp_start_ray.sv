// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3 of the ray trace: computes a ray's slope, unit direction, and point on the first face.
///
/// The inputs are the pixel (x, y) and the aperture point (a, b), the outputs of
/// `lipp_pixel_to_lens`. In builds with the exact lens model and converge = 0, the slope is a
/// coefficient times a - x. In other builds the slope has one coefficient for x and one for a.
///
/// The point (hx_o, hy_o) is in radii with F fraction bits. The point's latency is slope_latency(F,
/// Converge, Shear) clocks. Output flat_beyond_o has the latency of the point and reports that the
/// slope or the point is out of range. The direction (ex_o, ey_o, ez_o) has F + 1 + air_bits(Build)
/// fraction bits and is valid unit_latency(F) clocks after the point. Output steep_o has the
/// direction's latency and reports a slope of 60 degrees or more. Output difference_o reports that
/// a - x or b - y is out of range; its latency is 1 clock.
module lipp_start_ray #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits),
  localparam int Wx = lipp_optics_pkg::local_bits(F, Build.converge, Build.shear),
  localparam int Wa = lipp_optics_pkg::local_bits(F, 1'b0, Build.shear),
  localparam int Wm = F + 2 + lipp_optics_pkg::air_bits(Build)
) (
  input  logic                            clk_i,
  input  lipp_optics_pkg::optics_config_t config_i,
  input  logic signed [Wx-1:0]            x_i,
  input  logic signed [Wx-1:0]            y_i,
  input  logic signed [Wa-1:0]            a_i,
  input  logic signed [Wa-1:0]            b_i,
  output logic                            difference_o,
  output logic signed [F+2:0]             hx_o,
  output logic signed [F+2:0]             hy_o,
  output logic                            flat_beyond_o,
  output logic signed [Wm-1:0]            ex_o,
  output logic signed [Wm-1:0]            ey_o,
  output logic signed [Wm-1:0]            ez_o,
  output logic                            steep_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wh = W + 1;
  localparam bit Aims = Build.aims;
  localparam bit CrossCells = Build.cross_cells;
  localparam bit SlopeAims = slope_aims(Build);
  localparam bit Difference = Build.model == 2'(ModelExact) && !Build.converge;
  // A build uses only some fields of config_i.
  logic unused_config;
  assign unused_config = ^config_i;

  logic signed [Wx:0] towards_x_d, towards_y_d;
  logic signed [Wa-1:0] a_q, b_q;
  logic signed [Wx-1:0] x_q, y_q, from_x_q, from_y_q;
  assign towards_x_d = (Wx + 1)'(a_i) - (Wx + 1)'(x_i);
  assign towards_y_d = (Wx + 1)'(b_i) - (Wx + 1)'(y_i);
  always_ff @(posedge clk_i) begin
    {x_q, y_q, a_q, b_q} <= {x_i, y_i, a_i, b_i};
    from_x_q <= Difference ? Wx'(towards_x_d) : x_i;
    from_y_q <= Difference ? Wx'(towards_y_d) : y_i;
    difference_o <= !Build.converge && (towards_x_d[Wx] != towards_x_d[Wx-1]
        || towards_y_d[Wx] != towards_y_d[Wx-1]);
  end

  logic signed [Wm-1:0] mx, my;
  logic [3:0] blend_beyond;
  assign flat_beyond_o = |blend_beyond;
  lipp_blend #(.F(F), .CrossCells(CrossCells), .Second(SlopeAims), .Wx(Wx), .Wa(Wa), .Wk(Wm)) i_mx (
    .clk_i, .k_i(config_i.slope_x[Wm-1:0]), .x_i(from_x_q),
    .l_i(config_i.slope_aim_x[Wm-1:0]), .a_i(a_q), .y_o(mx), .beyond_o(blend_beyond[0])
  );
  lipp_blend #(.F(F), .CrossCells(CrossCells), .Second(SlopeAims), .Wx(Wx), .Wa(Wa), .Wk(Wm)) i_my (
    .clk_i, .k_i(config_i.slope_y[Wm-1:0]), .x_i(from_y_q),
    .l_i(config_i.slope_aim_y[Wm-1:0]), .a_i(b_q), .y_o(my), .beyond_o(blend_beyond[1])
  );
  if (Build.model == 2'(ModelPinhole)) begin : gen_centre
    assign hx_o = '0;
    assign hy_o = '0;
    assign blend_beyond[3:2] = '0;
    logic unused_point;
    assign unused_point = ^{x_q, y_q};
  end else begin : gen_point
    lipp_blend #(
      .F(F), .CrossCells(CrossCells), .Second(Aims), .Wx(Wx), .Wa(Wa), .Wy(Wh)
    ) i_hx (
      .clk_i, .k_i(config_i.point_x[W-1:0]), .x_i(x_q),
      .l_i(config_i.point_aim_x[W-1:0]), .a_i(a_q), .y_o(hx_o), .beyond_o(blend_beyond[2])
    );
    lipp_blend #(
      .F(F), .CrossCells(CrossCells), .Second(Aims), .Wx(Wx), .Wa(Wa), .Wy(Wh)
    ) i_hy (
      .clk_i, .k_i(config_i.point_y[W-1:0]), .x_i(y_q),
      .l_i(config_i.point_aim_y[W-1:0]), .a_i(b_q), .y_o(hy_o), .beyond_o(blend_beyond[3])
    );
  end
  lipp_unit_slope #(.F(F), .Extra(Wm - W), .CrossCells(CrossCells)) i_unit_slope (
    .clk_i, .mx_i(mx), .my_i(my), .ex_o, .ey_o, .ez_o, .beyond_o(steep_o)
  );

endmodule

`default_nettype wire
