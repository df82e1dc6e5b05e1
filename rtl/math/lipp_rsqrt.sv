// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes the faithfully rounded reciprocal square root y = 1 / sqrt(x) of x in [1, 4).
///
/// The input x_i is unsigned and has F + 3 bits, F + 1 of them fraction bits; for x < 1 the output
/// is undefined. The output y_o is unsigned, in [1/2, 1], and has F + 1 + K fraction bits, where K
/// is Extra. With q the output of `lipp_quadratic`, and q and y read as integers, the rounding is
///
///   y    = (q + (4 >> K)) >> (3 - K).
///
/// The error is |y - 1/sqrt(x)| < 2^-(F + 1). The latency is rsqrt_latency() clocks.
module lipp_rsqrt #(
  parameter int F = 23,
  parameter int Extra = 0  // K, the number of extra fraction bits of the output, 0 to 3
) (
  input  logic                      clk_i,
  input  logic        [F+2:0]       x_i,
  output logic        [F+1+Extra:0] y_o
);
  import lipp_math_pkg::*;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_rsqrt: F must be 14 to 23");
  end

  if (Extra < 0 || Extra > 3) begin : gen_illegal_extra
    $fatal(1, "lipp_rsqrt: Extra must be 0 to 3");
  end

  logic [F+4:0] q;
  lipp_quadratic #(.F(F), .Root(RootReciprocal)) i_quadratic (.clk_i, .x_i, .y_o(q));

  always_ff @(posedge clk_i) y_o <= (F+2+Extra)'((q + (F+5)'(4 >> Extra)) >> (Guard - Extra));

endmodule

`default_nettype wire
