// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Implements `lipp_small_product` in carry chains of ECP5.
///
/// Ports and behaviour are those of rtl/math/lipp_small_product.sv. The first stage multiplies a by
/// two digits of four bits and by the highest bit of b. The second stage adds the products.
module lipp_small_product #(
  parameter int Wa = 17,
  parameter int Drop = 0,
  localparam int Wp = Wa + 9 - Drop
) (
  input  logic          clk_i,
  input  logic [Wa-1:0] a_i,
  input  logic [8:0]    b_i,
  output logic [Wp-1:0] p_o
);

  if (Wa < 3 || Wa > 17 || (Drop != 0 && Drop != 8)) begin : gen_illegal
    $fatal(1, "lipp_small_product: Wa must be 3 to 17 and Drop 0 or 8");
  end

  // The partial product of b's highest bit has zeros below bit 8, so the rounding constant 2^7 is
  // placed there without an adder.
  localparam logic [3:0] Half = Drop == 0 ? 4'd0 : 4'd8;
  logic [Wa+3:0] low, high, low_q, high_q;
  logic [Wa-1:0] top_q;
  logic [Wa+4:0] behind, sum;
  logic [Wa+8:0] p_q;
  lipp_digit_product #(.W(Wa), .Signed(1'b0)) i_low (.a_i, .d_i(b_i[3:0]), .p_o(low));
  lipp_digit_product #(.W(Wa), .Signed(1'b0)) i_high (.a_i, .d_i(b_i[7:4]), .p_o(high));
  lipp_gated_sum #(.W(Wa + 5)) i_behind (
    .a_i({1'b0, top_q, Half}), .x_i('1), .b_i({1'b0, high_q}), .y_i('1), .s_o(behind)
  );
  lipp_gated_sum #(.W(Wa + 5)) i_sum (
    .a_i(behind), .x_i('1), .b_i({5'd0, low_q[Wa+3:4]}), .y_i('1), .s_o(sum)
  );
  always_ff @(posedge clk_i) begin
    low_q <= low;
    high_q <= high;
    top_q <= a_i & {Wa{b_i[8]}};
    p_q <= {sum, low_q[3:0]};
  end
  assign p_o = p_q[Wa+8:Drop];
  logic unused_p;
  assign unused_p = ^p_q;

endmodule

`default_nettype wire
