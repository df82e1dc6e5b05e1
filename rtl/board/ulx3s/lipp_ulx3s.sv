// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Top module of the Radiona ULX3S (LFE5U-85F): USB serial line, SDRAM, DVI at the GPDI socket.
///
/// Button 1 resets the board. Button 2 selects the next test pattern. The ports have the names of
/// the board's schematic, where ftdi_txd is the output of the FTDI chip. The LEDs show:
///
///   LED 0: packets arrive.
///   LED 1: a frame or a scene is shown.
///   LED 2: an error occurred, or the PLL has lost its lock.
///   LED 3: the PLL is locked.
///   LEDs 4 to 6: the number of the test pattern.
///   LED 7: blinks with the system clock.
///
/// The data flow through the modules is:
///
///   ftdi_txd -> lipp_video_board -> gpdi_dp
///                      |
///               lipp_ulx3s_memory -> sdram_*
module lipp_ulx3s #(
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
  parameter lipp_scene_pkg::scene_build_t Scene = '0,
  parameter lipp_sdram_pkg::timing_t Timing = lipp_sdram_pkg::Grade75,
  parameter logic [63:0] Identity = '0,
  parameter logic [15:0] UartStep = 16'd7864,  // UART step: 65536 x 3 Mbit/s / ClockHz
  parameter int ClockHz = 25_000_000,
  parameter int MemoryHz = 125_000_000,
  parameter int InputDiv = 1,
  parameter int BackDiv = 20,
  parameter int ShiftDiv = 4,
  parameter int SystemDiv = 20,
  parameter int MemoryDiv = 4
) (
  input  wire         clk_25mhz,
  input  wire  [2:1]  btn,
  output logic [7:0]  led,
  output logic        wifi_gpio0,

  input  wire         ftdi_txd,
  output logic        ftdi_rxd,

  output logic        sdram_clk,
  output logic        sdram_cke,
  output logic        sdram_csn,
  output logic        sdram_rasn,
  output logic        sdram_casn,
  output logic        sdram_wen,
  output logic [1:0]  sdram_ba,
  output logic [12:0] sdram_a,
  output logic [1:0]  sdram_dqm,
  inout  wire  [15:0] sdram_d,

  output logic [3:0]  gpdi_dp
);

  // ---- make the clocks ----
  logic shift_clk, clk, mem_clk, locked, lost, rst_n;
  logic [24:0] blink_q;
  lipp_ulx3s_clocks #(
    .InputDiv(InputDiv), .BackDiv(BackDiv), .ShiftDiv(ShiftDiv),
    .SystemDiv(SystemDiv), .MemoryDiv(MemoryDiv)
  ) i_clocks (
    .clk_i(clk_25mhz), .shift_clk_o(shift_clk), .system_clk_o(clk), .memory_clk_o(mem_clk),
    .locked_o(locked), .lost_o(lost)
  );
  assign rst_n = locked && !btn[1];
  always_ff @(posedge clk) blink_q <= blink_q + 1'b1;

  // ---- instantiate the board ----
  logic linked, shown, alarm, cke, cs_n, ras_n, cas_n, we_n, dq_oe;
  logic [2:0] pattern;
  logic [1:0] ba, dqm;
  logic [12:0] a;
  logic [15:0] dq_out, dq_in;
  logic [3:0][1:0] pair;
  logic [26:0] unused_video;
  lipp_video_board #(
    .ClockHz(ClockHz), .MemoryHz(MemoryHz), .Width(Width), .Height(Height), .HFront(HFront),
    .HSync(HSync), .HBack(HBack), .VFront(VFront), .VSync(VSync), .VBack(VBack),
    .HPositive(HPositive), .VPositive(VPositive), .Build(Build), .Scene(Scene), .Timing(Timing)
  ) i_video_board (
    .clk_i(clk), .shift_clk_i(shift_clk), .mem_clk_i(mem_clk),
    .rst_ni(rst_n), .clock_lost_i(lost), .identity_i(Identity), .step_i(UartStep),
    .rx_i(ftdi_txd), .tx_o(ftdi_rxd), .button_i(btn[2]), .linked_o(linked), .shown_o(shown),
    .alarm_o(alarm), .pattern_o(pattern), .cke_o(cke), .cs_no(cs_n), .ras_no(ras_n),
    .cas_no(cas_n), .we_no(we_n), .ba_o(ba), .a_o(a), .dqm_o(dqm), .dq_o(dq_out), .dq_oe_o(dq_oe),
    .dq_i(dq_in), .de_o(unused_video[26]), .hsync_o(unused_video[25]), .vsync_o(unused_video[24]),
    .rgb_o(unused_video[23:0]), .pair_o(pair)
  );
  assign led = {blink_q[24], pattern, locked, alarm || lost, shown, linked};
  assign wifi_gpio0 = 1'b1;  // high, because low would start the ESP32's boot loader

  // ---- drive the pins of the LEDs and of DVI ----
  lipp_ulx3s_memory i_memory (
    .clk_i(mem_clk), .cke_i(cke), .cs_ni(cs_n), .ras_ni(ras_n), .cas_ni(cas_n), .we_ni(we_n),
    .ba_i(ba), .a_i(a), .dqm_i(dqm), .dq_i(dq_out), .dq_oe_i(dq_oe), .dq_o(dq_in), .sdram_clk,
    .sdram_cke, .sdram_csn, .sdram_rasn, .sdram_casn, .sdram_wen, .sdram_ba, .sdram_a, .sdram_dqm,
    .sdram_d
  );
  for (genvar k = 0; k < 4; k++) begin : gen_pair
    ODDRX1F i_pair (
      .SCLK(shift_clk), .RST(1'b0), .D0(pair[k][0]), .D1(pair[k][1]), .Q(gpdi_dp[k])
    );
  end

endmodule

`default_nettype wire
