// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Steps 1 to 3 of the ray trace: finds the lenslet at which the ray aims, and measures the pixel
/// and the aperture point from that lenslet's centre. The modules in order are, with those that
/// only some builds contain in parentheses:
///
///   pixel_to_lattice -> lenslet_{square,hex} -> (aim) -> (converge) -> (shear).
///
/// The outputs (x, y) and (a, b) are the pixel and the aperture point, in pitches and rows from the
/// centre of lenslet (i, j). Words x, y, a and b have F fraction bits. The width of x and y is
/// local_bits(F, Converge, Shear), and the width of a and b is local_bits(F, 0, Shear).
///
/// Output stray_o reports that (i, j) is not the pixel's own lenslet. Output beyond_o reports that
/// a number did not fit its word. Output missing_o reports that the pixel's own lenslet does not
/// exist. In builds whose rays cannot leave through another lenslet, missing_o is always 0.
///
/// The latency of the outputs is lens_latency(F, Grid, Aims, Converge, Shear) clocks. The outputs
/// own_i_o and own_j_o, the pixel's own lenslet, have a latency of pixel_latency() +
/// lenslet_latency(Grid) clocks. Output missing_o is valid extent_latency() clocks after (x, y).
module lipp_pixel_to_lens #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits),
  localparam int Wx = lipp_optics_pkg::local_bits(F, Build.converge, Build.shear),
  localparam int Wa = lipp_optics_pkg::local_bits(F, 1'b0, Build.shear)
) (
  input  logic                                         clk_i,
  input  lipp_optics_pkg::optics_config_t              config_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] u_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] v_i,
  input  logic signed [F+1:0]                          a_i,
  input  logic signed [F+1:0]                          b_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] own_i_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] own_j_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] i_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] j_o,
  output logic signed [Wx-1:0]                         x_o,
  output logic signed [Wx-1:0]                         y_o,
  output logic signed [Wa-1:0]                         a_o,
  output logic signed [Wa-1:0]                         b_o,
  output logic                                         stray_o,
  output logic                                         beyond_o,
  output logic                                         missing_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int L = IndexBits + F;
  localparam int Grid = int'(Build.grid);
  localparam bit Aims = Build.aims;
  localparam bit Converge = Build.converge;
  localparam bit Shear = Build.shear;
  localparam bit CrossCells = Build.cross_cells;
  // A build uses only some fields of config_i.
  logic unused_config;
  assign unused_config = ^config_i;

  // ---- find the pixel's own lenslet ----
  logic signed [L-1:0] lattice_x, lattice_y;
  logic lattice_beyond, lattice_beyond_late, index_beyond, own_beyond;
  lipp_delay #(.Width(1), .Cycles(lenslet_latency(Grid))) i_lattice_beyond (
    .clk_i, .d_i(lattice_beyond), .q_o(lattice_beyond_late)
  );
  assign own_beyond = lattice_beyond_late || index_beyond;
  lipp_pixel_to_lattice #(.F(F)) i_pixel_to_lattice (
    .clk_i, .u_i, .v_i,
    .x_from_u_i(config_i.x_from_u), .x_from_v_i(config_i.x_from_v),
    .x_offset_i(config_i.x_offset),
    .y_from_u_i(config_i.y_from_u), .y_from_v_i(config_i.y_from_v),
    .y_offset_i(config_i.y_offset),
    .x_o(lattice_x), .y_o(lattice_y), .beyond_o(lattice_beyond)
  );

  logic signed [W-1:0] own_x, own_y;
  if (Grid == GridHex) begin : gen_hex
    lipp_lenslet_hex #(.F(F)) i_lenslet (
      .clk_i, .x_i(lattice_x), .y_i(lattice_y),
      .i_o(own_i_o), .j_o(own_j_o), .x_o(own_x), .y_o(own_y), .beyond_o(index_beyond)
    );
  end else begin : gen_square
    lipp_lenslet_square #(.F(F)) i_lenslet (
      .clk_i, .x_i(lattice_x), .y_i(lattice_y),
      .i_o(own_i_o), .j_o(own_j_o), .x_o(own_x), .y_o(own_y), .beyond_o(index_beyond)
    );
  end

  // ---- find the lenslet at which the ray aims ----
  localparam int AimAt = lens_latency(F, Grid, Aims, 1'b0, 1'b0);
  logic signed [IndexBits-1:0] aim_i, aim_j;
  logic signed [W-1:0] aim_x, aim_y, aim_a, aim_b;
  logic aim_stray, aim_beyond;
  if (Aims) begin : gen_aim
    logic signed [W-1:0] a_late, b_late;
    logic own_beyond_late, outside;
    lipp_delay #(.Width(1), .Cycles(aim_latency(Grid))) i_beyond_match (
      .clk_i, .d_i(own_beyond), .q_o(own_beyond_late)
    );
    assign aim_beyond = own_beyond_late || outside;
    lipp_delay #(.Width(2 * W), .Cycles(pixel_latency() + lenslet_latency(Grid))) i_aim_match (
      .clk_i, .d_i({a_i, b_i}), .q_o({a_late, b_late})
    );
    lipp_aim #(.F(F), .Grid(Grid)) i_aim (
      .clk_i, .i_i(own_i_o), .j_i(own_j_o), .x_i(own_x), .y_i(own_y), .a_i(a_late), .b_i(b_late),
      .i_o(aim_i), .j_o(aim_j), .x_o(aim_x), .y_o(aim_y), .a_o(aim_a), .b_o(aim_b),
      .stray_o(aim_stray), .beyond_o(outside)
    );
  end else begin : gen_chief
    assign {aim_i, aim_j, aim_x, aim_y} = {own_i_o, own_j_o, own_x, own_y};
    assign aim_a = '0;
    assign aim_b = '0;
    assign aim_stray = 1'b0;
    assign aim_beyond = own_beyond;
    logic unused_aim;
    assign unused_aim = ^{a_i, b_i};
  end

  // ---- measure the pixel's point from the lenslet's centre ----
  localparam int LocalAt = lens_latency(F, Grid, Aims, Converge, 1'b0);
  localparam int Wc = local_bits(F, Converge, 1'b0);
  logic signed [IndexBits-1:0] local_i, local_j;
  logic signed [W-1:0] local_a, local_b;
  logic signed [Wc-1:0] local_x, local_y;
  logic local_stray, local_beyond;
  lipp_delay #(.Width(2 * IndexBits + 2 * W + 1), .Cycles(LocalAt - AimAt)) i_local_match (
    .clk_i, .d_i({aim_i, aim_j, aim_a, aim_b, aim_stray}),
    .q_o({local_i, local_j, local_a, local_b, local_stray})
  );
  if (Converge) begin : gen_converge
    logic outside, beyond_late;
    lipp_converge #(.F(F), .CrossCells(CrossCells), .Grid(Grid)) i_converge (
      .clk_i, .i_i(aim_i), .j_i(aim_j), .x_i(aim_x), .y_i(aim_y),
      .share_i(config_i.converge_share[F+8:0]),
      .offset_x_i(config_i.converge_x[F+8:0]), .offset_y_i(config_i.converge_y[F+8:0]),
      .x_o(local_x), .y_o(local_y), .beyond_o(outside)
    );
    lipp_delay #(.Width(1), .Cycles(LocalAt - AimAt)) i_beyond_match (
      .clk_i, .d_i(aim_beyond), .q_o(beyond_late)
    );
    assign local_beyond = beyond_late || outside;
  end else begin : gen_parallel
    assign {local_x, local_y, local_beyond} = {aim_x, aim_y, aim_beyond};
  end

  // ---- convert sheared coordinates x and a to lengths along the rows ----
  localparam int LensAt = lens_latency(F, Grid, Aims, Converge, Shear);
  if (Shear) begin : gen_shear
    logic signed [W-1:0] b_late;
    logic signed [Wc-1:0] y_late;
    logic outside_x, outside_a, beyond_late;
    lipp_delay #(.Width(2 * IndexBits + Wc + W + 2), .Cycles(LensAt - LocalAt)) i_lens_match (
      .clk_i, .d_i({local_i, local_j, local_y, local_b, local_stray, local_beyond}),
      .q_o({i_o, j_o, y_late, b_late, stray_o, beyond_late})
    );
    lipp_shear #(.F(F), .CrossCells(CrossCells), .Wx(Wc)) i_shear_x (
      .clk_i, .x_i(local_x), .y_i(local_y), .g_i(config_i.shear_x[F+3:0]),
      .x_o(x_o), .beyond_o(outside_x)
    );
    if (Aims) begin : gen_aimed
      lipp_shear #(.F(F), .CrossCells(CrossCells), .Wx(W)) i_shear_a (
        .clk_i, .x_i(local_a), .y_i(local_b), .g_i(config_i.shear_x[F+3:0]),
        .x_o(a_o), .beyond_o(outside_a)
      );
    end else begin : gen_centre
      assign a_o = '0;
      assign outside_a = 1'b0;
      logic unused_a;
      assign unused_a = ^local_a;
    end
    assign y_o = Wx'(y_late);
    assign b_o = Wa'(b_late);
    assign beyond_o = beyond_late || outside_x || outside_a;
  end else begin : gen_upright
    assign {i_o, j_o, a_o, b_o, stray_o, beyond_o} =
        {local_i, local_j, local_a, local_b, local_stray, local_beyond};
    assign {x_o, y_o} = {local_x, local_y};
  end

  // ---- check if the pixel's own lenslet exists ----
  // If rays cannot leave their lenslet, `lipp_ray_pipeline` tests the exit ray's lenslet instead.
  localparam bit Elsewhere = Aims || Build.walk > 0;
  localparam int OwnAt = pixel_latency() + lenslet_latency(Grid);
  if (Elsewhere) begin : gen_own_extent
    logic missing;
    lipp_extent #(.Grid(Grid)) i_extent (
      .clk_i, .i_i(own_i_o), .j_i(own_j_o), .along_i(config_i.extent_i[IndexBits+1:0]),
      .across_i(config_i.extent_j[IndexBits:0]), .missing_o(missing)
    );
    lipp_delay #(.Width(1), .Cycles(LensAt - OwnAt)) i_own_match (
      .clk_i, .d_i(missing), .q_o(missing_o)
    );
  end else begin : gen_exit_extent
    assign missing_o = 1'b0;
  end

endmodule

`default_nettype wire
