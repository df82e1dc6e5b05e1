// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reciprocal root, faithfully rounded: y = 1 / sqrt(x) for x in [1, 4).
///
/// Input x_i: unsigned, F + 1 fraction bits (F + 3 bits; below 1 the output is undefined).
/// Output y_o: unsigned, F + 1 + K fraction bits, in [1/2, 1]; K = Extra. With q from
/// `lipp_quadratic`, words as integers:
///
///   y    = (q + (4 >> K)) >> (3 - K)
///
/// |y - 1/sqrt(x)| < 2^-(F + 1). Latency rsqrt_latency().
module lipp_rsqrt #(
  parameter int F = 23,
  parameter int Extra = 0  // 0 to 3
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
