// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Converts exit rays of optics_block to AXI4-Stream: one transfer per ray, one packet per frame.
///
/// A transfer has eight little-endian words of 32 bits. The layout equals that of the C struct {
/// int16_t i, j; uint32_t status; int32_t x, y, z, dx, dy, dz; }. All bytes are data (tkeep = '1).
/// The latency is 1 clock, and the throughput is one ray per clock. Every output is a register or a
/// constant. The fields of a transfer are:
///
///   Bits 15:0, 31:16 of tdata are the signed indices i, j of the lenslet that the ray leaves.
///   Bits 63:32 of tdata are the status of the ray, as in ray_status_e.
///   Bits 95:64, 127:96, 159:128 of tdata are the ray's signed origin x, y, z from lenslet (i, j).
///   Bits 191:160, 223:192, 255:224 of tdata are the ray's signed unit direction dx, dy, dz.
///   Bit tuser is 1 for the first ray of a frame.
///   Bit tlast is 1 for the last ray of a frame.
///
/// The origin is 2^-(F+1) R (x, y, z) mm, R the dome radius, the direction 2^-(F+1) (dx, dy, dz).
module lipp_axis_from_rays #(
  parameter int F = 23
) (
  input  logic                                    clk_i,
  input  logic                                    rst_ni,

  input  logic                                         exit_valid_i,
  output logic                                         exit_ready_o,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] exit_i_i,
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

  output logic                                    m_axis_tvalid,
  input  logic                                    m_axis_tready,
  output logic [255:0]                            m_axis_tdata,
  output logic                                    m_axis_tlast,
  output logic                                    m_axis_tuser
);
  import lipp_optics_pkg::*;

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_axis_from_rays: F must be 14 to 23");
  end

  logic signed [IndexBits-1:0] i, j;
  logic signed [F+3:0] x, y, z;
  logic signed [F+1:0] dx, dy, dz;
  ray_status_e status;
  localparam int Width = 2 * IndexBits + 3 * (F + 4) + 3 * (F + 2) + $bits(ray_status_e) + 2;
  lipp_skid_buffer #(.Width(Width)) i_buffer (
    .clk_i, .rst_ni, .clear_i('0), .in_valid_i(exit_valid_i), .in_ready_o(exit_ready_o),
    .in_data_i({
      exit_i_i, exit_j_i, exit_x_i, exit_y_i, exit_z_i, exit_dx_i, exit_dy_i, exit_dz_i,
      exit_status_i, exit_first_i, exit_last_i
    }),
    .out_valid_o(m_axis_tvalid), .out_ready_i(m_axis_tready),
    .out_data_o({i, j, x, y, z, dx, dy, dz, status, m_axis_tuser, m_axis_tlast})
  );
  assign m_axis_tdata = {
    32'(dz), 32'(dy), 32'(dx), 32'(z), 32'(y), 32'(x), 32'(status), 16'(j), 16'(i)
  };

endmodule

`default_nettype wire
