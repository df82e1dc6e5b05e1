// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies a word a by a digit d of one to four bits: p = a d, exact. The module is
/// combinational and adds its partial products with `lipp_gated_sum`.
module lipp_digit_product #(
  parameter int W = 18,           // width of a in bits, 3 or more
  parameter int Digit = 4,        // width of d in bits
  parameter bit Signed = 1'b1,    // 1: a is signed; 0: unsigned
  localparam int Wp = W + Digit
) (
  input  logic [W-1:0]     a_i,
  input  logic [Digit-1:0] d_i,
  output logic [Wp-1:0]    p_o
);

  if (W < 3 || Digit < 1 || Digit > 4) begin : gen_illegal
    $fatal(1, "lipp_digit_product: W must be 3 or more and Digit 1 to 4");
  end

  // A lipp_gated_sum masks and adds W + 1 bits: a, and half = a >> 1 (arithmetic if signed).
  logic [W:0] a, half;
  assign a = {Signed && a_i[W-1], a_i};
  assign half = {{2{Signed && a_i[W-1]}}, a_i[W-1:1]};

  if (Digit == 1) begin : gen_bit
    assign p_o = a & {(W + 1){d_i[0]}};
    logic unused_half;
    assign unused_half = ^half;
  end else begin : gen_rows
    logic [W+1:0] lower;  // product of a and the lower two bits of d
    assign lower[0] = a[0] && d_i[0];
    lipp_gated_sum #(.W(W + 1)) i_lower (
      .a_i(half), .x_i({(W + 1){d_i[0]}}), .b_i(a), .y_i({(W + 1){d_i[1]}}), .s_o(lower[W+1:1])
    );
    if (Digit == 2) begin : gen_two
      assign p_o = lower;
    end else begin : gen_more
      logic [Digit+W-3:0] behind, upper;
      assign behind = {{(Digit - 2){Signed && lower[W+1]}}, lower[W+1:2]};
      assign p_o[1:0] = lower[1:0];
      if (Digit == 3) begin : gen_three
        lipp_gated_sum #(.W(W + 1)) i_sum (
          .a_i(a), .x_i({(W + 1){d_i[2]}}), .b_i(behind), .y_i('1), .s_o(p_o[Wp-1:2])
        );
        assign upper = '0;
        logic unused_upper;
        assign unused_upper = ^upper;
      end else begin : gen_four
        assign upper[0] = a[0] && d_i[2];
        lipp_gated_sum #(.W(W + 1)) i_upper (
          .a_i(half), .x_i({(W + 1){d_i[2]}}), .b_i(a), .y_i({(W + 1){d_i[3]}}),
          .s_o(upper[W+1:1])
        );
        assign p_o[Wp-1:2] = behind + upper;
      end
    end
  end

endmodule

`default_nettype wire
