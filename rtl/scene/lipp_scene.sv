// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Draws the scene: exit rays in, pixels of the panel out, valid/ready on both sides.
module lipp_scene #(
  parameter int F = 16,  // fraction bits of the optics' build
  parameter lipp_scene_pkg::scene_build_t Scene = lipp_scene_pkg::FourLayers
) (
  input  logic                                         clk_i,
  input  logic                                         rst_ni,

  input  lipp_scene_pkg::scene_config_t                config_i,  // the next copy
  input  logic                                         take_i,  // make a copy
  output logic                                         busy_o,  // until it is made; closes the input
  output logic                                         idle_o,  // no ray is inside

  input  logic                                         write_i,  // a byte of a slot
  input  logic [3:0]                                   write_slot_i,
  input  logic [19:0]                                  write_at_i,
  input  logic [7:0]                                   write_data_i,

  input  logic                                         exit_valid_i,
  output logic                                         exit_ready_o,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] exit_i_i,  // as lipp_optics_block's exit_*_o
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] exit_j_i,
  input  logic signed [F+3:0]                          exit_x_i,
  input  logic signed [F+3:0]                          exit_y_i,
  input  logic signed [F+3:0]                          exit_z_i,
  input  logic signed [F+1:0]                          exit_dx_i,
  input  logic signed [F+1:0]                          exit_dy_i,
  input  logic signed [F+1:0]                          exit_dz_i,
  input  lipp_optics_pkg::ray_status_e                 exit_status_i,
  input  logic                                         exit_first_i,
  input  logic                                         exit_last_i,

  output logic                                         pixel_valid_o,
  input  logic                                         pixel_ready_i,
  output logic [23:0]                                  pixel_rgb_o,  // {r, g, b}, bytes of the panel
  output logic                                         pixel_first_o,
  output logic                                         pixel_last_o
);

endmodule

`default_nettype wire
