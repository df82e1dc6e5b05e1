// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Top for a place-and-route trial of `lipp_board`. The frame store is a memory outside the FPGA,
/// so the ports to it are connected to the registers of `probe`, like the board's other ports.
module probe_board #(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int HFront = 16,
  parameter int HSync = 96,
  parameter int HBack = 48,
  parameter int VFront = 10,
  parameter int VSync = 2,
  parameter int VBack = 33,
  parameter bit HPositive = 1'b0,
  parameter bit VPositive = 1'b0,
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  parameter lipp_scene_pkg::scene_build_t Scene = '0
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o
);

  localparam int PlaceBits = $clog2(Width * Height);
  localparam int In = 64 + 16 + 1 + 10 + 2 * 26 + 3 + 4;
  localparam int Out = 1 + 10 + 1 + 3 * (2 + PlaceBits + PlaceBits + 1) + 2 + 25 + 3 + 28;

  logic rst_n;
  logic [In-1:0] in;
  logic [Out-1:0] out;
  probe #(.In(In), .Out(Out)) i_probe (
    .clk_i, .rst_ni, .bit_i, .bit_o, .rst_no(rst_n), .in_o(in), .out_i(out)
  );

  logic [63:0] identity;
  logic [15:0] step;
  logic rx, in_valid, out_ready, clock_lost;
  logic [7:0] in_data;
  logic [2:0] pattern;
  logic show_ready, show_pixel_valid, write_ready, write_pixel_ready, write_done, read_ready;
  logic read_pixel_valid;
  logic [23:0] show_rgb, read_rgb;
  assign {
    identity, step, rx, in_valid, out_ready, in_data, show_ready, show_pixel_valid, show_rgb,
    read_ready, read_pixel_valid, read_rgb, write_ready, write_pixel_ready, write_done, pattern,
    clock_lost
  } = in;

  logic tx, in_ready, out_valid, pixel, de, hsync, vsync, packet, shown, error, store_rst_n;
  logic show_valid, show_buffer, show_pixel_ready, write_valid, write_buffer, write_pixel_valid;
  logic read_valid, read_buffer, read_pixel_ready;
  logic [7:0] out_data;
  logic [PlaceBits-1:0] show_first, write_first, read_first;
  logic [PlaceBits:0] show_count, write_count, read_count;
  logic [23:0] write_rgb, rgb;
  assign out = {
    tx, in_ready, out_valid, out_data, store_rst_n, show_valid, show_buffer, show_first, show_count,
    write_valid, write_buffer, write_first, write_count, read_valid, read_buffer, read_first,
    read_count, show_pixel_ready, read_pixel_ready, write_pixel_valid, write_rgb, packet, shown,
    error, pixel, de, hsync, vsync, rgb
  };
  lipp_board #(
    .Width(Width), .Height(Height), .HFront(HFront), .HSync(HSync), .HBack(HBack),
    .VFront(VFront), .VSync(VSync), .VBack(VBack), .HPositive(HPositive), .VPositive(VPositive),
    .Build(Build), .Scene(Scene)
  ) i_board (
    .clk_i, .rst_ni(rst_n), .identity_i(identity), .step_i(step), .rx_i(rx), .tx_o(tx),
    .in_valid_i(in_valid), .in_ready_o(in_ready), .in_data_i(in_data), .out_valid_o(out_valid),
    .out_ready_i(out_ready), .out_data_o(out_data), .store_rst_no(store_rst_n),
    .show_valid_o(show_valid), .show_ready_i(show_ready), .show_buffer_o(show_buffer),
    .show_first_o(show_first), .show_count_o(show_count), .show_pixel_valid_i(show_pixel_valid),
    .show_pixel_ready_o(show_pixel_ready), .show_rgb_i(show_rgb), .write_valid_o(write_valid),
    .write_ready_i(write_ready), .write_buffer_o(write_buffer), .write_first_o(write_first),
    .write_count_o(write_count), .write_pixel_valid_o(write_pixel_valid),
    .write_pixel_ready_i(write_pixel_ready), .write_rgb_o(write_rgb), .write_done_i(write_done),
    .read_valid_o(read_valid), .read_ready_i(read_ready), .read_buffer_o(read_buffer),
    .read_first_o(read_first), .read_count_o(read_count), .read_pixel_valid_i(read_pixel_valid),
    .read_pixel_ready_o(read_pixel_ready), .read_rgb_i(read_rgb), .pattern_i(pattern),
    .clock_lost_i(clock_lost), .packet_o(packet), .shown_o(shown), .error_o(error),
    .pixel_o(pixel), .de_o(de), .hsync_o(hsync), .vsync_o(vsync), .rgb_o(rgb)
  );

endmodule

`default_nettype wire
