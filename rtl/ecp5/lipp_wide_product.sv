// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Implements `lipp_wide_product` in multiplier cells of ECP5: one cell multiplies the upper parts,
/// and one cell computes each cross term.
///
/// Ports and behaviour are those of rtl/math/lipp_wide_product.sv. Each cell uses its own
/// registers. An additional register before the cells shortens the timing path of the operands.
module lipp_wide_product #(
  parameter int Wa = 18,
  parameter int Wb = 18,
  parameter int Drop = 0,
  parameter bit Square = 1'b0,
  localparam int Wp = Wa + Wb - Drop
) (
  input  logic                 clk_i,
  input  logic signed [Wa-1:0] a_i,
  input  logic signed [Wb-1:0] b_i,
  output logic signed [Wp-1:0] p_o
);
  import lipp_math_pkg::*;

  localparam int La = low_bits(Wa);
  localparam int Lb = low_bits(Wb);
  localparam int Cells = 4;  // latency: register before the cell (1), cell (3)
  localparam int Wc = Wa + Wb + 1;

  logic signed [Wa-1:0] a_q;
  logic signed [Wb-1:0] b_q;
  always_ff @(posedge clk_i) begin
    a_q <= a_i;
    b_q <= b_i;
  end

  logic signed [MulBits-1:0] ah, bh;
  logic signed [2*MulBits-1:0] upper;
  assign ah = MulBits'(a_q >>> La);
  assign bh = MulBits'(b_q >>> Lb);
  lipp_mult18 i_upper (.clk_i, .a_i(ah), .b_i(bh), .p_o(upper));

  if (La == 0 && Lb == 0) begin : gen_whole
    assign p_o = Wp'(upper >>> Drop);
    logic unused_low;
    assign unused_low = ^{1'b0, upper};
  end else begin : gen_split
    logic signed [2*MulBits-1:0] ah_bl, al_bh;
    if (La == 0) begin : gen_no_al
      assign al_bh = '0;
    end else if (Square) begin : gen_same
      assign al_bh = ah_bl;
    end else begin : gen_al
      lipp_mult18 i_al (.clk_i, .a_i($signed(MulBits'(a_q[La-1:0]))), .b_i(bh), .p_o(al_bh));
    end
    if (Lb == 0) begin : gen_no_bl
      assign ah_bl = '0;
    end else begin : gen_bl
      lipp_mult18 i_bl (.clk_i, .a_i(ah), .b_i($signed(MulBits'(b_q[Lb-1:0]))), .p_o(ah_bl));
    end

    logic signed [Wc-1:0] cross_q;
    logic signed [Wp-1:0] upper_q, sum_q;
    always_ff @(posedge clk_i) begin
      upper_q <= Wp'(upper >>> (Drop - La - Lb));
      cross_q <= (Wc'(ah_bl) <<< La) + (Wc'(al_bh) <<< Lb);
      sum_q <= upper_q + Wp'(cross_q >>> Drop);
    end
    lipp_delay #(.Width(Wp), .Cycles(mul_latency(Wa, Wb) - Cells - 2)) i_behind (
      .clk_i, .d_i(sum_q), .q_o(p_o)
    );
  end

endmodule

`default_nettype wire
