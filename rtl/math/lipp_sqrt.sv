// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes the faithfully rounded square root y = sqrt(x) of x in [0, 1), for cosines of rays.
///
/// The input x_i is unsigned and has J = F + 3 bits, all of them fraction bits. The output y_o is
/// signed, in [0, 1), with F + 1 + K fraction bits, where K is Extra. With Normalise = 0 the input
/// must be in [1/4, 1). With Normalise = 1 any input in [0, 1) is valid. Let k be the largest
/// number up to 15 with 4^k x < 1, or 0 with Normalise = 0. Let q be the root of 4^k x from
/// `lipp_quadratic`. With words read as integers, the result is
///
///   y    = min(((q >> k) + (4 >> K)) >> (3 - K), 2^(F+1+K) - 1).
///
/// The root of x = 0 is 0. The error is |y - sqrt(x)| < 2^-(F + 1). The latency is
/// sqrt_latency(Normalise) clocks.
module lipp_sqrt #(
  parameter int F = 23,
  parameter bit Normalise = 1'b1,
  parameter int Extra = 0  // K, the number of extra fraction bits of the output, 0 to 3
) (
  input  logic                      clk_i,
  input  logic        [F+2:0]       x_i,
  output logic signed [F+1+Extra:0] y_o
);
  import lipp_math_pkg::*;

  localparam int J = F + 3;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_sqrt: F must be 14 to 23");
  end

  if (Extra < 0 || Extra > 3) begin : gen_illegal_extra
    $fatal(1, "lipp_sqrt: Extra must be 0 to 3");
  end

  logic [J-1:0] scaled;
  logic [F+4:0] q, shifted;

  if (Normalise) begin : gen_normalise
    // The input is shifted left by 16, 8, 4 and 2 bits in turn, each time if that many upper bits
    // are 0. The binary digits of k record which shifts were made.
    logic [J-1:0] by16_q, by8_q, by4_q, by2_q;
    logic k8_q, k8_q2, k8_q3, k8_q4, k4_q2, k4_q3, k4_q4, k2_q3, k2_q4, k1_q4;
    logic [3:0] k_late;
    logic zero_late;
    logic [F+4:0] half_q, shifted_q;
    logic [1:0] k_rest_q;
    logic clear16, clear8, clear4, clear2;
    assign clear16 = x_i[J-1-:16] == '0;
    assign clear8 = by16_q[J-1-:8] == '0;
    assign clear4 = by8_q[J-1-:4] == '0;
    assign clear2 = by4_q[J-1-:2] == '0;
    always_ff @(posedge clk_i) begin
      by16_q <= clear16 ? x_i << 16 : x_i;
      by8_q <= clear8 ? by16_q << 8 : by16_q;
      by4_q <= clear4 ? by8_q << 4 : by8_q;
      by2_q <= clear2 ? by4_q << 2 : by4_q;
      {k8_q, k8_q2, k8_q3, k8_q4} <= {clear16, k8_q, k8_q2, k8_q3};
      {k4_q2, k4_q3, k4_q4} <= {clear8, k4_q2, k4_q3};
      {k2_q3, k2_q4} <= {clear4, k2_q3};
      k1_q4 <= clear2;
    end
    assign scaled = by2_q;

    lipp_delay #(.Width(5), .Cycles(quadratic_latency())) i_k (
      .clk_i, .d_i({by2_q[J-1-:2] == '0, k8_q4, k4_q4, k2_q4, k1_q4}), .q_o({zero_late, k_late})
    );
    always_ff @(posedge clk_i) begin
      half_q <= zero_late ? '0 : q >> {k_late[3:2], 2'b0};
      k_rest_q <= k_late[1:0];
      shifted_q <= half_q >> k_rest_q;
    end
    assign shifted = shifted_q;
  end else begin : gen_plain
    assign scaled = x_i;
    assign shifted = q;
  end

  lipp_quadratic #(.F(F), .Root(RootSquare)) i_quadratic (.clk_i, .x_i(scaled), .y_o(q));

  localparam int Wy = F + 2 + Extra;
  logic [Wy-1:0] rounded_d;
  assign rounded_d = Wy'((shifted + (F+5)'(4 >> Extra)) >> (Guard - Extra));
  always_ff @(posedge clk_i) y_o <= rounded_d[Wy-1] ? {1'b0, {(Wy - 1){1'b1}}} : rounded_d;

endmodule

`default_nettype wire
