// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// `lipp_small_product` in logic, registered after each sum.
///
/// Same ports and behaviour as rtl/math/lipp_small_product.sv.
module lipp_small_product #(
  parameter int Wa = 8,
  parameter int Wb = 8,
  localparam int Wp = Wa + Wb
) (
  input  logic          clk_i,
  input  logic [Wa-1:0] a_i,
  input  logic [Wb-1:0] b_i,
  output logic [Wp-1:0] p_o
);
  import lipp_math_pkg::*;

  logic signed [MulBits-1:0] a;
  logic signed [MulBits+Wb-1:0] product;
  assign a = $signed(MulBits'(a_i));
  lipp_low_product #(.Low(Wb)) i_product (.clk_i, .a_i(a), .low_i(b_i), .p_o(product));
  assign p_o = product[Wp-1:0];
  logic unused_product;
  assign unused_product = ^product;

endmodule

`default_nettype wire
