// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies two signed words in parts, and truncates the product. The module is combinational.
///
/// Word a is split into its upper 18 bits ah and its la lower bits al, so a = ah 2^la + al. Word b
/// is split into bh and its lb lower bits bl in the same way. The term al bl of the product is
/// omitted. The product truncated by Drop bits is
///
///   p = floor(ah bh 2^(la + lb) / 2^Drop) + floor((ah bl 2^la + al bh 2^lb) / 2^Drop).
///
/// All internal words have 64 bits, because simulators need no instructions to mask or extend words
/// of this width. Synthesis removes the unused bits.
module lipp_cut_product #(
  parameter int Wa = 18,       // width of a in bits
  parameter int Wb = 18,       // width of b in bits
  parameter int Drop = 0,      // number of low bits to truncate
  parameter bit Square = 1'b0, // 1: b equals a, one cross term is doubled
  localparam int Wp = Wa + Wb - Drop
) (
  input  logic signed [Wa-1:0] a_i,
  input  logic signed [Wb-1:0] b_i,
  output logic        [Wp-1:0] p_o
);
  import lipp_math_pkg::*;

  localparam logic [63:0] LowA = (64'd1 << low_bits(Wa)) - 64'd1;
  localparam logic [63:0] LowB = (64'd1 << low_bits(Wb)) - 64'd1;

  if (Wa < 1 || Wb < 1 || Wa + Wb > 64 || Drop < 0 || Drop >= Wa + Wb) begin : gen_illegal
    $fatal(1,
        "lipp_cut_product: Wa and Wb must be 1 or more, 64 at most together, and more than Drop");
  end

  // The lower 64 bits of a product are the same for signed and unsigned factors.
  logic [63:0] a, b, upper, ah_bl, lower;
  assign a = 64'(a_i);
  assign b = 64'(b_i);
  assign upper = (a & ~LowA) * (b & ~LowB);
  assign ah_bl = (a & ~LowA) * (b & LowB);
  assign lower = Square ? ah_bl << 1 : ah_bl + (a & LowA) * (b & ~LowB);
  assign p_o = upper[Drop+:Wp] + lower[Drop+:Wp];
  logic unused_places;
  assign unused_places = ^{upper, lower};

endmodule

`default_nettype wire
