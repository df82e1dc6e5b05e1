// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Steps 4 and 6 of the ray trace (plano side to the viewer): refracts the ray into the glass at
/// the dome, and out of the glass at the flat face. The modules in order are:
///
///   enter_dome -> leave_flat.
///
/// Inputs n, cos and s are the results of `lipp_meet_dome`. Input e is the ray's direction in the
/// air, valid in the same clock as n. The number formats are those of `lipp_leave_flat`. The z of
/// the exit ray's origin is the register exit_z. The latency is exit_latency(1, F) clocks.
module lipp_exit_flat #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0
) (
  input  logic                            clk_i,
  input  lipp_optics_pkg::optics_config_t config_i,
  input  logic signed [F+1:0]             nx_i,
  input  logic signed [F+1:0]             ny_i,
  input  logic signed [F+1:0]             nz_i,
  input  logic signed [F+1:0]             cos_i,
  input  logic signed [F+3:0]             s_i,
  input  logic signed [F+1:0]             ex_i,
  input  logic signed [F+1:0]             ey_i,
  output logic signed [F+3:0]             x_o,
  output logic signed [F+3:0]             y_o,
  output logic signed [F+3:0]             z_o,
  output logic signed [F+1:0]             dx_o,
  output logic signed [F+1:0]             dy_o,
  output logic signed [F+1:0]             dz_o,
  output logic                            reflected_o,
  output logic                            beyond_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wf = W + 2;
  // A build for one orientation of the lenslets uses only some fields of config_i.
  logic unused_config;
  assign unused_config = ^config_i;

  logic signed [W-1:0] glass_dx, glass_dy, glass_nx, glass_ny, glass_nz;
  logic enter_beyond, enter_beyond_late, flat_beyond;
  lipp_enter_dome #(.F(F), .CrossCells(CrossCells)) i_enter_dome (
    .clk_i, .nx_i, .ny_i, .cos_i, .s_i, .ex_i, .ey_i,
    .index_inverse_i(config_i.index_inverse[W-1:0]),
    .index_inverse_square_i(config_i.index_inverse_square[Wf-1:0]),
    .dx_o(glass_dx), .dy_o(glass_dy), .beyond_o(enter_beyond)
  );
  lipp_delay #(.Width(3 * W), .Cycles(dome_latency(F))) i_n (
    .clk_i, .d_i({nx_i, ny_i, nz_i}), .q_o({glass_nx, glass_ny, glass_nz})
  );
  lipp_leave_flat #(.F(F), .CrossCells(CrossCells)) i_leave_flat (
    .clk_i, .nx_i(glass_nx), .ny_i(glass_ny), .nz_i(glass_nz),
    .dx_i(glass_dx), .dy_i(glass_dy), .zc_i(config_i.depth[Wf-1:0]),
    .index_i(config_i.index[W:0]), .index_square_i(config_i.index_square[Wf-1:0]),
    .x_o, .y_o, .dx_o, .dy_o, .dz_o, .reflected_o, .beyond_o(flat_beyond)
  );
  lipp_delay #(.Width(1), .Cycles(leave_flat_latency(F))) i_enter_beyond (
    .clk_i, .d_i(enter_beyond), .q_o(enter_beyond_late)
  );
  assign z_o = config_i.exit_z[Wf-1:0];
  assign beyond_o = enter_beyond_late || flat_beyond;

endmodule

`default_nettype wire
