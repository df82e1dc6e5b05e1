// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Converts AXI4-Stream to rays for optics_block, when the register `source` of optics_block
/// selects the stream. Each transfer becomes one ray, each packet one frame.
///
/// All bytes are data (tkeep = '1). The latency is 1 clock, and the throughput is one ray per
/// clock. Every output is a register. A transfer has four signed little-endian words of 32 bits.
/// Each word contains a signed number in its low n bits; bits 31:n are ignored. The fields are:
///
///   Bits 31:0 of tdata are u, to the right of the panel's centre, in units of 2^-4 pixels; n = 18.
///   Bits 63:32 of tdata are v, upward from the panel's centre, in units of 2^-4 pixels; n = 18.
///   Bits 95:64 of tdata are a, the aperture point along x, in units of 2^-F pitches; n = F + 2.
///   Bits 127:96 of tdata are b, the aperture point along y, in units of 2^-F rows; n = F + 2.
///   Bit tuser is 1 for the first ray of a frame.
///   Bit tlast is 1 for the last ray of a frame. A new configuration takes effect only after tlast.
module lipp_axis_to_rays #(
  parameter int F = 23
) (
  input  logic                                    clk_i,
  input  logic                                    rst_ni,

  input  logic                                    s_axis_tvalid,
  output logic                                    s_axis_tready,
  input  logic [127:0]                            s_axis_tdata,
  input  logic                                    s_axis_tlast,
  input  logic                                    s_axis_tuser,

  output logic                                         ray_valid_o,
  input  logic                                         ray_ready_i,
  output logic signed [lipp_optics_pkg::PixelBits-1:0] ray_u_o,
  output logic signed [lipp_optics_pkg::PixelBits-1:0] ray_v_o,
  output logic signed [F+1:0]                          ray_a_o,
  output logic signed [F+1:0]                          ray_b_o,
  output logic                                         ray_first_o,
  output logic                                         ray_last_o
);
  import lipp_optics_pkg::*;

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_axis_to_rays: F must be 14 to 23");
  end

  lipp_skid_buffer #(.Width(2 * PixelBits + 2 * (F + 2) + 2)) i_buffer (
    .clk_i, .rst_ni, .clear_i('0), .in_valid_i(s_axis_tvalid), .in_ready_o(s_axis_tready),
    .in_data_i({
      s_axis_tdata[0+:PixelBits], s_axis_tdata[32+:PixelBits], s_axis_tdata[64+:F+2],
      s_axis_tdata[96+:F+2], s_axis_tuser, s_axis_tlast
    }),
    .out_valid_o(ray_valid_o), .out_ready_i(ray_ready_i),
    .out_data_o({ray_u_o, ray_v_o, ray_a_o, ray_b_o, ray_first_o, ray_last_o})
  );

  logic unused_bits;
  assign unused_bits = ^s_axis_tdata;

endmodule

`default_nettype wire
