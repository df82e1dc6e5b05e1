// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes y = k x + l a, one coordinate of a ray's slope or of its point on the lenslet's first
/// face. Input x is a pixel coordinate, a an aperture point coordinate; k and l are coefficients.
///
/// In the formula all words are integers, and a b >> n is the product of `lipp_multiplier`
/// truncated by n bits. The sum is
///
///   y    = ((k x >> F-3) + (l a >> F-3) + 4) >> 3.
///
/// The words x and a have F fraction bits; k, l and y have Wk - 2 fraction bits. With Second = 0
/// the product l a is omitted. Output beyond_o reports that y does not fit into Wy bits. The
/// latency is blend_latency(F, Wx) clocks.
module lipp_blend #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // 1: cross terms use multiplier cells
  parameter bit Second = 1'b1,
  parameter int Wx = F + 2,         // width of x in bits, F + 2 or more
  parameter int Wa = F + 2,         // width of a in bits, F + 2 to Wx
  parameter int Wk = F + 2,         // width of k and l in bits
  parameter int Wy = Wk             // width of y in bits, Wk or more
) (
  input  logic                 clk_i,
  input  logic signed [Wk-1:0] k_i,
  input  logic signed [Wx-1:0] x_i,
  input  logic signed [Wk-1:0] l_i,
  input  logic signed [Wa-1:0] a_i,
  output logic signed [Wy-1:0] y_o,
  output logic                 beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::extra_bits;

  localparam int W = F + 2;
  localparam int Drop = F - Guard;
  localparam int Wp = Wx + Wk - Drop;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_blend: F must be 14 to 23");
  end
  if (Wx < W || Wx > W + 2 || Wa < W || Wa > Wx) begin : gen_illegal_width
    $fatal(1, "lipp_blend: Wx must be F + 2 to F + 4, and Wa F + 2 to Wx");
  end
  if (Wk != W && Wk != W + extra_bits(F)) begin : gen_illegal_factor
    $fatal(1, "lipp_blend: Wk must be F + 2, or have extra_bits(F) more");
  end
  if (Wy < Wk || Wy > W + 2) begin : gen_illegal_sum
    $fatal(1, "lipp_blend: Wy must be Wk to F + 4");
  end

  logic signed [Wp-1:0] kx, la;
  logic signed [Wp:0] sum_q, sum_d;
  logic signed [Wp-Guard:0] y_d;
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(Wx), .Wb(Wk), .Drop(Drop)
  ) i_kx (.clk_i, .a_i(x_i), .b_i(k_i), .p_o(kx));
  if (Second) begin : gen_second
    logic signed [Wa+Wk-Drop-1:0] la_early;
    lipp_multiplier #(
      .CrossCells(CrossCells), .Wa(Wa), .Wb(Wk), .Drop(Drop)
    ) i_la (.clk_i, .a_i, .b_i(l_i), .p_o(la_early));
    lipp_delay #(.Width(Wp), .Cycles(mul_latency(Wx, Wk) - mul_latency(Wa, Wk))) i_la_match (
      .clk_i, .d_i(Wp'(la_early)), .q_o(la)
    );
  end else begin : gen_alone
    assign la = '0;
    logic unused_second;
    assign unused_second = ^{l_i, a_i};
  end
  assign sum_d = sum_q + (Wp + 1)'(4);
  assign y_d = sum_d[Wp:Guard];
  always_ff @(posedge clk_i) begin
    sum_q <= (Wp + 1)'(kx) + (Wp + 1)'(la);
    y_o <= Wy'(y_d);
    beyond_o <= y_d != (Wp - Guard + 1)'($signed(y_d[Wy-1:0]));
  end
  logic unused_guard;
  assign unused_guard = ^sum_d[Guard-1:0];

endmodule

`default_nettype wire
