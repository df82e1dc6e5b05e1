// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Implements `lipp_gated_sum`, s = (a & x) + (b & y), in the carry cells of ECP5: each cell adds
/// two bits and also masks them.
///
/// Ports and behaviour are those of rtl/math/lipp_gated_sum.sv. The lookup table of each carry cell
/// computes (A & B) ^ (C & D), the sum bit before the carry is added. The table's four lowest
/// entries contain A & B, the carry that the cell generates. To yosys the cell is a black box.
module lipp_gated_sum #(
  parameter int W = 18
) (
  input  logic [W-1:0] a_i,
  input  logic [W-1:0] x_i,
  input  logic [W-1:0] b_i,
  input  logic [W-1:0] y_i,
  output logic [W-1:0] s_o
);

  localparam int Cells = (W + 1) / 2;
  localparam logic [15:0] GatedSum = 16'h7888;

  if (W < 1) begin : gen_illegal
    $fatal(1, "lipp_gated_sum: W must be 1 or more");
  end

  logic [2*Cells-1:0] a, x, b, y, s;
  logic [Cells:0] carry;
  assign a = (2 * Cells)'(a_i);
  assign x = (2 * Cells)'(x_i);
  assign b = (2 * Cells)'(b_i);
  assign y = (2 * Cells)'(y_i);
  assign carry[0] = 1'b0;
  for (genvar k = 0; k < Cells; k++) begin : gen_cell
    CCU2C #(
      .INIT0(GatedSum), .INIT1(GatedSum), .INJECT1_0("NO"), .INJECT1_1("NO")
    ) i_cell (
      .CIN(carry[k]),
      .A0(a[2*k]), .B0(x[2*k]), .C0(b[2*k]), .D0(y[2*k]),
      .A1(a[2*k+1]), .B1(x[2*k+1]), .C1(b[2*k+1]), .D1(y[2*k+1]),
      .S0(s[2*k]), .S1(s[2*k+1]), .COUT(carry[k+1])
    );
  end
  assign s_o = s[W-1:0];
  logic unused_bits;
  assign unused_bits = ^{carry[Cells], s};

endmodule

`default_nettype wire
