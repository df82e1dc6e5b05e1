// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/* verilator lint_off DECLFILENAME */
/* verilator lint_off UNUSEDPARAM */
/* verilator lint_off UNUSEDSIGNAL */

/// Models of ECP5's multiplier cell and block memory cell for the simulation of a netlist, because
/// yosys has only the ports of these cells. A configuration of the cells that neither yosys nor
/// rtl/ecp5 uses stops the simulation.

/// Model of the signed 18 x 18 multiplier cell, with optional registers at the operands, in the
/// middle and at the product, all clocked by CLK0.
module MULT18X18D #(
  parameter REG_INPUTA_CLK = "NONE",
  parameter REG_INPUTA_CE = "CE0",
  parameter REG_INPUTA_RST = "RST0",
  parameter REG_INPUTB_CLK = "NONE",
  parameter REG_INPUTB_CE = "CE0",
  parameter REG_INPUTB_RST = "RST0",
  parameter REG_PIPELINE_CLK = "NONE",
  parameter REG_PIPELINE_CE = "CE0",
  parameter REG_PIPELINE_RST = "RST0",
  parameter REG_OUTPUT_CLK = "NONE",
  parameter REG_OUTPUT_CE = "CE0",
  parameter REG_OUTPUT_RST = "RST0",
  parameter GSR = "ENABLED",
  parameter RESETMODE = "SYNC"
) (
  input wire CLK0, CLK1, CLK2, CLK3, CE0, CE1, CE2, CE3, RST0, RST1, RST2, RST3, SIGNEDA, SIGNEDB,
    SOURCEA, SOURCEB,
  input wire A0, A1, A2, A3, A4, A5, A6, A7, A8, A9, A10, A11, A12, A13, A14, A15, A16, A17,
  input wire B0, B1, B2, B3, B4, B5, B6, B7, B8, B9, B10, B11, B12, B13, B14, B15, B16, B17,
  output wire P0, P1, P2, P3, P4, P5, P6, P7, P8, P9, P10, P11, P12, P13, P14, P15, P16, P17, P18,
    P19, P20, P21, P22, P23, P24, P25, P26, P27, P28, P29, P30, P31, P32, P33, P34, P35
);

  localparam bit Clock0 = (REG_INPUTA_CLK == "CLK0" || REG_INPUTA_CLK == "NONE")
      && (REG_INPUTB_CLK == "CLK0" || REG_INPUTB_CLK == "NONE")
      && (REG_PIPELINE_CLK == "CLK0" || REG_PIPELINE_CLK == "NONE")
      && (REG_OUTPUT_CLK == "CLK0" || REG_OUTPUT_CLK == "NONE");
  if (!Clock0 || GSR != "DISABLED" || RESETMODE != "SYNC") begin : gen_refused
    $fatal(1, "MULT18X18D: not modelled");
  end
  initial begin
    if (SOURCEA || SOURCEB || !SIGNEDA || !SIGNEDB || !CE0 || RST0) $fatal(1,
        "MULT18X18D: not modelled");
  end

  logic signed [17:0] a, b;
  logic signed [35:0] product, p;
  wire signed [17:0] a_in = {A17, A16, A15, A14, A13, A12, A11, A10, A9, A8, A7, A6, A5, A4, A3, A2,
      A1, A0};
  wire signed [17:0] b_in = {B17, B16, B15, B14, B13, B12, B11, B10, B9, B8, B7, B6, B5, B4, B3, B2,
      B1, B0};
  assign {
    P35, P34, P33, P32, P31, P30, P29, P28, P27, P26, P25, P24, P23, P22, P21, P20, P19, P18, P17,
    P16, P15, P14, P13, P12, P11, P10, P9, P8, P7, P6, P5, P4, P3, P2, P1, P0
  } = p;

  if (REG_INPUTA_CLK == "NONE") begin : gen_a
    assign a = a_in;
  end else begin : gen_a_q
    always_ff @(posedge CLK0) a <= a_in;
  end
  if (REG_INPUTB_CLK == "NONE") begin : gen_b
    assign b = b_in;
  end else begin : gen_b_q
    always_ff @(posedge CLK0) b <= b_in;
  end
  if (REG_PIPELINE_CLK == "NONE") begin : gen_product
    assign product = a * b;
  end else begin : gen_product_q
    always_ff @(posedge CLK0) product <= a * b;
  end
  if (REG_OUTPUT_CLK == "NONE") begin : gen_p
    assign p = product;
  end else begin : gen_p_q
    always_ff @(posedge CLK0) p <= product;
  end

endmodule

/// Model of the block memory cell of 512 x 36, 1024 x 18, 2048 x 9, 4096 x 4, 8192 x 2 or 16384 x 1
/// bits. In the order of these sizes, the address of a word is AD[13:5], AD[13:4], AD[13:3],
/// AD[13:2], AD[13:1] or AD[13:0]. Port A writes and port B reads. The write enables of the 9-bit
/// bytes are ADA[1:0] for words of 18 bits, and ADA[3:0] for words of 36 bits. Words of 36 bits are
/// written through DIA (the lower half) and DIB, and read through DOA and DOB. ECP5 does not define
/// the value that port B reads while port A writes the same word; the model returns the complement
/// of the word.
module DP16KD #(
  parameter DATA_WIDTH_A = 18,
  parameter DATA_WIDTH_B = 18,
  parameter REGMODE_A = "NOREG",
  parameter REGMODE_B = "NOREG",
  parameter RESETMODE = "SYNC",
  parameter ASYNC_RESET_RELEASE = "SYNC",
  parameter WRITEMODE_A = "NORMAL",
  parameter WRITEMODE_B = "NORMAL",
  parameter CSDECODE_A = "0b000",
  parameter CSDECODE_B = "0b000",
  parameter CLKAMUX = "CLKA",
  parameter CLKBMUX = "CLKB",
  parameter GSR = "ENABLED",
  parameter INITVAL_00 = 320'd0, INITVAL_01 = 320'd0, INITVAL_02 = 320'd0, INITVAL_03 = 320'd0,
  parameter INITVAL_04 = 320'd0, INITVAL_05 = 320'd0, INITVAL_06 = 320'd0, INITVAL_07 = 320'd0,
  parameter INITVAL_08 = 320'd0, INITVAL_09 = 320'd0, INITVAL_0A = 320'd0, INITVAL_0B = 320'd0,
  parameter INITVAL_0C = 320'd0, INITVAL_0D = 320'd0, INITVAL_0E = 320'd0, INITVAL_0F = 320'd0,
  parameter INITVAL_10 = 320'd0, INITVAL_11 = 320'd0, INITVAL_12 = 320'd0, INITVAL_13 = 320'd0,
  parameter INITVAL_14 = 320'd0, INITVAL_15 = 320'd0, INITVAL_16 = 320'd0, INITVAL_17 = 320'd0,
  parameter INITVAL_18 = 320'd0, INITVAL_19 = 320'd0, INITVAL_1A = 320'd0, INITVAL_1B = 320'd0,
  parameter INITVAL_1C = 320'd0, INITVAL_1D = 320'd0, INITVAL_1E = 320'd0, INITVAL_1F = 320'd0,
  parameter INITVAL_20 = 320'd0, INITVAL_21 = 320'd0, INITVAL_22 = 320'd0, INITVAL_23 = 320'd0,
  parameter INITVAL_24 = 320'd0, INITVAL_25 = 320'd0, INITVAL_26 = 320'd0, INITVAL_27 = 320'd0,
  parameter INITVAL_28 = 320'd0, INITVAL_29 = 320'd0, INITVAL_2A = 320'd0, INITVAL_2B = 320'd0,
  parameter INITVAL_2C = 320'd0, INITVAL_2D = 320'd0, INITVAL_2E = 320'd0, INITVAL_2F = 320'd0,
  parameter INITVAL_30 = 320'd0, INITVAL_31 = 320'd0, INITVAL_32 = 320'd0, INITVAL_33 = 320'd0,
  parameter INITVAL_34 = 320'd0, INITVAL_35 = 320'd0, INITVAL_36 = 320'd0, INITVAL_37 = 320'd0,
  parameter INITVAL_38 = 320'd0, INITVAL_39 = 320'd0, INITVAL_3A = 320'd0, INITVAL_3B = 320'd0,
  parameter INITVAL_3C = 320'd0, INITVAL_3D = 320'd0, INITVAL_3E = 320'd0, INITVAL_3F = 320'd0
) (
  input wire CLKA, CEA, OCEA, WEA, RSTA, CSA0, CSA1, CSA2, CLKB, CEB, OCEB, WEB, RSTB, CSB0, CSB1,
      CSB2,
  input wire ADA0, ADA1, ADA2, ADA3, ADA4, ADA5, ADA6, ADA7, ADA8, ADA9, ADA10, ADA11, ADA12, ADA13,
  input wire ADB0, ADB1, ADB2, ADB3, ADB4, ADB5, ADB6, ADB7, ADB8, ADB9, ADB10, ADB11, ADB12, ADB13,
  input wire DIA0, DIA1, DIA2, DIA3, DIA4, DIA5, DIA6, DIA7, DIA8, DIA9, DIA10, DIA11, DIA12, DIA13,
      DIA14,
    DIA15, DIA16, DIA17,
  input wire DIB0, DIB1, DIB2, DIB3, DIB4, DIB5, DIB6, DIB7, DIB8, DIB9, DIB10, DIB11, DIB12, DIB13,
      DIB14,
    DIB15, DIB16, DIB17,
  output wire DOA0, DOA1, DOA2, DOA3, DOA4, DOA5, DOA6, DOA7, DOA8, DOA9, DOA10, DOA11, DOA12,
      DOA13, DOA14,
    DOA15, DOA16, DOA17,
  output wire DOB0, DOB1, DOB2, DOB3, DOB4, DOB5, DOB6, DOB7, DOB8, DOB9, DOB10, DOB11, DOB12,
      DOB13, DOB14,
    DOB15, DOB16, DOB17
);

  localparam int Low = DATA_WIDTH_A == 36 ? 5 : DATA_WIDTH_A == 18 ? 4 : DATA_WIDTH_A == 9 ? 3
      : DATA_WIDTH_A == 4 ? 2 : DATA_WIDTH_A == 2 ? 1 : 0;
  localparam int W = DATA_WIDTH_A;
  localparam bit Register = REGMODE_B == "OUTREG";
  if ((1 << (14 - Low)) * (W == 9 || W == 18 || W == 36 ? W / 9 * 8 : W) != 16384
      || DATA_WIDTH_B != W || REGMODE_A != REGMODE_B || CSDECODE_A != "0b000"
          || CSDECODE_B != "0b000"
      || CLKAMUX != "CLKA" || CLKBMUX != "CLKB" || GSR != "DISABLED"
      || |{INITVAL_00, INITVAL_01, INITVAL_02, INITVAL_03, INITVAL_04, INITVAL_05, INITVAL_06,
          INITVAL_07,
      INITVAL_08, INITVAL_09, INITVAL_0A, INITVAL_0B, INITVAL_0C, INITVAL_0D, INITVAL_0E,
      INITVAL_0F,
      INITVAL_10, INITVAL_11, INITVAL_12, INITVAL_13, INITVAL_14, INITVAL_15, INITVAL_16,
      INITVAL_17,
      INITVAL_18, INITVAL_19, INITVAL_1A, INITVAL_1B, INITVAL_1C, INITVAL_1D, INITVAL_1E,
      INITVAL_1F,
      INITVAL_20, INITVAL_21, INITVAL_22, INITVAL_23, INITVAL_24, INITVAL_25, INITVAL_26,
      INITVAL_27,
      INITVAL_28, INITVAL_29, INITVAL_2A, INITVAL_2B, INITVAL_2C, INITVAL_2D, INITVAL_2E,
      INITVAL_2F,
      INITVAL_30, INITVAL_31, INITVAL_32, INITVAL_33, INITVAL_34, INITVAL_35, INITVAL_36,
      INITVAL_37,
      INITVAL_38, INITVAL_39, INITVAL_3A, INITVAL_3B, INITVAL_3C, INITVAL_3D, INITVAL_3E,
      INITVAL_3F}) begin : gen_refused
    $fatal(1, "DP16KD: not modelled");
  end
  initial begin
    // Stop the simulation if port B writes, a reset is used, or WEA is low with words of 36 bits.
    if (WEB || RSTA || RSTB || CSA0 || CSA1 || CSA2 || CSB0 || CSB1 || CSB2 || (W == 36 && !WEA))
      $fatal(1, "DP16KD: not modelled");
  end

  wire [13:0] ada = {ADA13, ADA12, ADA11, ADA10, ADA9, ADA8, ADA7, ADA6, ADA5, ADA4, ADA3, ADA2,
      ADA1, ADA0};
  wire [13:0] adb = {ADB13, ADB12, ADB11, ADB10, ADB9, ADB8, ADB7, ADB6, ADB5, ADB4, ADB3, ADB2,
      ADB1, ADB0};
  wire [35:0] di = {
    DIB17, DIB16, DIB15, DIB14, DIB13, DIB12, DIB11, DIB10, DIB9, DIB8, DIB7, DIB6, DIB5, DIB4,
        DIB3,
    DIB2, DIB1, DIB0, DIA17, DIA16, DIA15, DIA14, DIA13, DIA12, DIA11, DIA10, DIA9, DIA8, DIA7,
    DIA6,
    DIA5, DIA4, DIA3, DIA2, DIA1, DIA0
  };
  logic [W-1:0] words[1 << (14 - Low)];
  logic [W-1:0] bytes, b_word_q, b_q, b_out;
  wire [13-Low:0] a_at = ada[13:Low];
  wire [13-Low:0] b_at = adb[13:Low];
  wire write = CEA && WEA && (W < 18 || bytes != '0);
  for (genvar k = 0; k < W; k++) begin : gen_byte
    assign bytes[k] = W == 36 || W == 18 ? ada[k / 9] : 1'b1;
  end
  always_ff @(posedge CLKA) begin
    if (write) words[a_at] <= W < 18 ? di[W-1:0] : (di[W-1:0] & bytes) | (words[a_at] & ~bytes);
  end
  always_ff @(posedge CLKB) begin
    if (CEB) b_word_q <= write && a_at == b_at ? ~words[b_at] : words[b_at];
    if (OCEB) b_q <= b_word_q;
  end
  assign b_out = Register ? b_q : b_word_q;

  // The read data of port A are modelled only for words of 36 bits, which use both ports.
  logic [17:0] doa, dob;
  if (W == 36) begin : gen_wide
    assign {dob, doa} = 36'(b_out);
  end else begin : gen_both
    assign dob = 18'(b_out);
    assign doa = '0;
  end
  assign {
    DOB17, DOB16, DOB15, DOB14, DOB13, DOB12, DOB11, DOB10, DOB9, DOB8, DOB7, DOB6, DOB5, DOB4,
        DOB3,
    DOB2, DOB1, DOB0
  } = dob;
  assign {
    DOA17, DOA16, DOA15, DOA14, DOA13, DOA12, DOA11, DOA10, DOA9, DOA8, DOA7, DOA6, DOA5, DOA4,
        DOA3,
    DOA2, DOA1, DOA0
  } = doa;

endmodule

`default_nettype wire
