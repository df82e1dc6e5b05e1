// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Connects `lipp_board` to a frame store in an SDR SDRAM (`lipp_sdram_store`).
///
/// Input mem_clk_i has the frequency MemoryHz and is asynchronous to clk_i. Parameter PadClocks is
/// the number of registers between the memory ports and the SDRAM's pins, output and input together
/// (see `lipp_sdram_controller`).
module lipp_board_with_sdram #(
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
  parameter lipp_scene_pkg::scene_build_t Scene = '0,  // scene build; layers = 0: no scene
  parameter int MemoryHz = 125_000_000,
  parameter lipp_sdram_pkg::timing_t Timing = lipp_sdram_pkg::Grade75,
  parameter int PadClocks = 0
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

  input  logic [2:0]  pattern_i,     // test pattern; 0: the register sets it
  input  logic        clock_lost_i,
  output logic        packet_o,
  output logic        shown_o,
  output logic        error_o,

  output logic        pixel_o,
  output logic        de_o,
  output logic        hsync_o,
  output logic        vsync_o,
  output logic [23:0] rgb_o,

  input  logic        mem_clk_i,
  output logic        cke_o,
  output logic        cs_no,
  output logic        ras_no,
  output logic        cas_no,
  output logic        we_no,
  output logic [lipp_sdram_pkg::BankBits-1:0] ba_o,
  output logic [lipp_sdram_pkg::RowBits-1:0]  a_o,
  output logic [1:0]  dqm_o,
  output logic [lipp_sdram_pkg::WordBits-1:0] dq_o,
  output logic        dq_oe_o,
  input  logic [lipp_sdram_pkg::WordBits-1:0] dq_i
);

  localparam int PlaceBits = $clog2(Width * Height);
  logic store_rst_n;
  logic show_valid, show_ready, show_buffer, show_pixel_valid, show_pixel_ready;
  logic write_valid, write_ready, write_buffer, write_pixel_valid, write_pixel_ready, write_done;
  logic read_valid, read_ready, read_buffer, read_pixel_valid, read_pixel_ready;
  logic [PlaceBits-1:0] show_first, write_first, read_first;
  logic [PlaceBits:0] show_count, write_count, read_count;
  logic [23:0] show_rgb, write_rgb, read_rgb;
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
    .read_pixel_ready_o(read_pixel_ready), .read_rgb_i(read_rgb), .pattern_i,
    .clock_lost_i, .packet_o, .shown_o, .error_o,
    .pixel_o, .de_o, .hsync_o, .vsync_o, .rgb_o
  );
  lipp_sdram_store #(
    .Width(Width), .Height(Height), .MemoryHz(MemoryHz), .Timing(Timing), .PadClocks(PadClocks)
  ) i_store (
    .clk_i, .rst_ni(store_rst_n),
    .show_valid_i(show_valid), .show_ready_o(show_ready), .show_buffer_i(show_buffer),
    .show_first_i(show_first), .show_count_i(show_count), .show_pixel_valid_o(show_pixel_valid),
    .show_pixel_ready_i(show_pixel_ready), .show_rgb_o(show_rgb), .write_valid_i(write_valid),
    .write_ready_o(write_ready), .write_buffer_i(write_buffer), .write_first_i(write_first),
    .write_count_i(write_count), .write_pixel_valid_i(write_pixel_valid),
    .write_pixel_ready_o(write_pixel_ready), .write_rgb_i(write_rgb), .write_done_o(write_done),
    .read_valid_i(read_valid), .read_ready_o(read_ready), .read_buffer_i(read_buffer),
    .read_first_i(read_first), .read_count_i(read_count), .read_pixel_valid_o(read_pixel_valid),
    .read_pixel_ready_i(read_pixel_ready), .read_rgb_o(read_rgb),
    .mem_clk_i, .cke_o, .cs_no, .ras_no, .cas_no, .we_no, .ba_o, .a_o, .dqm_o, .dq_o, .dq_oe_o,
    .dq_i
  );

endmodule

`default_nettype wire
