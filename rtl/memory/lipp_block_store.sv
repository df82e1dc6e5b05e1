// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Stores frames in two pixel buffers in block RAM, for small panels and for simulation.
///
/// Three clients use the frame store through the ports show_*, read_* and write_*. Clients show and
/// read fetch pixels, and client write stores pixels. Each client transfers one pixel per clock.
///
/// A client's request has a valid/ready handshake. The request selects a buffer, the index of its
/// first pixel, and a number of pixels, 1 or more. The pixels follow the request as a stream, row
/// by row, with red in bits 23:16, green in 15:8 and blue in 7:0. The next request of a client is
/// accepted after the last pixel of its current request. For client write, the next request is
/// accepted after write_done_o. Output write_done_o is a pulse. A read request accepted with or
/// after write_done_o returns the written pixels. After power-up the contents are undefined. Reset
/// keeps the contents and cancels all requests.
///
/// The frame store `lipp_sdram_store` has the same clients and handshakes.
module lipp_block_store #(
  parameter int Width = 640,
  parameter int Height = 480,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,

  input  logic                 show_valid_i,
  output logic                 show_ready_o,
  input  logic                 show_buffer_i,
  input  logic [PlaceBits-1:0] show_first_i,
  input  logic [PlaceBits:0]   show_count_i,
  output logic                 show_pixel_valid_o,
  input  logic                 show_pixel_ready_i,
  output logic [23:0]          show_rgb_o,

  input  logic                 write_valid_i,
  output logic                 write_ready_o,
  input  logic                 write_buffer_i,
  input  logic [PlaceBits-1:0] write_first_i,
  input  logic [PlaceBits:0]   write_count_i,
  input  logic                 write_pixel_valid_i,
  output logic                 write_pixel_ready_o,
  input  logic [23:0]          write_rgb_i,
  output logic                 write_done_o,

  input  logic                 read_valid_i,
  output logic                 read_ready_o,
  input  logic                 read_buffer_i,
  input  logic [PlaceBits-1:0] read_first_i,
  input  logic [PlaceBits:0]   read_count_i,
  output logic                 read_pixel_valid_o,
  input  logic                 read_pixel_ready_i,
  output logic [23:0]          read_rgb_o
);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_block_store: Width and Height must be 1 to 16383");
  end

  logic show_buffer, read_buffer;
  logic [PlaceBits-1:0] show_at, read_at;
  logic [23:0] show_rgb, read_rgb;
  lipp_block_read_port #(.Width(Width), .Height(Height)) i_show (
    .clk_i, .rst_ni, .valid_i(show_valid_i), .ready_o(show_ready_o), .buffer_i(show_buffer_i),
    .first_i(show_first_i), .count_i(show_count_i), .pixel_valid_o(show_pixel_valid_o),
    .pixel_ready_i(show_pixel_ready_i), .rgb_o(show_rgb_o), .buffer_o(show_buffer),
    .at_o(show_at), .rgb_i(show_rgb)
  );
  lipp_block_read_port #(.Width(Width), .Height(Height)) i_read (
    .clk_i, .rst_ni, .valid_i(read_valid_i), .ready_o(read_ready_o), .buffer_i(read_buffer_i),
    .first_i(read_first_i), .count_i(read_count_i), .pixel_valid_o(read_pixel_valid_o),
    .pixel_ready_i(read_pixel_ready_i), .rgb_o(read_rgb_o), .buffer_o(read_buffer),
    .at_o(read_at), .rgb_i(read_rgb)
  );

  logic busy_q, buffer_q, take;
  logic [PlaceBits-1:0] at_q;
  logic [PlaceBits:0] remaining_q;
  assign write_ready_o = !busy_q;
  assign write_pixel_ready_o = busy_q;
  assign take = write_pixel_valid_i && busy_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {busy_q, write_done_o} <= '0;
    end else begin
      write_done_o <= take && remaining_q == (PlaceBits + 1)'(1);
      if (!busy_q) busy_q <= write_valid_i;
      else if (take && remaining_q == (PlaceBits + 1)'(1)) busy_q <= 1'b0;
    end
  end
  always_ff @(posedge clk_i) begin
    if (!busy_q) {buffer_q, at_q, remaining_q} <= {write_buffer_i, write_first_i, write_count_i};
    else if (take) {at_q, remaining_q} <= {at_q + 1'b1, remaining_q - 1'b1};
  end

  lipp_frame_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .write_i(take), .write_buffer_i(buffer_q), .write_at_i(at_q), .write_rgb_i,
    .a_buffer_i(show_buffer), .a_at_i(show_at), .a_rgb_o(show_rgb), .b_buffer_i(read_buffer),
    .b_at_i(read_at), .b_rgb_o(read_rgb)
  );

endmodule

`default_nettype wire
