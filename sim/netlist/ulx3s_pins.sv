// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/* verilator lint_off DECLFILENAME */
/* verilator lint_off UNUSEDPARAM */
/* verilator lint_off UNUSEDSIGNAL */

/// Top of the simulation of `lipp_ulx3s`, with the outputs of the PLL as inputs. If
/// LIPPMANN_NETLIST is defined, the instance is the netlist of `lipp_ulx3s`, which has no
/// parameters. The other modules in this file are models of the vendor's cells at the pins.
module ulx3s_pins
`ifndef LIPPMANN_NETLIST
#(
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
  parameter logic [63:0] Identity = '0,
  parameter logic [15:0] UartStep = 16'd7864,
  parameter int ClockHz = 25_000_000,
  parameter int MemoryHz = 125_000_000,
  parameter int InputDiv = 1,
  parameter int BackDiv = 20,
  parameter int ShiftDiv = 4,
  parameter int SystemDiv = 20,
  parameter int MemoryDiv = 4
)
`endif
(
  input  wire         clk_25mhz,
  input  wire         pll_clkop,
  input  wire         pll_clkos,
  input  wire         pll_clkos2,
  input  wire         pll_clkos3,
  input  wire         pll_lock,
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

  lipp_ulx3s
`ifndef LIPPMANN_NETLIST
  #(
    .Width(Width), .Height(Height), .HFront(HFront), .HSync(HSync), .HBack(HBack),
    .VFront(VFront), .VSync(VSync), .VBack(VBack), .HPositive(HPositive), .VPositive(VPositive),
    .Build(Build), .Scene(Scene), .Identity(Identity), .UartStep(UartStep), .ClockHz(ClockHz),
    .MemoryHz(MemoryHz), .InputDiv(InputDiv), .BackDiv(BackDiv), .ShiftDiv(ShiftDiv),
    .SystemDiv(SystemDiv), .MemoryDiv(MemoryDiv)
  )
`endif
  i_ulx3s (
    .clk_25mhz, .btn, .led, .wifi_gpio0, .ftdi_txd, .ftdi_rxd, .sdram_clk, .sdram_cke, .sdram_csn,
    .sdram_rasn, .sdram_casn, .sdram_wen, .sdram_ba, .sdram_a, .sdram_dqm, .sdram_d, .gpdi_dp
  );

endmodule

module EHXPLLL #(
  parameter FEEDBK_PATH = "CLKOP",
  parameter CLKI_DIV = 1,
  parameter CLKFB_DIV = 1,
  parameter CLKOP_ENABLE = "ENABLED",
  parameter CLKOP_DIV = 8,
  parameter CLKOP_CPHASE = 0,
  parameter CLKOS_ENABLE = "DISABLED",
  parameter CLKOS_DIV = 8,
  parameter CLKOS_CPHASE = 0,
  parameter CLKOS2_ENABLE = "DISABLED",
  parameter CLKOS2_DIV = 8,
  parameter CLKOS2_CPHASE = 0,
  parameter CLKOS3_ENABLE = "DISABLED",
  parameter CLKOS3_DIV = 8,
  parameter CLKOS3_CPHASE = 0
) (
  input  wire CLKI, CLKFB, RST, STDBY, PHASESEL0, PHASESEL1, PHASEDIR, PHASESTEP, PHASELOADREG,
      PLLWAKESYNC,
    ENCLKOP, ENCLKOS, ENCLKOS2, ENCLKOS3,
  output wire CLKOP, CLKOS, CLKOS2, CLKOS3, LOCK
);
  assign CLKOP = ulx3s_pins.pll_clkop;
  assign CLKOS = ulx3s_pins.pll_clkos;
  assign CLKOS2 = ulx3s_pins.pll_clkos2;
  assign CLKOS3 = ulx3s_pins.pll_clkos3;
  assign LOCK = ulx3s_pins.pll_lock;
endmodule

module ODDRX1F (
  input  wire SCLK, RST, D0, D1,
  output wire Q
);
  logic first_q = 1'b0, second_q = 1'b0;
  always_ff @(posedge SCLK) {first_q, second_q} <= {D0, D1};
  assign Q = SCLK ? first_q : second_q;
endmodule

module OFS1P3BX (
  input  wire  SCLK, SP, PD, D,
  output logic Q = 1'b1
);
  always_ff @(posedge SCLK) if (SP) Q <= D;
endmodule

module OFS1P3DX (
  input  wire  SCLK, SP, CD, D,
  output logic Q = 1'b0
);
  always_ff @(posedge SCLK) if (SP) Q <= D;
endmodule

module IFS1P3DX (
  input  wire  SCLK, SP, CD, D,
  output logic Q = 1'b0
);
  always_ff @(posedge SCLK) if (SP) Q <= D;
endmodule

module BB (
  input  wire I, T,
  output wire O,
  inout  wire B
);
  assign B = T ? 1'bz : I;
  assign O = B;
endmodule

/// Model of the bidirectional pad cell that yosys uses in place of the cell BB.
module TRELLIS_IO #(
  parameter DIR = "BIDIR"
) (
  input wire I, T,
  output wire O,
  inout wire B
);
  if (DIR != "BIDIR") begin : gen_refused
    $fatal(1, "TRELLIS_IO: not modelled");
  end
  BB i_pin (.I, .T, .O, .B);
endmodule

`default_nettype wire
