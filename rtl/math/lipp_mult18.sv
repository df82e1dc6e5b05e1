// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies two signed words of 18 bits in one hardware multiplier:
///
///   p(t) = a(t - 3) * b(t - 3).
///
/// The module has registers at the operands, inside and at the product, like the multiplier cells
/// of FPGAs. An FPGA family replaces this module by its multiplier cell (rtl/ecp5/).
module lipp_mult18 (
  input  logic               clk_i,
  input  logic signed [17:0] a_i,
  input  logic signed [17:0] b_i,
  output logic signed [35:0] p_o
);

  // The low 36 bits of a product are the same for signed and unsigned factors.
  logic [35:0] a_q, b_q, p_q;

  always_ff @(posedge clk_i) begin
    a_q <= 36'(a_i);
    b_q <= 36'(b_i);
    p_q <= a_q * b_q;
    p_o <= p_q;
  end

endmodule

`default_nettype wire
