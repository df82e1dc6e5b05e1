// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies two signed words with one multiplier cell and truncates the product by Drop bits.
///
/// Word a is split into its upper 18 bits ah and its la lower bits al:
///
///   a = ah 2^la + al   with 0 <= al < 2^la.
///
/// Word b is split into bh and its lb lower bits bl in the same way. A multiplier cell computes ah
/// bh. Logic computes the cross terms ah bl and al bh. With CrossCells = 1, up to two further
/// multiplier cells compute the cross terms (`lipp_wide_product`), which takes less logic. The term
/// al bl of the product is omitted. The result is
///
///   p = floor(ah bh 2^(la + lb) / 2^Drop) + floor((ah bl 2^la + al bh 2^lb) / 2^Drop).
///
/// If both words fit into 18 bits, p = floor(a b / 2^Drop).
/// The latency is lipp_math_pkg::mul_latency(Wa, Wb) clocks.
module lipp_multiplier #(
  parameter int Wa = 18,       // width of a in bits
  parameter int Wb = 18,       // width of b in bits
  parameter int Drop = 0,      // number of low bits to truncate
  parameter bit Square = 1'b0, // 1: b equals a, one cross term is doubled
  parameter bit CrossCells = 1'b0, // 1: cross terms use multiplier cells
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
  localparam int Ll = La > Lb ? La : Lb;

  if (Wa < 1 || Wb < 1 || Drop >= Wa + Wb) begin : gen_illegal_width
    $fatal(1, "lipp_multiplier: Wa and Wb must be 1 or more, and Drop less than their sum");
  end
  if (Square && Wa != Wb) begin : gen_illegal_square
    $fatal(1, "lipp_multiplier: Square takes words of one width");
  end
  if (Drop < La + Lb) begin : gen_illegal_drop
    $fatal(1, "lipp_multiplier: Drop must cut off the product of the lower parts");
  end

  // This register in front of the multiplier cell shortens the timing path of the operands.
  logic signed [Wa-1:0] a_q;
  logic signed [Wb-1:0] b_q;
  always_ff @(posedge clk_i) begin
    a_q <= a_i;
    b_q <= b_i;
  end

  logic signed [MulBits-1:0] ah, bh;
  assign ah = MulBits'(a_q >>> La);
  assign bh = MulBits'(b_q >>> Lb);

  logic signed [2*MulBits-1:0] upper;
  lipp_mult18 i_upper (.clk_i, .a_i(ah), .b_i(bh), .p_o(upper));

  if (CrossCells) begin : gen_cells
    lipp_wide_product #(.Wa(Wa), .Wb(Wb), .Drop(Drop), .Square(Square)) i_product (
      .clk_i, .a_i, .b_i, .p_o
    );
    logic unused_upper;  // with CrossCells = 1, cell i_upper is unused
    assign unused_upper = ^upper;
  end else if (Ll == 0) begin : gen_whole
    assign p_o = Wp'(upper >>> Drop);
    logic unused_low;
    assign unused_low = ^{1'b0, upper};
  end else begin : gen_split
    localparam int CrossLatency = low_latency(Ll);
    localparam int Rest = mul_latency(Wa, Wb) - 2;  // latency from operands to sum
    // cross_q is the sum of both cross terms, ah bl and al bh, in units of 2^Lc.
    localparam int Lc = La == 0 || Lb == 0 ? 0 : La < Lb ? La : Lb;
    localparam int Wc = MulBits + La + Lb - Lc + 2;
    logic signed [Wc-1:0] cross_q;

    if (La == 0) begin : gen_b
      logic signed [MulBits+Lb-1:0] ah_bl;
      lipp_low_product #(.Low(Lb), .Latency(CrossLatency)) i_low (
        .clk_i, .a_i(ah), .low_i(b_q[Lb-1:0]), .p_o(ah_bl)
      );
      always_ff @(posedge clk_i) cross_q <= Wc'(ah_bl);
    end else begin : gen_a
      logic signed [MulBits+La-1:0] al_bh;
      lipp_low_product #(.Low(La), .Latency(CrossLatency)) i_low (
        .clk_i, .a_i(bh), .low_i(a_q[La-1:0]), .p_o(al_bh)
      );
      if (Square) begin : gen_twice
        always_ff @(posedge clk_i) cross_q <= Wc'(al_bh) <<< 1;
      end else if (Lb == 0) begin : gen_alone
        always_ff @(posedge clk_i) cross_q <= Wc'(al_bh);
      end else begin : gen_both
        logic signed [MulBits+Lb-1:0] ah_bl;
        lipp_low_product #(.Low(Lb), .Latency(CrossLatency)) i_low (
          .clk_i, .a_i(ah), .low_i(b_q[Lb-1:0]), .p_o(ah_bl)
        );
        always_ff @(posedge clk_i) begin
          cross_q <= (Wc'(ah_bl) <<< (La - Lc)) + (Wc'(al_bh) <<< (Lb - Lc));
        end
      end
    end

    // Either the product of the multiplier cell or the sum of the cross terms is delayed, so that
    // both have the same latency.
    logic signed [Wp-1:0] upper_cut, cross_cut;
    lipp_delay #(.Width(Wp), .Cycles(Rest - 3)) i_upper_match (
      .clk_i, .d_i(Wp'(upper >>> (Drop - La - Lb))), .q_o(upper_cut)
    );
    lipp_delay #(.Width(Wp), .Cycles(Rest - CrossLatency - 1)) i_cross_match (
      .clk_i, .d_i(Wp'(cross_q >>> (Drop - Lc))), .q_o(cross_cut)
    );
    always_ff @(posedge clk_i) p_o <= upper_cut + cross_cut;
  end

endmodule

`default_nettype wire
