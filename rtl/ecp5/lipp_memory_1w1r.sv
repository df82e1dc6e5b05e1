// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Implements `lipp_memory_1w1r` in the block memory cells of ECP5, with their output registers.
///
/// Ports and behaviour are those of rtl/common/lipp_memory_1w1r.sv. Port A writes and port B reads.
/// A cell is configured as 512 words x 36 bits, 1024 x 18, 2048 x 9, 4096 x 4, 8192 x 2 or 16384 x
/// 1. Words of 36 bits use the data pins of both ports of the cell. Reading an address while it is
/// being written is undefined; no FIFO and no request of the board does so.
module lipp_memory_1w1r #(
  parameter int Width = 36,
  parameter int AddressBits = 9
) (
  input  logic                   clk_i,
  input  logic                   write_i,
  input  logic [AddressBits-1:0] write_at_i,
  input  logic [Width-1:0]       write_data_i,
  input  logic [AddressBits-1:0] read_at_i,
  output logic [Width-1:0]       read_data_o
);

  // Bits is the width of a cell's word. Shift is the number of low bits of the cell's 14 address
  // bits that do not address a word.
  localparam int Bits = AddressBits <= 9 && Width > 18 ? 36 : AddressBits <= 10 ? 18
      : AddressBits == 11 ? 9 : 1 << (14 - AddressBits);
  localparam int Shift = Bits == 36 ? 5 : Bits == 18 ? 4 : 14 - AddressBits;
  localparam int Cells = (Width + Bits - 1) / Bits;

  if (AddressBits < 1 || AddressBits > 14) begin : gen_illegal
    $fatal(1, "lipp_memory_1w1r: AddressBits must be 1 to 14");
  end

  // With words of 18 bits, the two lowest address bits of port A are the bytes' write enables. With
  // words of 36 bits, the four lowest bits are write enables, and the write enable pin is high.
  logic [13:0] write_at, read_at;
  logic [Bits*Cells-1:0] write_data, read_data;
  assign write_at = 14'(write_at_i) << Shift
      | (Bits == 36 ? {10'd0, {4{write_i}}} : Bits == 18 ? 14'd3 : 14'd0);
  assign read_at = 14'(read_at_i) << Shift;
  assign write_data = (Bits * Cells)'(write_data_i);
  assign read_data_o = read_data[Width-1:0];
  logic unused_read;
  assign unused_read = ^read_data;

  for (genvar k = 0; k < Cells; k++) begin : gen_cell
    logic [35:0] d, q;
    assign d = 36'(write_data[Bits*k+:Bits]);
    // The lower half of a 36-bit word is read at the data output of port A.
    logic [17:0] a, b;
    assign q = Bits == 36 ? {b, a} : {a, b};
    assign read_data[Bits*k+:Bits] = q[Bits-1:0];
    logic unused_q;
    assign unused_q = ^q;

    DP16KD #(
      .DATA_WIDTH_A(Bits), .DATA_WIDTH_B(Bits), .REGMODE_A("OUTREG"), .REGMODE_B("OUTREG"),
      .WRITEMODE_A("NORMAL"), .WRITEMODE_B("NORMAL"), .CSDECODE_A("0b000"), .CSDECODE_B("0b000"),
      .RESETMODE("SYNC"), .ASYNC_RESET_RELEASE("SYNC"), .GSR("DISABLED")
    ) i_cell (
      .CLKA(clk_i), .CEA(1'b1), .OCEA(1'b1), .WEA(Bits == 36 ? 1'b1 : write_i), .RSTA(1'b0),
      .CSA2(1'b0), .CSA1(1'b0), .CSA0(1'b0),
      .ADA13(write_at[13]), .ADA12(write_at[12]), .ADA11(write_at[11]), .ADA10(write_at[10]),
      .ADA9(write_at[9]), .ADA8(write_at[8]), .ADA7(write_at[7]), .ADA6(write_at[6]),
      .ADA5(write_at[5]), .ADA4(write_at[4]), .ADA3(write_at[3]), .ADA2(write_at[2]),
      .ADA1(write_at[1]), .ADA0(write_at[0]),
      .DIA17(d[17]), .DIA16(d[16]), .DIA15(d[15]), .DIA14(d[14]), .DIA13(d[13]), .DIA12(d[12]),
      .DIA11(d[11]), .DIA10(d[10]), .DIA9(d[9]), .DIA8(d[8]), .DIA7(d[7]), .DIA6(d[6]),
      .DIA5(d[5]), .DIA4(d[4]), .DIA3(d[3]), .DIA2(d[2]), .DIA1(d[1]), .DIA0(d[0]),
      .DIB17(d[35]), .DIB16(d[34]), .DIB15(d[33]), .DIB14(d[32]), .DIB13(d[31]), .DIB12(d[30]),
      .DIB11(d[29]), .DIB10(d[28]), .DIB9(d[27]), .DIB8(d[26]), .DIB7(d[25]), .DIB6(d[24]),
      .DIB5(d[23]), .DIB4(d[22]), .DIB3(d[21]), .DIB2(d[20]), .DIB1(d[19]), .DIB0(d[18]),
      .CLKB(clk_i), .CEB(1'b1), .OCEB(1'b1), .WEB(1'b0), .RSTB(1'b0),
      .CSB2(1'b0), .CSB1(1'b0), .CSB0(1'b0),
      .ADB13(read_at[13]), .ADB12(read_at[12]), .ADB11(read_at[11]), .ADB10(read_at[10]),
      .ADB9(read_at[9]), .ADB8(read_at[8]), .ADB7(read_at[7]), .ADB6(read_at[6]),
      .ADB5(read_at[5]), .ADB4(read_at[4]), .ADB3(read_at[3]), .ADB2(read_at[2]),
      .ADB1(read_at[1]), .ADB0(read_at[0]),
      .DOA17(a[17]), .DOA16(a[16]), .DOA15(a[15]), .DOA14(a[14]), .DOA13(a[13]), .DOA12(a[12]),
      .DOA11(a[11]), .DOA10(a[10]), .DOA9(a[9]), .DOA8(a[8]), .DOA7(a[7]), .DOA6(a[6]),
      .DOA5(a[5]), .DOA4(a[4]), .DOA3(a[3]), .DOA2(a[2]), .DOA1(a[1]), .DOA0(a[0]),
      .DOB17(b[17]), .DOB16(b[16]), .DOB15(b[15]), .DOB14(b[14]), .DOB13(b[13]), .DOB12(b[12]),
      .DOB11(b[11]), .DOB10(b[10]), .DOB9(b[9]), .DOB8(b[8]), .DOB7(b[7]), .DOB6(b[6]),
      .DOB5(b[5]), .DOB4(b[4]), .DOB3(b[3]), .DOB2(b[2]), .DOB1(b[1]), .DOB0(b[0])
    );
  end

endmodule

`default_nettype wire
