// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Memory of `lipp_block_store`: two pixel buffers with a write port and two read ports, a and b.
///
/// An address consists of the index of the buffer and the index of the pixel in that buffer. Each
/// read port has a latency of two clocks. Output a_rgb_o in clock t is the pixel at the address
/// a_at_i of clock t - 2, as it was before clock t - 2. Port b has the same timing as port a. After
/// power-up the contents are undefined.
module lipp_frame_store #(
  parameter int Width = 640,
  parameter int Height = 480,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,

  input  logic                 write_i,
  input  logic                 write_buffer_i,
  input  logic [PlaceBits-1:0] write_at_i,
  input  logic [23:0]          write_rgb_i,

  input  logic                 a_buffer_i,
  input  logic [PlaceBits-1:0] a_at_i,
  output logic [23:0]          a_rgb_o,

  input  logic                 b_buffer_i,
  input  logic [PlaceBits-1:0] b_at_i,
  output logic [23:0]          b_rgb_o
);
  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_frame_store: Width and Height must be 1 to 16383");
  end

  logic [23:0] pixels[2 << PlaceBits];
  logic [23:0] a_rgb_q, b_rgb_q;

  always_ff @(posedge clk_i) begin
    if (write_i) pixels[{write_buffer_i, write_at_i}] <= write_rgb_i;
    a_rgb_q <= pixels[{a_buffer_i, a_at_i}];
    a_rgb_o <= a_rgb_q;
    b_rgb_q <= pixels[{b_buffer_i, b_at_i}];
    b_rgb_o <= b_rgb_q;
  end

endmodule

`default_nettype wire
