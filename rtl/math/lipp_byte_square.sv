// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Squares an unsigned byte v. With h the upper four bits and l the lower four bits of v,
///
///   v = 16 h + l,   v^2 = 256 h^2 + l^2 + 32 h l.
///
/// Tables give h^2 and l^2, and logic computes h l, so no multiplier cell is needed. The term 256
/// h^2 + l^2 needs no adder, because its two parts share no bit. The latency is 2 clocks,
/// lipp_math_pkg::byte_square_latency().
module lipp_byte_square (
  input  logic        clk_i,
  input  logic [7:0]  value_i,
  output logic [15:0] square_o
);

  /// Return bit k of the squares of 0 to 15, as a table that fits one four-input LUT.
  function automatic logic [15:0] square_bit(int k);
    for (int n = 0; n < 16; n++) square_bit[n] = 1'((n * n) >> k);
  endfunction

  logic [3:0] h, l;
  logic [7:0] product, h_square_q, l_square_q, product_q;
  logic [15:0] square_q;
  assign {h, l} = value_i;
  for (genvar k = 0; k < 8; k++) begin : gen_bit
    localparam logic [15:0] Table = square_bit(k);
    always_ff @(posedge clk_i) begin
      h_square_q[k] <= Table[h];
      l_square_q[k] <= Table[l];
    end
  end
  lipp_digit_product #(.W(4), .Signed(1'b0)) i_product (.a_i(l), .d_i(h), .p_o(product));
  always_ff @(posedge clk_i) begin
    product_q <= product;
    square_q <= {h_square_q, l_square_q} + {3'd0, product_q, 5'd0};
  end
  assign square_o = square_q;

endmodule

`default_nettype wire
