// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Implements `lipp_row_multiplier` in a multiplier cell and carry chains of ECP5.
///
/// Ports and behaviour are those of rtl/math/lipp_row_multiplier.sv. The pipeline has a stage for
/// products with digits of four bits, two stages that add these products, a stage that adds the two
/// cross terms, and a stage that adds their sum to the product of the multiplier cell.
module lipp_row_multiplier #(
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
  localparam int Wha = Wa - La;  // width of the upper part of a in bits
  localparam int Whb = Wb - Lb;

  if (Wa < 3 || Wb < 3 || Wa > 32
      || Wb > 32 || Drop < 0 || Drop >= Wa + Wb) begin : gen_illegal_width
    $fatal(1, "lipp_row_multiplier: Wa and Wb must be 3 to 32, and Drop less than their sum");
  end
  if (La > 0 && Lb > 0 && Drop < La + Lb) begin : gen_illegal_drop
    $fatal(1, "lipp_row_multiplier: Drop must cut off the product of the lower parts");
  end
  if (Square && Wa != Wb) begin : gen_illegal_square
    $fatal(1, "lipp_row_multiplier: Square takes words of one width");
  end

  logic signed [MulBits-1:0] ah, bh;
  logic signed [2*MulBits-1:0] upper;
  assign ah = MulBits'(a_i >>> La);
  assign bh = MulBits'(b_i >>> Lb);
  lipp_mult18 i_upper (.clk_i, .a_i(ah), .b_i(bh), .p_o(upper));

  if (La == 0 && Lb == 0) begin : gen_whole
    assign p_o = Wp'(upper >>> Drop);
    logic unused_low;
    assign unused_low = ^upper;
  end else begin : gen_split
    // Both cross terms ah bl and al bh are words in units of 2^Lc.
    localparam int Lc = La == 0 || Lb == 0 ? 0 : La < Lb ? La : Lb;
    localparam int Wc = MulBits + La + Lb - Lc + 2;
    logic signed [Wc-1:0] al_bh, ah_bl, cross_q;
    logic signed [Wp-1:0] upper_cut;
    if (Drop < La + Lb) begin : gen_up
      assign upper_cut = Wp'(upper) <<< (La + Lb - Drop);
    end else begin : gen_down
      assign upper_cut = Wp'(upper >>> (Drop - La - Lb));
    end
    if (La == 0) begin : gen_no_al
      assign al_bh = '0;
    end else begin : gen_al
      logic signed [Whb+La-1:0] part;
      lipp_row_product #(.W(Whb), .Low(La)) i_al (.clk_i, .a_i(bh[Whb-1:0]), .low_i(a_i[La-1:0]),
          .p_o(part));
      assign al_bh = Square ? Wc'(part) <<< 1 : Wc'(part) <<< (Lb - Lc);
    end
    if (Lb == 0 || Square) begin : gen_no_bl
      assign ah_bl = '0;
    end else begin : gen_bl
      logic signed [Wha+Lb-1:0] part;
      lipp_row_product #(.W(Wha), .Low(Lb)) i_bl (.clk_i, .a_i(ah[Wha-1:0]), .low_i(b_i[Lb-1:0]),
          .p_o(part));
      assign ah_bl = Wc'(part) <<< (La - Lc);
    end
    always_ff @(posedge clk_i) begin
      cross_q <= al_bh + ah_bl;
      p_o <= upper_cut + Wp'(cross_q >>> (Drop - Lc));
    end
  end

endmodule

`default_nettype wire
