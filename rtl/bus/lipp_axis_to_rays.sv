// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// AXI4-Stream to the rays of optics_block with source = stream: one ray a transfer, a frame a
/// packet.
///
/// A transfer holds four signed words of 32 bits, little-endian, each sign-extended from its width:
///
///   tdata[ 31:  0]   u in 2^-4 pixels to the right of the panel's centre       18 bits
///   tdata[ 63: 32]   v in 2^-4 pixels upwards                                  18 bits
///   tdata[ 95: 64]   a in 2^-F pitches along the rows, the aperture point      F + 2 bits
///   tdata[127: 96]   b in 2^-F row distances                                   F + 2 bits
///   tuser            1: the first ray of its frame
///   tlast            1: the last ray of its frame, without which no apply takes effect
///
/// The upper bits of a word are not read: w = ((word + 2^(n-1)) mod 2^n) - 2^(n-1) for n bits. All
/// bytes are data (tkeep = '1). A ray leaves 1 clock after it came; a ray passes each clock. Every
/// output is a register.
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
