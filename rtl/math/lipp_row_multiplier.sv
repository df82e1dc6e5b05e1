// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Product of two signed words as `lipp_multiplier` gives it, with the cross terms in rows of carry chains.
///
/// It has fewer registers, of which none is before the cell, and takes 3 or 4 clocks; the clock is slower. A
/// word is split, a = ah 2^la + al, where la is the number of its bits beyond 18; b likewise:
///
///   p = floor(ah bh 2^(la + lb) / 2^Drop) + floor((ah bl 2^la + al bh 2^lb) / 2^Drop)
///
/// The products come first and all registers follow them: a simulator then moves one word a clock. Synthesis for
/// a family whose carry chains take the rows replaces this module (rtl/ecp5/). All words have 64 bits, since
/// simulators neither mask nor extend those; synthesis removes the unused bits.
/// Latency lipp_math_pkg::row_latency(Wa, Wb).
module lipp_row_multiplier #(
  parameter int Wa = 18,       // bits of a, 3 to 32
  parameter int Wb = 18,       // bits of b, 3 to 32
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

  localparam int La = low_bits(Wa);
  localparam int Lb = low_bits(Wb);
  localparam logic [63:0] LowA = (64'd1 << La) - 64'd1;
  localparam logic [63:0] LowB = (64'd1 << Lb) - 64'd1;
  localparam int Latency = row_latency(Wa, Wb);

  if (Wa < 3 || Wb < 3 || Wa > 32 || Wb > 32 || Drop < 0 || Drop >= Wa + Wb) begin : gen_illegal_width
    $fatal(1, "lipp_row_multiplier: Wa and Wb must be 3 to 32, and Drop less than their sum");
  end
  if (La > 0 && Lb > 0 && Drop < La + Lb) begin : gen_illegal_drop
    $fatal(1, "lipp_row_multiplier: Drop must cut off the product of the lower parts");
  end
  if (Square && Wa != Wb) begin : gen_illegal_square
    $fatal(1, "lipp_row_multiplier: Square takes words of one width");
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
