// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 4 of the ray trace (plano side to the panel): refracts the ray into glass at the flat face.
///
/// Refraction at the flat face keeps the tangential part of n d, the refractive index times the
/// direction. With e the direction in the air, the direction in the glass is (t_x, t_y, dz):
///
///   t = e / n,   dz = sqrt(1 - t_x^2 - t_y^2).
///
/// In the formulas all words are integers, a b >> k is the product of `lipp_multiplier` truncated
/// by k bits, and M = 2^(F+3) - 1. The steps are
///
///   t_x  = ((e_x i >> F-2) + 4) >> 3,  t_y likewise
///   g    = max((t_x t_x >> F-3+2E) + (t_y t_y >> F-3+2E), 0) >> 2
///   dz   = sqrt(M - g).
///
/// The word i is 1/n with F + 1 fraction bits, and g has F + 3. The function max() is needed
/// because the truncation may make g negative. Words e and t have F + 1 + E fraction bits with E =
/// extra_bits(F), and dz has F + 1 + 3 E. The extra bits are needed because the path to the dome
/// magnifies direction errors. With n >= 1.16 and |e| < sqrt(3)/2, M - g is above 1/4. Output
/// beyond_o reports that M - g is below 1/4. The latency is enter_flat_latency(F) clocks.
module lipp_enter_flat #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0, // 1: cross terms use multiplier cells
  localparam int E = lipp_optics_pkg::extra_bits(F),
  localparam int Wt = F + 2 + E,
  localparam int Wz = F + 2 + 3 * E
) (
  input  logic                 clk_i,
  input  logic signed [Wt-1:0] ex_i,
  input  logic signed [Wt-1:0] ey_i,
  input  logic signed [F+1:0]  index_inverse_i,  // 1/n, F + 1 fraction bits
  output logic signed [Wt-1:0] tx_o,
  output logic signed [Wt-1:0] ty_o,
  output logic signed [Wz-1:0] dz_o,
  output logic                 beyond_o
);
  import lipp_math_pkg::*;

  localparam int W = F + 2;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_enter_flat: F must be 14 to 23");
  end

  // ---- compute t = e / n, the lateral direction ----
  localparam int Drop = F + 1 - Guard;
  localparam int Wp = Wt + W - Drop;
  logic signed [Wp-1:0] tx, ty;
  logic signed [Wt-1:0] tx_q, ty_q;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wt), .Wb(W), .Drop(Drop)) i_tx (
    .clk_i, .a_i(ex_i), .b_i(index_inverse_i), .p_o(tx)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wt), .Wb(W), .Drop(Drop)) i_ty (
    .clk_i, .a_i(ey_i), .b_i(index_inverse_i), .p_o(ty)
  );
  always_ff @(posedge clk_i) begin
    tx_q <= Wt'((tx + Wp'(4)) >>> Guard);
    ty_q <= Wt'((ty + Wp'(4)) >>> Guard);
  end

  // ---- compute dz, the axial direction, from the unit length ----
  localparam int SquareDrop = F - 3 + 2 * E;
  localparam int Wq = 2 * Wt - SquareDrop;
  logic signed [Wq-1:0] tx2, ty2, sum_q;
  logic [F+2:0] square_q;
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wt), .Wb(Wt), .Drop(SquareDrop),
      .Square(1'b1)) i_tx2 (
    .clk_i, .a_i(tx_q), .b_i(tx_q), .p_o(tx2)
  );
  lipp_multiplier #(.CrossCells(CrossCells), .Wa(Wt), .Wb(Wt), .Drop(SquareDrop),
      .Square(1'b1)) i_ty2 (
    .clk_i, .a_i(ty_q), .b_i(ty_q), .p_o(ty2)
  );
  always_ff @(posedge clk_i) begin
    sum_q <= tx2 + ty2;
    square_q <= ~(F + 3)'(sum_q[Wq-1] ? '0 : sum_q >>> 2);
  end
  lipp_sqrt #(.F(F), .Normalise(1'b0), .Extra(3 * E)) i_sqrt (.clk_i, .x_i(square_q), .y_o(dz_o));
  lipp_delay #(.Width(1), .Cycles(sqrt_latency(1'b0))) i_beyond (
    .clk_i, .d_i(square_q[F+2:F+1] == '0), .q_o(beyond_o)
  );

  lipp_delay #(.Width(2 * Wt), .Cycles(mul_latency(Wt, Wt) + 2 + sqrt_latency(1'b0))) i_t (
    .clk_i, .d_i({tx_q, ty_q}), .q_o({tx_o, ty_o})
  );

endmodule

`default_nettype wire
