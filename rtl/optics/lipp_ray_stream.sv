// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Adds handshakes to `lipp_ray_pipeline`: pixels enter and exit rays leave, one ray per clock.
///
/// Rays leave in the order of entry. The optics in use are a copy of config_i. Input apply_i
/// requests a new copy, which is made when all rays inside have left. Until the copy is made,
/// busy_o is high and the input is closed, so that all rays inside use the same optics. Reset also
/// requests a copy.
///
/// The number formats are those of `lipp_ray_pipeline`. The latency is ray_latency(Build) + 5
/// clocks if the output is always ready.
module lipp_ray_stream #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic                                    clk_i,
  input  logic                                    rst_ni,

  input  lipp_optics_pkg::optics_config_t config_i,  // optics to copy next
  input  logic                            apply_i,  // pulse: requests a copy
  output logic                            busy_o,  // 1: a copy is pending
  output logic                            idle_o,  // 1: no ray is inside

  input  logic                                         ray_valid_i,
  output logic                                         ray_ready_o,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] ray_u_i,  // pixel u in 1/16 pixel, rightward
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] ray_v_i,  // pixel v in 1/16 pixel, upward
  input  logic signed [F+1:0]                          ray_a_i,  // aperture point a, 2^-F pitches
  input  logic signed [F+1:0]                          ray_b_i,  // aperture point b, 2^-F rows

  output logic                                         exit_valid_o,
  input  logic                                         exit_ready_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] exit_i_o,  // lenslet i that the ray leaves
  output logic signed [lipp_optics_pkg::IndexBits-1:0] exit_j_o,
  output logic signed [F+3:0]                          exit_x_o,  // origin x, unit 2^-(F+1) radii
  output logic signed [F+3:0]                          exit_y_o,  // origin y, unit 2^-(F+1) radii
  output logic signed [F+3:0]                          exit_z_o,
  output logic signed [F+1:0]                          exit_dx_o,  // direction x, unit 2^-(F+1)
  output logic signed [F+1:0]                          exit_dy_o,
  output logic signed [F+1:0]                          exit_dz_o,  // direction z; +z to the viewer
  output lipp_optics_pkg::ray_status_e                 exit_status_o  // status of the exit ray
);
  import lipp_optics_pkg::*;

  localparam int Latency = ray_latency(Build);
  localparam int AddressBits = $clog2(Latency + 16);
  localparam int Width = 2 * IndexBits + 3 * (F + 4) + 3 * (F + 2) + 3;

  // ---- copy the optics between rays ----
  optics_config_t used;
  logic busy, hold, idle;
  lipp_config_bank #(.Width($bits(optics_config_t))) i_config_bank (
    .clk_i, .rst_ni, .config_i, .apply_i, .idle_i(idle), .busy_o(busy), .hold_o(hold),
    .config_o(used)
  );
  assign {busy_o, idle_o} = {busy, idle};

  // ---- trace the rays, and add the handshakes ----
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
