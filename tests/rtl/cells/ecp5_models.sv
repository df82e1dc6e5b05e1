/// Models of ECP5's cells as its data sheet tells of them, for the uses that rtl/ecp5 makes of them.
///
/// Written apart from the modules under test: what they do not use is refused.

/* verilator lint_off UNUSEDSIGNAL */

/// Multiplier 18 x 18: registers at the operands, in the middle and at the product, each used or not.
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

  logic signed [17:0] a, b, a_q, b_q, a_in, b_in;
  logic signed [35:0] product, product_q, middle, p_q, p;
  assign a = {
    A17, A16, A15, A14, A13, A12, A11, A10, A9, A8, A7, A6, A5, A4, A3, A2, A1, A0
  };
  assign b = {
    B17, B16, B15, B14, B13, B12, B11, B10, B9, B8, B7, B6, B5, B4, B3, B2, B1, B0
  };
  assign {
    P35, P34, P33, P32, P31, P30, P29, P28, P27, P26, P25, P24, P23, P22, P21, P20, P19, P18,
    P17, P16, P15, P14, P13, P12, P11, P10, P9, P8, P7, P6, P5, P4, P3, P2, P1, P0
  } = p;

  initial begin
    if (GSR != "DISABLED" || RESETMODE != "SYNC") $fatal(1, "MULT18X18D: not modelled");
  end
  always_ff @(posedge CLK0) begin
    if (CLK1 || CLK2 || CLK3 || SOURCEA || SOURCEB || !SIGNEDA || !SIGNEDB)
      $fatal(1, "MULT18X18D: not modelled");
  end

  always_ff @(posedge CLK0) begin
    if (RST0) begin
      {a_q, b_q, product_q, p_q} <= '0;
    end else if (CE0) begin
      a_q <= a;
      b_q <= b;
      product_q <= product;
      p_q <= middle;
    end
  end
  assign a_in = REG_INPUTA_CLK == "CLK0" ? a_q : a;
  assign b_in = REG_INPUTB_CLK == "CLK0" ? b_q : b;
  assign product = a_in * b_in;
  assign middle = REG_PIPELINE_CLK == "CLK0" ? product_q : product;
  assign p = REG_OUTPUT_CLK == "CLK0" ? p_q : middle;

endmodule

/// Two bits of a carry chain. Each has a table of four inputs, whose output is added to the carry; where it is 0, the
/// table's entry of A and B alone (C and D low) is the carry that follows, otherwise the carry passes.
module CCU2C #(
  parameter [15:0] INIT0 = 16'h0000,
  parameter [15:0] INIT1 = 16'h0000,
  parameter INJECT1_0 = "YES",
  parameter INJECT1_1 = "YES"
) (
  input CIN, A0, B0, C0, D0, A1, B1, C1, D1,
  output S0, S1, COUT
);

  logic adds_0, adds_1, middle;
  initial begin
    if (INJECT1_0 != "NO" || INJECT1_1 != "NO") $fatal(1, "CCU2C: not modelled");
  end
  assign adds_0 = INIT0[{D0, C0, B0, A0}];
  assign adds_1 = INIT1[{D1, C1, B1, A1}];
  assign middle = adds_0 ? CIN : INIT0[{2'b00, B0, A0}];
  assign COUT = adds_1 ? middle : INIT1[{2'b00, B1, A1}];
  assign S0 = adds_0 ^ CIN;
  assign S1 = adds_1 ^ middle;

endmodule

/// Block memory of 512 x 36, 1024 x 18, 2048 x 9, 4096 x 4, 8192 x 2 or 16384 x 1 bits: port A writes,
/// port B reads.
///
/// The address is AD[13:5], AD[13:4], AD[13:3], AD[13:2], AD[13:1] or AD[13:0]. In words of 18 bits ADA[1:0]
/// enable the bytes of 9 bits that are written, in those of 36 ADA[3:0]. Those of 36 come in through DIA (the
/// lower half) and DIB, leave through DOA and DOB, and have no write enable: WEA must be high. What
/// is read while the other port writes it is not defined: here, its complement.
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

  logic [13:0] ada, adb;
  logic [17:0] doa, dob;
  logic [35:0] dia, word_q, out_q, out;
  assign ada = {
    ADA13, ADA12, ADA11, ADA10, ADA9, ADA8, ADA7, ADA6, ADA5, ADA4, ADA3, ADA2, ADA1, ADA0
  };
  assign adb = {
    ADB13, ADB12, ADB11, ADB10, ADB9, ADB8, ADB7, ADB6, ADB5, ADB4, ADB3, ADB2, ADB1, ADB0
  };
  assign dia = {
    DIB17, DIB16, DIB15, DIB14, DIB13, DIB12, DIB11, DIB10, DIB9, DIB8, DIB7, DIB6, DIB5,
    DIB4, DIB3, DIB2, DIB1, DIB0, DIA17, DIA16, DIA15, DIA14, DIA13, DIA12, DIA11, DIA10, DIA9, DIA8, DIA7, DIA6, DIA5,
    DIA4, DIA3, DIA2, DIA1, DIA0
  };
  assign {
    DOB17, DOB16, DOB15, DOB14, DOB13, DOB12, DOB11, DOB10, DOB9, DOB8, DOB7, DOB6, DOB5,
    DOB4, DOB3, DOB2, DOB1, DOB0
  } = dob;
  assign {
    DOA17, DOA16, DOA15, DOA14, DOA13, DOA12, DOA11, DOA10, DOA9, DOA8, DOA7, DOA6, DOA5,
    DOA4, DOA3, DOA2, DOA1, DOA0
  } = doa;

  initial begin
    if (!(DATA_WIDTH_A inside {36, 18, 9, 4, 2, 1}) || DATA_WIDTH_B != DATA_WIDTH_A || CSDECODE_A != "0b000" || CSDECODE_B != "0b000"
        || RESETMODE != "SYNC" || WRITEMODE_A != "NORMAL" || GSR != "DISABLED")
      $fatal(1, "DP16KD: not modelled");
  end

  localparam int Low = DATA_WIDTH_A == 36 ? 5 : DATA_WIDTH_A == 18 ? 4 : DATA_WIDTH_A == 9 ? 3
      : DATA_WIDTH_A == 4 ? 2 : DATA_WIDTH_A == 2 ? 1 : 0;
  localparam logic [35:0] Whole = 36'((64'd1 << DATA_WIDTH_A) - 1);
  logic [35:0] words[16384];
  logic [35:0] bytes;
  logic [13:0] a_word, b_word;
  logic write;
  assign bytes = DATA_WIDTH_A == 36 ? {{9{ada[3]}}, {9{ada[2]}}, {9{ada[1]}}, {9{ada[0]}}}
      : DATA_WIDTH_A == 18 ? {18'd0, {9{ada[1]}}, {9{ada[0]}}} : Whole;
  assign a_word = ada >> Low;
  assign b_word = adb >> Low;
  assign write = CEA && WEA && {CSA2, CSA1, CSA0} == 3'b000 && bytes != '0;
  always_ff @(posedge CLKA) begin
    if (DATA_WIDTH_A == 36 && !WEA) $fatal(1, "DP16KD: words of 36 bits have no write enable");
    if (write) words[a_word] <= (dia & bytes) | (words[a_word] & ~bytes & Whole);
  end
  always_ff @(posedge CLKB) begin
    if (WEB) $fatal(1, "DP16KD: writing through port B is not modelled");
    if (RSTB) begin
      word_q <= '0;
      out_q <= '0;
    end else begin
      if (CEB && {CSB2, CSB1, CSB0} == 3'b000)
        word_q <= write && a_word == b_word ? ~words[b_word] : words[b_word];
      if (OCEB) out_q <= word_q;
    end
  end
  assign out = REGMODE_B == "OUTREG" ? out_q : word_q;
  assign {dob, doa} = DATA_WIDTH_A == 36 ? out : {out[17:0], 18'd0};

endmodule
