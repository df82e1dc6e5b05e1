// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// The top for place-and-route of the whole `lipp_board`; the store of its frames is a memory beside the
/// FPGA, so its ports end in the registers of `probe`, as the board's other ports do.
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
  localparam int In = 64 + 16 + 1 + 10 + 2 * 24;
  localparam int Out = 1 + 10 + (2 + PlaceBits + 24) + 2 * (1 + PlaceBits) + 28;

  logic rst_n;
  logic [In-1:0] in;
  logic [Out-1:0] out;
  probe #(.In(In), .Out(Out)) i_probe (
    .clk_i, .rst_ni, .bit_i, .bit_o, .rst_no(rst_n), .in_o(in), .out_i(out)
  );

  logic [63:0] identity;
  logic [15:0] step;
  logic rx, in_valid, out_ready;
  logic [7:0] in_data;
  logic [23:0] a_rgb, b_rgb;
  assign {identity, step, rx, in_valid, out_ready, in_data, a_rgb, b_rgb} = in;

  logic tx, in_ready, out_valid, write, write_buffer, a_buffer, b_buffer, pixel, de, hsync, vsync;
  logic [7:0] out_data;
  logic [PlaceBits-1:0] write_at, a_at, b_at;
  logic [23:0] write_rgb, rgb;
  assign out = {
    tx, in_ready, out_valid, out_data, write, write_buffer, write_at, write_rgb, a_buffer, a_at,
    b_buffer, b_at, pixel, de, hsync, vsync, rgb
  };
  lipp_board #(
    .Width(Width), .Height(Height), .HFront(HFront), .HSync(HSync), .HBack(HBack),
    .VFront(VFront), .VSync(VSync), .VBack(VBack), .HPositive(HPositive), .VPositive(VPositive),
    .Build(Build), .Scene(Scene)
  ) i_board (
    .clk_i, .rst_ni(rst_n), .identity_i(identity), .step_i(step), .rx_i(rx), .tx_o(tx),
    .in_valid_i(in_valid), .in_ready_o(in_ready), .in_data_i(in_data), .out_valid_o(out_valid),
    .out_ready_i(out_ready), .out_data_o(out_data), .store_write_o(write),
    .store_write_buffer_o(write_buffer), .store_write_at_o(write_at),
    .store_write_rgb_o(write_rgb), .store_a_buffer_o(a_buffer), .store_a_at_o(a_at),
    .store_a_rgb_i(a_rgb), .store_b_buffer_o(b_buffer), .store_b_at_o(b_at),
    .store_b_rgb_i(b_rgb), .pixel_o(pixel), .de_o(de), .hsync_o(hsync), .vsync_o(vsync), .rgb_o(rgb)
  );

endmodule

`default_nettype wire
