// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Product of two unsigned words in logic cells, with the latency of a multiplier cell: p(t) = a(t - 3) b(t - 3).
///
/// For a design that would else take too many multiplier cells: two `lipp_small_product` and their sum,
/// p = a b_low + 2^8 a b_high, with b in its two bytes. Latency lipp_math_pkg::cell_latency().
module lipp_logic_product #(
  parameter int Wa = 17,  // bits of a, 3 to 17
  localparam int Wp = Wa + 16
) (
  input  logic          clk_i,
  input  logic [Wa-1:0] a_i,
  input  logic [15:0]   b_i,
  output logic [Wp-1:0] p_o
);

  if (Wa < 3 || Wa > 17) begin : gen_illegal
    $fatal(1, "lipp_logic_product: Wa must be 3 to 17");
  end

  logic [Wa+8:0] low, high;
  logic [Wp-1:0] p_q;
  lipp_small_product #(.Wa(Wa)) i_low (.clk_i, .a_i, .b_i({1'b0, b_i[7:0]}), .p_o(low));
  lipp_small_product #(.Wa(Wa)) i_high (.clk_i, .a_i, .b_i({1'b0, b_i[15:8]}), .p_o(high));
  // A product of a byte is below 2^(Wa + 8).
  always_ff @(posedge clk_i) p_q <= {high[Wa+7:0], 8'd0} + {8'd0, low[Wa+7:0]};
  assign p_o = p_q;
  logic unused_top;
  assign unused_top = ^{low[Wa+8], high[Wa+8]};

endmodule

`default_nettype wire
