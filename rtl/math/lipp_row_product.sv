// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies a signed word a by an unsigned word `low` of at most 16 bits:
///
///   p(t) = a(t - 2) * low(t - 2).
///
/// The product is exact and made in carry chains. In the first clock, a is multiplied by digits of
/// four bits of `low`. In the second clock, the products are added.
module lipp_row_product #(
  parameter int W = 18,   // width of a in bits, 3 or more
  parameter int Low = 4,  // width of `low` in bits, 1 to 16
  localparam int Wp = W + Low
) (
  input  logic                 clk_i,
  input  logic signed [W-1:0]  a_i,
  input  logic [Low-1:0]       low_i,
  output logic signed [Wp-1:0] p_o
);

  localparam int Digits = (Low + 3) / 4;

  if (W < 3 || Low < 1 || Low > 16) begin : gen_illegal
    $fatal(1, "lipp_row_product: W must be 3 or more and Low 1 to 16");
  end

  for (genvar k = 0; k < Digits; k++) begin : gen_digit
    localparam int Digit = Low - 4 * k < 4 ? Low - 4 * k : 4;
    logic [W+Digit-1:0] product;
    logic signed [W+Digit-1:0] q;
    lipp_digit_product #(.W(W), .Digit(Digit)) i_product (
      .a_i(a_i), .d_i(low_i[4*k+:Digit]), .p_o(product)
    );
    always_ff @(posedge clk_i) q <= $signed(product);
  end

  // The products of neighbouring digits are added in pairs, and then the pairs' sums are added.
  if (Digits == 1) begin : gen_one
    always_ff @(posedge clk_i) p_o <= gen_digit[0].q;
  end else begin : gen_more
    localparam int Wl = W + (Low < 8 ? Low : 8);
    logic signed [Wl-1:0] lower;
    assign lower = {(Wl - 4)'(gen_digit[0].q >>> 4) + (Wl - 4)'(gen_digit[1].q),
        gen_digit[0].q[3:0]};
    if (Digits == 2) begin : gen_two
      always_ff @(posedge clk_i) p_o <= lower;
    end else begin : gen_four
      localparam int Wu = Wp - 8;
      logic signed [Wu-1:0] upper;
      if (Digits == 3) begin : gen_three
        assign upper = gen_digit[2].q;
      end else begin : gen_last
        assign upper = {(Wu - 4)'(gen_digit[2].q >>> 4) + (Wu - 4)'(gen_digit[3].q),
            gen_digit[2].q[3:0]};
      end
      always_ff @(posedge clk_i) p_o <= {Wu'(lower >>> 8) + upper, lower[7:0]};
    end
  end

endmodule

`default_nettype wire
