// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Connects `lipp_board` to a frame store in block RAM, for small panels and for simulation.
///
/// The frame store has two buffers, so each panel pixel takes 48 bits of block RAM. The 64 x 48
/// panel of the tests needs 147 kbit, and a panel of 1280 x 720 needs 44.2 Mbit.
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
  parameter bit HPositive = 1'b1,  // 1: the horizontal sync is active high
  parameter bit VPositive = 1'b1,  // 1: the vertical sync is active high
  parameter lipp_optics_pkg::build_t Build = '{
    fraction_bits: 5'd16, model: 2'(lipp_optics_pkg::ModelExact), default: '0
  },
  parameter lipp_scene_pkg::scene_build_t Scene = '0  // scene build; layers = 0: no scene
) (
  input  logic        clk_i,
  input  logic        rst_ni,       // asynchronous reset, active low
  input  logic [63:0] identity_i,   // hash that identifies the panel and its lenslet array

  input  logic [15:0] step_i,       // UART baud rate / clock frequency, times 65536
  input  logic        rx_i,
  output logic        tx_o,

  input  logic        in_valid_i,   // in_* and out_*: byte stream, if ByteLink = 1
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
  logic store_rst_n;
  logic show_valid, show_ready, show_buffer, show_pixel_valid, show_pixel_ready;
  logic write_valid, write_ready, write_buffer, write_pixel_valid, write_pixel_ready, write_done;
  logic read_valid, read_ready, read_buffer, read_pixel_valid, read_pixel_ready;
  logic [PlaceBits-1:0] show_first, write_first, read_first;
  logic [PlaceBits:0] show_count, write_count, read_count;
  logic [23:0] show_rgb, write_rgb, read_rgb;
  logic packet, shown, error, unused_lamps;
  assign unused_lamps = ^{packet, shown, error};
  lipp_board #(
    .ByteLink(ByteLink), .ClockHz(ClockHz), .Width(Width), .Height(Height), .HFront(HFront),
    .HSync(HSync), .HBack(HBack), .VFront(VFront), .VSync(VSync), .VBack(VBack),
    .HPositive(HPositive), .VPositive(VPositive), .Build(Build),
    .Scene(Scene)
  ) i_board (
    .clk_i, .rst_ni, .identity_i, .step_i, .rx_i, .tx_o, .in_valid_i, .in_ready_o, .in_data_i,
    .out_valid_o, .out_ready_i, .out_data_o, .store_rst_no(store_rst_n),
    .show_valid_o(show_valid), .show_ready_i(show_ready), .show_buffer_o(show_buffer),
    .show_first_o(show_first), .show_count_o(show_count), .show_pixel_valid_i(show_pixel_valid),
    .show_pixel_ready_o(show_pixel_ready), .show_rgb_i(show_rgb), .write_valid_o(write_valid),
    .write_ready_i(write_ready), .write_buffer_o(write_buffer), .write_first_o(write_first),
    .write_count_o(write_count), .write_pixel_valid_o(write_pixel_valid),
    .write_pixel_ready_i(write_pixel_ready), .write_rgb_o(write_rgb), .write_done_i(write_done),
    .read_valid_o(read_valid), .read_ready_i(read_ready), .read_buffer_o(read_buffer),
    .read_first_o(read_first), .read_count_o(read_count), .read_pixel_valid_i(read_pixel_valid),
    .read_pixel_ready_o(read_pixel_ready), .read_rgb_i(read_rgb), .pattern_i('0),
    .clock_lost_i(1'b0), .packet_o(packet), .shown_o(shown), .error_o(error),
    .pixel_o, .de_o, .hsync_o, .vsync_o, .rgb_o
  );
  lipp_block_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .rst_ni(store_rst_n),
    .show_valid_i(show_valid), .show_ready_o(show_ready), .show_buffer_i(show_buffer),
    .show_first_i(show_first), .show_count_i(show_count), .show_pixel_valid_o(show_pixel_valid),
    .show_pixel_ready_i(show_pixel_ready), .show_rgb_o(show_rgb), .write_valid_i(write_valid),
    .write_ready_o(write_ready), .write_buffer_i(write_buffer), .write_first_i(write_first),
    .write_count_i(write_count), .write_pixel_valid_i(write_pixel_valid),
    .write_pixel_ready_o(write_pixel_ready), .write_rgb_i(write_rgb), .write_done_o(write_done),
    .read_valid_i(read_valid), .read_ready_o(read_ready), .read_buffer_i(read_buffer),
    .read_first_i(read_first), .read_count_i(read_count), .read_pixel_valid_o(read_pixel_valid),
    .read_pixel_ready_i(read_pixel_ready), .read_rgb_o(read_rgb)
  );

endmodule

`default_nettype wire
