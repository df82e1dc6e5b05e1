// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Wraps `lipp_ray_pipeline` in a stream: pixels enter, exit rays leave, one ray per clock, with a
/// valid/ready handshake on both sides.
///
/// Rays leave in the order in which they entered. The optics in use are a copy of config_i. Port
/// apply_i requests a new copy, which is made as soon as all rays inside have left. Until then
/// busy_o is high and the input is closed, so no frame is traced with two displays. Reset also
/// requests a copy.
///
/// The words are those of `lipp_ray_pipeline`. The latency is ray_latency(...) + 5 clocks if
/// nothing stalls.
module lipp_ray_stream #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic                                    clk_i,
  input  logic                                    rst_ni,

  input  lipp_optics_pkg::optics_config_t config_i,  // optics for the next copy
  input  logic                            apply_i,  // requests a copy of config_i
  output logic                            busy_o,  // high until the copy is made
  output logic                            idle_o,  // no ray is inside

  input  logic                                         ray_valid_i,
  output logic                                         ray_ready_o,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] ray_u_i,  // pixel u, right of the centre
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] ray_v_i,  // pixel v, up, 4 fraction bits
  input  logic signed [F+1:0]                          ray_a_i,  // aperture point a, wide, pitches
  input  logic signed [F+1:0]                          ray_b_i,  // aperture point b, wide, rows

  output logic                                         exit_valid_o,
  input  logic                                         exit_ready_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] exit_i_o,  // lenslet (i, j) of the exit ray
  output logic signed [lipp_optics_pkg::IndexBits-1:0] exit_j_o,
  output logic signed [F+3:0]                          exit_x_o,  // origin from lenslet, in radii
  output logic signed [F+3:0]                          exit_y_o,  // origin, F + 1 fraction bits
  output logic signed [F+3:0]                          exit_z_o,
  output logic signed [F+1:0]                          exit_dx_o,  // unit direction, near words
  output logic signed [F+1:0]                          exit_dy_o,
  output logic signed [F+1:0]                          exit_dz_o,  // +z points to the viewer
  output lipp_optics_pkg::ray_status_e                 exit_status_o  // status of the ray
);
  import lipp_optics_pkg::*;

  localparam int Latency = ray_latency(Build);
  localparam int AddressBits = $clog2(Latency + 16);
  localparam int Width = 2 * IndexBits + 3 * (F + 4) + 3 * (F + 2) + 3;

  // ---- the optics in use ----
  optics_config_t used;
  logic busy, hold, idle;
  lipp_config_bank #(.Width($bits(optics_config_t))) i_config_bank (
    .clk_i, .rst_ni, .config_i, .apply_i, .idle_i(idle), .busy_o(busy), .hold_o(hold),
    .config_o(used)
  );
  assign {busy_o, idle_o} = {busy, idle};

  // ---- the pipeline ----
  logic signed [PixelBits-1:0] u_q, v_q;
  logic signed [F+1:0] a_q, b_q;
  always_ff @(posedge clk_i) {u_q, v_q, a_q, b_q} <= {ray_u_i, ray_v_i, ray_a_i, ray_b_i};

  logic [Width-1:0] piped, out;
  logic signed [IndexBits-1:0] i, j;
  logic signed [F+3:0] x, y, z;
  logic signed [F+1:0] dx, dy, dz;
  ray_status_e status;
  lipp_ray_pipeline #(.Build(Build)) i_pipeline (
    .clk_i, .config_i(used), .u_i(u_q), .v_i(v_q), .a_i(a_q), .b_i(b_q),
    .i_o(i), .j_o(j), .x_o(x), .y_o(y), .z_o(z), .dx_o(dx), .dy_o(dy), .dz_o(dz),
    .status_o(status)
  );
  assign piped = {i, j, x, y, z, dx, dy, dz, status};

  lipp_flow_control #(.Latency(Latency + 1), .AddressBits(AddressBits), .Width(Width)) i_flow (
    .clk_i, .rst_ni, .hold_i(hold), .idle_o(idle),
    .valid_i(ray_valid_i), .ready_o(ray_ready_o), .piped_i(piped),
    .valid_o(exit_valid_o), .ready_i(exit_ready_i), .data_o(out)
  );
  assign {exit_i_o, exit_j_o, exit_x_o, exit_y_o, exit_z_o, exit_dx_o, exit_dy_o, exit_dz_o} =
      out[Width-1:3];
  assign exit_status_o = ray_status_e'(out[2:0]);

endmodule

`default_nettype wire
