// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies a signed word a by an unsigned word `low` of at most 17 bits:
///
///   p(t) = a(t - Latency) * low(t - Latency).
///
/// The product is exact and made in logic: each digit of two bits of `low` gives one partial
/// product, and a tree adds the partial products in pairs. Parameter Latency is
/// lipp_math_pkg::low_latency(Low) clocks, or more if a parallel path takes longer.
module lipp_low_product #(
  parameter int Low = 2,                                // width of `low` in bits, 1 to 17
  parameter int Latency = lipp_math_pkg::low_latency(Low)
) (
  input  logic                                         clk_i,
  input  logic signed [lipp_math_pkg::MulBits-1:0]     a_i,
  input  logic [Low-1:0]                               low_i,
  output logic signed [lipp_math_pkg::MulBits+Low-1:0] p_o
);
  import lipp_math_pkg::*;

  localparam int Wp = MulBits + Low;
  localparam int Digits = (Low + 1) / 2;
  localparam int Own = 1 + $clog2(Digits);

  if (Low < 1 || Low > 17 || Latency < Own) begin : gen_illegal
    $fatal(1,
        "lipp_low_product: Low must be 1 to 17 and Latency no shorter than the product takes");
  end

  logic signed [Wp-1:0] p;
  lipp_delay #(.Width(Wp), .Cycles(Latency - Own)) i_match (.clk_i, .d_i(p), .q_o(p_o));

  if (Digits == 1) begin : gen_digit
    // The low Wp bits of the product are the same for signed and unsigned factors.
    logic [Wp-1:0] a;
    assign a = Wp'(a_i);
    always_ff @(posedge clk_i) p <= a * Wp'(low_i);
  end else begin : gen_tree
    // The lower branch adds the products of 2^k digits, with the largest 2^k below Digits.
    localparam int LowerDigits = 1 << ($clog2(Digits) - 1);
    localparam int Split = 2 * LowerDigits;
    logic signed [MulBits+Split-1:0]     lower;
    logic signed [MulBits+Low-Split-1:0] upper;
    lipp_low_product #(.Low(Split), .Latency(Own - 1)) i_lower (
      .clk_i, .a_i, .low_i(low_i[Split-1:0]), .p_o(lower)
    );
    lipp_low_product #(.Low(Low - Split), .Latency(Own - 1)) i_upper (
      .clk_i, .a_i, .low_i(low_i[Low-1:Split]), .p_o(upper)
    );
    always_ff @(posedge clk_i) p <= Wp'(lower) + $signed({upper, Split'(0)});
  end

endmodule

`default_nettype wire
