// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// `lipp_board` with its store of frames in block RAM: for small panels, and for simulation.
///
/// A pixel takes 48 bits: the panel of 64 x 48 in the tests 147 kbit, one of 1280 x 720 44.2 Mbit.
module lipp_board_with_store #(
  parameter bit ByteLink = 1'b0,
  parameter int ClockHz = 148_500_000,
  parameter int Width = 1920,
  parameter int Height = 1080,
  parameter int HFront = 88,
  parameter int HSync = 44,
  parameter int HBack = 148,
  parameter int VFront = 4,
  parameter int VSync = 5,
  parameter int VBack = 36,
  parameter bit HPositive = 1'b1,   // polarities of the syncs
  parameter bit VPositive = 1'b1,
  parameter lipp_optics_pkg::build_t Build = '{
    fraction_bits: 5'd16, model: 2'(lipp_optics_pkg::ModelExact), default: '0
  },
  parameter lipp_scene_pkg::scene_build_t Scene = '0  // no layers: none
) (
  input  logic        clk_i,
  input  logic        rst_ni,       // asynchronous
  input  logic [63:0] identity_i,   // hash of panel and array

  input  logic [15:0] step_i,       // UART: bits per clock, times 65536
  input  logic        rx_i,
  output logic        tx_o,

  input  logic        in_valid_i,   // used with ByteLink
  output logic        in_ready_o,
  input  logic [7:0]  in_data_i,
  output logic        out_valid_o,
  input  logic        out_ready_i,
  output logic [7:0]  out_data_o,

  output logic        pixel_o,
  output logic        de_o,
  output logic        hsync_o,
  output logic        vsync_o,
  output logic [23:0] rgb_o
);

  localparam int PlaceBits = $clog2(Width * Height);
  logic write, write_buffer, a_buffer, b_buffer;
  logic [PlaceBits-1:0] write_at, a_at, b_at;
  logic [23:0] write_rgb, a_rgb, b_rgb;
  lipp_board #(
    .ByteLink(ByteLink), .ClockHz(ClockHz), .Width(Width), .Height(Height), .HFront(HFront),
    .HSync(HSync), .HBack(HBack), .VFront(VFront), .VSync(VSync), .VBack(VBack),
    .HPositive(HPositive), .VPositive(VPositive), .Build(Build),
    .Scene(Scene)
  ) i_board (
    .clk_i, .rst_ni, .identity_i, .step_i, .rx_i, .tx_o, .in_valid_i, .in_ready_o, .in_data_i,
    .out_valid_o, .out_ready_i, .out_data_o, .pixel_o, .de_o, .hsync_o, .vsync_o, .rgb_o,
    .store_write_o(write), .store_write_buffer_o(write_buffer), .store_write_at_o(write_at),
    .store_write_rgb_o(write_rgb), .store_a_buffer_o(a_buffer), .store_a_at_o(a_at),
    .store_a_rgb_i(a_rgb), .store_b_buffer_o(b_buffer), .store_b_at_o(b_at), .store_b_rgb_i(b_rgb)
  );
  lipp_frame_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .write_i(write), .write_buffer_i(write_buffer), .write_at_i(write_at),
    .write_rgb_i(write_rgb), .a_buffer_i(a_buffer), .a_at_i(a_at), .a_rgb_o(a_rgb),
    .b_buffer_i(b_buffer), .b_at_i(b_at), .b_rgb_o(b_rgb)
  );

endmodule

`default_nettype wire
