// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// A complete board design that contains no vendor-specific FPGA cells; the top module of a board
/// adds these cells.
///
/// The module contains `lipp_board_with_sdram` with a serial line. The video outputs are the
/// panel's parallel signals and, if Dvi = 1, also bit pairs for DVI.
///
/// The module has three clocks. Input clk_i has the frequency ClockHz and is the pixel clock if Dvi
/// = 1. Input shift_clk_i comes from the same source and is five times as fast as clk_i. Input
/// mem_clk_i has the frequency MemoryHz and is asynchronous to the other two clocks. Each clock has
/// its own reset, made from the asynchronous reset rst_ni, for example the lock signal of a PLL.
/// The video is black while rst_ni is low, and remains black until the first frame is shown.
///
/// `lipp_sdram_controller` describes the SDRAM's pins, `lipp_buttons_and_lamps` the status LEDs.
///
///   rx_i -> lipp_board_with_sdram <-> pins of the SDRAM
///                     |
///                     +-> de_o, hsync_o, vsync_o, rgb_o -> lipp_dvi_out -> pair_o
module lipp_video_board #(
  parameter bit Dvi = 1'b1,
  parameter int ClockHz = 25_000_000,
  parameter int MemoryHz = 125_000_000,
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
  parameter lipp_optics_pkg::build_t Build = '{
    fraction_bits: 5'd16, model: 2'(lipp_optics_pkg::ModelExact), default: '0
  },
  parameter lipp_scene_pkg::scene_build_t Scene = '0,
  parameter lipp_sdram_pkg::timing_t Timing = lipp_sdram_pkg::Grade75,
  parameter int PadClocks = 2
) (
  input  logic            clk_i,
  input  logic            shift_clk_i,   // clock of pair_o, 5 x clk_i; used if Dvi = 1
  input  logic            mem_clk_i,
  input  logic            rst_ni,
  input  logic            clock_lost_i,  // asynchronous level: a clock failed since power-up
  input  logic [63:0]     identity_i,    // hash that identifies the panel and its lenslet array

  input  logic [15:0]     step_i,        // UART baud rate / clock frequency, times 65536
  input  logic            rx_i,
  output logic            tx_o,

  input  logic            button_i,
  output logic            linked_o,
  output logic            shown_o,
  output logic            alarm_o,
  output logic [2:0]      pattern_o,

  output logic            cke_o,
  output logic            cs_no,
  output logic            ras_no,
  output logic            cas_no,
  output logic            we_no,
  output logic [lipp_sdram_pkg::BankBits-1:0] ba_o,
  output logic [lipp_sdram_pkg::RowBits-1:0]  a_o,
  output logic [1:0]      dqm_o,
  output logic [lipp_sdram_pkg::WordBits-1:0] dq_o,
  output logic            dq_oe_o,
  input  logic [lipp_sdram_pkg::WordBits-1:0] dq_i,

  output logic            de_o,  // data enable; de_o, syncs and rgb_o are synchronous to clk_i
  output logic            hsync_o,
  output logic            vsync_o,
  output logic [23:0]     rgb_o,
  output logic [3:0][1:0] pair_o         // TMDS bit pairs, synchronous to shift_clk_i
);

  logic rst_n, clock_lost, packet, error;
  lipp_reset_sync i_reset (.clk_i, .rst_ni, .rst_no(rst_n));
  lipp_bit_sync i_clock_lost (.clk_i, .rst_ni(rst_n), .d_i(clock_lost_i), .q_o(clock_lost));
  lipp_buttons_and_lamps i_lamps (
    .clk_i, .rst_ni(rst_n), .packet_i(packet), .error_i(error), .clock_lost_i(clock_lost),
    .button_i, .linked_o, .alarm_o, .pattern_o
  );

  logic unused_in_ready, unused_out_valid, unused_pixel;
  logic [7:0] unused_out_data;
  lipp_board_with_sdram #(
    .ClockHz(ClockHz), .Width(Width), .Height(Height), .HFront(HFront), .HSync(HSync),
    .HBack(HBack), .VFront(VFront), .VSync(VSync), .VBack(VBack), .HPositive(HPositive),
    .VPositive(VPositive), .Build(Build), .Scene(Scene), .MemoryHz(MemoryHz), .Timing(Timing),
    .PadClocks(PadClocks)
  ) i_board (
    .clk_i, .rst_ni, .identity_i, .step_i, .rx_i, .tx_o, .in_valid_i(1'b0),
    .in_ready_o(unused_in_ready), .in_data_i('0), .out_valid_o(unused_out_valid),
    .out_ready_i(1'b0), .out_data_o(unused_out_data), .pattern_i(pattern_o),
    .clock_lost_i(clock_lost), .packet_o(packet), .shown_o, .error_o(error),
    .pixel_o(unused_pixel), .de_o, .hsync_o, .vsync_o, .rgb_o, .mem_clk_i, .cke_o, .cs_no, .ras_no,
    .cas_no, .we_no, .ba_o, .a_o, .dqm_o, .dq_o, .dq_oe_o, .dq_i
  );

  // ---- convert the video to DVI ----
  if (Dvi) begin : gen_dvi
    if (Scene.layers != 0 && Scene.samples_bits != 0) begin : gen_illegal_samples
      $fatal(1, "lipp_video_board: with Dvi = 1, Scene.samples_bits must be 0");
    end
    logic shift_rst_n;
    lipp_reset_sync i_shift_reset (.clk_i(shift_clk_i), .rst_ni, .rst_no(shift_rst_n));
    lipp_dvi_out i_dvi_out (
      .pixel_clk_i(clk_i), .pixel_rst_ni(rst_n), .de_i(de_o), .hsync_i(hsync_o), .vsync_i(vsync_o),
      .rgb_i(rgb_o), .shift_clk_i, .shift_rst_ni(shift_rst_n), .pair_o
    );
  end else begin : gen_parallel
    assign pair_o = '0;
    logic unused_clock;
    assign unused_clock = shift_clk_i;
  end

endmodule

`default_nettype wire
