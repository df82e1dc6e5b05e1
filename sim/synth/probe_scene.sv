// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Top for a place-and-route trial of `lipp_scene`, surrounded by the registers of `probe`.
module probe_scene #(
  parameter int F = 16,
  parameter lipp_scene_pkg::scene_build_t Scene = lipp_scene_pkg::FourLayers
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o
);
  import lipp_optics_pkg::*;
  import lipp_scene_pkg::*;

  localparam int In = $bits(scene_config_t) + 1 + (1 + 4 + 20 + 8) + 1 + 2 * IndexBits
      + 3 * (F + 4) + 3 * (F + 2) + 3 + 2 + 1;
  localparam int Out = 2 + 1 + 1 + 24 + 2;

  logic rst_n;
  logic [In-1:0] in;
  logic [Out-1:0] out;
  probe #(.In(In), .Out(Out)) i_probe (
    .clk_i, .rst_ni, .bit_i, .bit_o, .rst_no(rst_n), .in_o(in), .out_i(out)
  );

  scene_config_t registers;
  logic take, write, valid, ready, first, last;
  logic [3:0] slot;
  logic [19:0] at;
  logic [7:0] data;
  logic signed [IndexBits-1:0] i, j;
  logic signed [F+3:0] x, y, z;
  logic signed [F+1:0] dx, dy, dz;
  logic [2:0] status;
  assign {
    registers, take, write, slot, at, data, valid, i, j, x, y, z, dx, dy, dz, status, first, last,
    ready
  } = in;
  lipp_scene #(.F(F), .Scene(Scene)) i_scene (
    .clk_i, .rst_ni(rst_n), .config_i(registers), .take_i(take), .busy_o(out[0]), .idle_o(out[1]),
    .write_i(write), .write_slot_i(slot), .write_at_i(at), .write_data_i(data),
    .exit_valid_i(valid), .exit_ready_o(out[2]), .exit_i_i(i), .exit_j_i(j), .exit_x_i(x),
    .exit_y_i(y), .exit_z_i(z), .exit_dx_i(dx), .exit_dy_i(dy), .exit_dz_i(dz),
    .exit_status_i(ray_status_e'(status)), .exit_first_i(first), .exit_last_i(last),
    .pixel_valid_o(out[3]), .pixel_ready_i(ready), .pixel_rgb_o(out[27:4]),
    .pixel_first_o(out[28]), .pixel_last_o(out[29])
  );

endmodule

`default_nettype wire
