// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 3 of the ray trace: computes a ray's unit direction e from its slope (m_x, m_y):
///
///   e = (m_x, m_y, 1) / sqrt(1 + m_x^2 + m_y^2).
///
/// In the formulas all words are integers, and a b >> k is the product of `lipp_multiplier`
/// truncated by k bits. The steps are
///
///   x    = ((m_x m_x >> F-4+2E) + (m_y m_y >> F-4+2E) + 2^(F+4) + 4) >> 3
///   e_z  = min(rsqrt(x), 2^(F+1+E) - 1)
///   e_x  = ((m_x e_z >> F-3+E) + 4) >> 3,  e_y likewise.
///
/// Word x, in [1, 4), has F + 1 fraction bits. The slope has F + E fraction bits and the direction
/// F + 1 + E, where E is Extra, 0 or extra_bits(F). Output beyond_o reports that x is 4 or more,
/// which means a slope of 60 degrees or more. The latency is unit_latency(F) clocks.
module lipp_unit_slope #(
  parameter int F = 23,
  parameter int Extra = 0,
  parameter bit CrossCells = 1'b0  // 1: cross terms use multiplier cells
) (
  input  logic                      clk_i,
  input  logic signed [F+1+Extra:0] mx_i,
  input  logic signed [F+1+Extra:0] my_i,
  output logic signed [F+1+Extra:0] ex_o,
  output logic signed [F+1+Extra:0] ey_o,
  output logic signed [F+1+Extra:0] ez_o,
  output logic                      beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::extra_bits;

  localparam int W = F + 2 + Extra;
  localparam int MulLatency = mul_latency(W, W);

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_unit_slope: F must be 14 to 23");
  end

  if (Extra != 0 && Extra != extra_bits(F)) begin : gen_illegal_extra
    $fatal(1, "lipp_unit_slope: Extra must be 0 or extra_bits(F)");
  end

  // ---- compute x = 1 + m_x^2 + m_y^2 ----
  localparam int SquareDrop = F - 4 + 2 * Extra;
  localparam int Wq = 2 * W - SquareDrop;
  logic signed [Wq-1:0] mx2, my2;
  logic signed [Wq:0] sum_q;
  logic [F+5:0] square_q;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(SquareDrop),
      .Square(1'b1)) i_mx2 (
    .clk_i, .a_i(mx_i), .b_i(mx_i), .p_o(mx2)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(SquareDrop),
      .Square(1'b1)) i_my2 (
    .clk_i, .a_i(my_i), .b_i(my_i), .p_o(my2)
  );
  always_ff @(posedge clk_i) begin
    sum_q <= (Wq + 1)'(mx2) + (Wq + 1)'(my2);
    square_q <= (F + 6)'((sum_q + (((Wq + 1)'(1) << (F + 4)) + (Wq + 1)'(4))) >>> Guard);
  end

  // ---- compute e_z = 1 / sqrt(x) ----
  logic steep;
  logic [W-1:0] inverse;
  logic signed [W-1:0] ez;
  lipp_rsqrt #(.F(F), .Extra(Extra)) i_rsqrt (.clk_i, .x_i(square_q[F+2:0]), .y_o(inverse));
  // The value 1 does not fit the word of e_z, so e_z is limited to the maximum.
  assign ez = inverse[W-1] ? {1'b0, {(W - 1){1'b1}}} : $signed(inverse);

  // ---- compute e_x and e_y, the lateral direction ----
  localparam int Drop = F - Guard + Extra;
  localparam int Wp = 2 * W - Drop;
  logic signed [W-1:0] mx_late, my_late;
  logic signed [Wp-1:0] ex, ey;
  lipp_delay #(.Width(2 * W), .Cycles(MulLatency + 2 + rsqrt_latency())) i_slope (
    .clk_i, .d_i({mx_i, my_i}), .q_o({mx_late, my_late})
  );
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)
  ) i_ex (.clk_i, .a_i(mx_late), .b_i(ez), .p_o(ex));
  lipp_multiplier #(
    .CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)
  ) i_ey (.clk_i, .a_i(my_late), .b_i(ez), .p_o(ey));
  always_ff @(posedge clk_i) begin
    ex_o <= W'((ex + Wp'(4)) >>> Guard);
    ey_o <= W'((ey + Wp'(4)) >>> Guard);
  end
  lipp_delay #(.Width(1), .Cycles(rsqrt_latency())) i_steep (
    .clk_i, .d_i(|square_q[F+5:F+3]), .q_o(steep)
  );
  lipp_delay #(.Width(W + 1), .Cycles(MulLatency + 1)) i_ez (
    .clk_i, .d_i({ez, steep}), .q_o({ez_o, beyond_o})
  );

endmodule

`default_nettype wire
