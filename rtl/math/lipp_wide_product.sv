// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Product of two signed words, made from multiplier cells only, cut below a given place.
///
/// Gives the same result as `lipp_multiplier` with its cross terms in logic. Each word is split,
/// a = ah 2^la + al, where la is the number of its bits beyond 18; b likewise:
///
///   p = floor(ah bh 2^(la + lb) / 2^Drop) + floor((ah bl 2^la + al bh 2^lb) / 2^Drop)
///
/// The products come first and all registers follow them: a simulator then moves one word a clock,
/// and synthesis can move the registers into the multiplier cells. Synthesis for a family without
/// such retiming replaces this module by its cells (rtl/ecp5/). All words have 64 bits, since
/// simulators neither mask nor extend those; synthesis removes the unused bits.
/// Latency lipp_math_pkg::mul_latency(Wa, Wb).
module lipp_wide_product #(
  parameter int Wa = 18,       // bits of a
  parameter int Wb = 18,       // bits of b
  parameter int Drop = 0,      // places cut off
  parameter bit Square = 1'b0, // b is a: one cross term, doubled
  localparam int Wp = Wa + Wb - Drop
) (
  input  logic                 clk_i,
  input  logic signed [Wa-1:0] a_i,
  input  logic signed [Wb-1:0] b_i,
  output logic signed [Wp-1:0] p_o
);
  import lipp_math_pkg::*;

  localparam logic [63:0] LowA = (64'd1 << low_bits(Wa)) - 64'd1;
  localparam logic [63:0] LowB = (64'd1 << low_bits(Wb)) - 64'd1;
  localparam int Latency = mul_latency(Wa, Wb);

  if (Wa < 1 || Wb < 1 || Wa + Wb > 64 || Drop >= Wa + Wb) begin : gen_illegal
    $fatal(1, "lipp_wide_product: Wa and Wb must be 1 or more, 64 at most together, and more than Drop");
  end

  // The lower 64 bits of a product are the same for signed and unsigned words.
  logic [63:0] a, b, upper, ah_bl, rest;
  assign a = 64'(a_i);
  assign b = 64'(b_i);
  assign upper = (a & ~LowA) * (b & ~LowB);
  assign ah_bl = (a & ~LowA) * (b & LowB);
  assign rest = Square ? ah_bl << 1 : ah_bl + (a & LowA) * (b & ~LowB);
  logic unused_places;
  assign unused_places = ^{upper, rest};

  for (genvar k = 0; k < Latency; k++) begin : gen_stage
    logic [Wp-1:0] q;
    if (k == 0) begin : gen_first
      always_ff @(posedge clk_i) q <= upper[Drop+:Wp] + rest[Drop+:Wp];
    end else begin : gen_next
      always_ff @(posedge clk_i) q <= gen_stage[k-1].q;
    end
  end
  assign p_o = $signed(gen_stage[Latency-1].q);

endmodule

`default_nettype wire
