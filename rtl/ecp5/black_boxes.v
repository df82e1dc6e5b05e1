// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Ports of ECP5's multiplier cell. The cell is a black box, which place-and-route fills in.
module MULT18X18D #(
  parameter REG_INPUTA_CLK = "NONE",
  parameter REG_INPUTA_CE = "NONE",
  parameter REG_INPUTA_RST = "NONE",
  parameter REG_INPUTB_CLK = "NONE",
  parameter REG_INPUTB_CE = "NONE",
  parameter REG_INPUTB_RST = "NONE",
  parameter REG_PIPELINE_CLK = "NONE",
  parameter REG_PIPELINE_CE = "NONE",
  parameter REG_PIPELINE_RST = "NONE",
  parameter REG_OUTPUT_CLK = "NONE",
  parameter REG_OUTPUT_CE = "NONE",
  parameter REG_OUTPUT_RST = "NONE",
  parameter GSR = "NONE",
  parameter RESETMODE = "NONE"
) (
  input CLK0, CLK1, CLK2, CLK3, CE0, CE1, CE2, CE3, RST0, RST1, RST2, RST3, SIGNEDA,
    SIGNEDB, SOURCEA, SOURCEB, A0, A1, A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, A12,
    A13, A14, A15, A16, A17, B0, B1, B2, B3, B4, B5, B6, B7, B8, B9, B10, B11, B12, B13,
    B14, B15, B16, B17,
  output P0, P1, P2, P3, P4, P5, P6, P7, P8, P9, P10, P11, P12, P13, P14, P15, P16, P17, P18,
    P19, P20, P21, P22, P23, P24, P25, P26, P27, P28, P29, P30, P31, P32, P33, P34, P35
);
endmodule

/// Ports of ECP5's carry cell, which adds two bits.
module CCU2C #(
  parameter [15:0] INIT0 = 16'h0000,
  parameter [15:0] INIT1 = 16'h0000,
  parameter INJECT1_0 = "YES",
  parameter INJECT1_1 = "YES"
) (
  input CIN, A0, B0, C0, D0, A1, B1, C1, D1,
  output S0, S1, COUT
);
endmodule

/// Ports of ECP5's block memory.
module DP16KD #(
  parameter DATA_WIDTH_A = 18,
  parameter DATA_WIDTH_B = 18,
  parameter REGMODE_A = "NONE",
  parameter REGMODE_B = "NONE",
  parameter RESETMODE = "NONE",
  parameter ASYNC_RESET_RELEASE = "NONE",
  parameter WRITEMODE_A = "NONE",
  parameter WRITEMODE_B = "NONE",
  parameter CSDECODE_A = "NONE",
  parameter CSDECODE_B = "NONE",
  parameter GSR = "NONE"
) (
  input CLKA, CEA, OCEA, WEA, RSTA, CSA0, CSA1, CSA2, ADA0, ADA1, ADA2, ADA3, ADA4, ADA5, ADA6,
    ADA7, ADA8, ADA9, ADA10, ADA11, ADA12, ADA13, DIA0, DIA1, DIA2, DIA3, DIA4, DIA5, DIA6,
    DIA7, DIA8, DIA9, DIA10, DIA11, DIA12, DIA13, DIA14, DIA15, DIA16, DIA17, CLKB, CEB, OCEB,
    WEB, RSTB, CSB0, CSB1, CSB2, ADB0, ADB1, ADB2, ADB3, ADB4, ADB5, ADB6, ADB7, ADB8, ADB9,
    ADB10, ADB11, ADB12, ADB13, DIB0, DIB1, DIB2, DIB3, DIB4, DIB5, DIB6, DIB7, DIB8, DIB9,
    DIB10, DIB11, DIB12, DIB13, DIB14, DIB15, DIB16, DIB17,
  output DOA0, DOA1, DOA2, DOA3, DOA4, DOA5, DOA6, DOA7, DOA8, DOA9, DOA10, DOA11, DOA12, DOA13,
    DOA14, DOA15, DOA16, DOA17, DOB0, DOB1, DOB2, DOB3, DOB4, DOB5, DOB6, DOB7, DOB8, DOB9,
    DOB10, DOB11, DOB12, DOB13, DOB14, DOB15, DOB16, DOB17
);
endmodule

/// Ports of ECP5's PLL.
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
  input CLKI, CLKFB, RST, STDBY, PHASESEL0, PHASESEL1, PHASEDIR, PHASESTEP, PHASELOADREG,
    PLLWAKESYNC, ENCLKOP, ENCLKOS, ENCLKOS2, ENCLKOS3,
  output CLKOP, CLKOS, CLKOS2, CLKOS3, LOCK
);
endmodule

/// Ports of ECP5's DDR output cell. It sends D0 while the clock is high, D1 while the clock is low.
module ODDRX1F (
  input SCLK, RST, D0, D1,
  output Q
);
endmodule

/// Ports of ECP5's pad registers: output with power-up value 1, output with 0, and input.
module OFS1P3BX (
  input SCLK, SP, PD, D,
  output Q
);
endmodule

module OFS1P3DX (
  input SCLK, SP, CD, D,
  output Q
);
endmodule

module IFS1P3DX (
  input SCLK, SP, CD, D,
  output Q
);
endmodule

/// Ports of ECP5's bidirectional pad.
module BB (
  input I, T,
  output O,
  inout B
);
endmodule

`default_nettype wire
