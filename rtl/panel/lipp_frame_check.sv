// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes the CRC-32 of one buffer of the frame store. The CRC covers the rows from top to
/// bottom, and the bytes R, G, B of each pixel.
///
/// Input start_i starts the computation, and is ignored while busy_o is high. While busy_o is high,
/// the module owns the read client of the frame store: it requests all pixels of the buffer and
/// always accepts them. Output done_o is a pulse two clocks after the last pixel. Output crc_o is
/// valid from done_o until the next start_i.
module lipp_frame_check #(
  parameter int Width = 640,
  parameter int Height = 480,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,

  input  logic                 start_i,
  input  logic                 buffer_i,  // index of the buffer to read, sampled with start_i
  output logic                 busy_o,
  output logic                 done_o,    // pulse: crc_o is valid
  output logic [31:0]          crc_o,

  output logic                 read_valid_o,
  input  logic                 read_ready_i,
  output logic                 read_buffer_o,
  output logic [PlaceBits-1:0] read_first_o,
  output logic [PlaceBits:0]   read_count_o,
  input  logic                 read_pixel_valid_i,
  output logic                 read_pixel_ready_o,
  input  logic [23:0]          read_rgb_i
);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_frame_check: Width and Height must be 1 to 16383");
  end

  logic take, come, come_q, last_q;
  logic [PlaceBits:0] remaining_q;
  logic [23:0] rgb_q;
  logic [31:0] crc_q;
  assign take = start_i && !busy_o;
  assign come = busy_o && read_pixel_valid_i;
  assign read_pixel_ready_o = busy_o;
  assign read_first_o = '0;
  assign read_count_o = (PlaceBits + 1)'(Width * Height);
  assign crc_o = ~crc_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {busy_o, read_valid_o, come_q, last_q, done_o} <= '0;
    end else begin
      if (take) busy_o <= 1'b1;
      else if (last_q) busy_o <= 1'b0;
      read_valid_o <= take || (read_valid_o && !read_ready_i);
      come_q <= come;
      last_q <= come && remaining_q == (PlaceBits + 1)'(1);
      done_o <= last_q;
    end
  end

  always_ff @(posedge clk_i) begin
    rgb_q <= read_rgb_i;
    if (take) begin
      read_buffer_o <= buffer_i;
      remaining_q <= read_count_o;
      crc_q <= lipp_link_pkg::CrcStart;
    end else begin
      if (come) remaining_q <= remaining_q - 1'b1;
      if (come_q) crc_q <= lipp_link_pkg::crc32_pixel(crc_q, rgb_q);
    end
  end

endmodule

`default_nettype wire
