// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 1: pixel coordinates to lattice coordinates, with the array's pitch, rotation and offset.
///
///   hi = (u ah_u + v ah_v) + oh,   lo = (u al_u + v al_v) + ol    (each coefficient 2^17 ah + al)
///   x  = floor((hi + floor(lo / 2^17)) / 2^(23 - F))
///
/// and likewise for y: one affine map, exact up to the final floor. The offsets include 2^(39 - F),
/// which makes that floor a rounding. Input u_i, v_i: signed, 4 fraction bits, columns to the right
/// and rows *upward* from the panel's centre. Coefficients: signed, 36 fraction bits. Offsets:
/// signed, 40 fraction bits. Output x_o, y_o: signed, IndexBits + F bits, F fraction bits, in
/// pitches (hexagonal: y in rows). beyond_o: x or y is outside [-2048, 2048). Latency
/// pixel_latency().
module lipp_pixel_to_lattice #(
  parameter int F = 23
) (
  input  logic                                           clk_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0]   u_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0]   v_i,
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   x_from_u_i,  // array_from_pixel, row x
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   x_from_v_i,
  input  logic signed [lipp_optics_pkg::OffsetBits-1:0]  x_offset_i,
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   y_from_u_i,  // array_from_pixel, row y
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   y_from_v_i,
  input  logic signed [lipp_optics_pkg::OffsetBits-1:0]  y_offset_i,
  output logic signed [lipp_optics_pkg::IndexBits+F-1:0] x_o,
  output logic signed [lipp_optics_pkg::IndexBits+F-1:0] y_o,
  output logic                                           beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int LowBits = SlopeBits - MulBits;  // 17: with a sign bit it is an operand of 18 bits
  localparam int Wo = OffsetBits - LowBits;
  localparam int Whi = Wo + 2;  // three words' sum

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_pixel_to_lattice: F must be 14 to 23");
  end

  logic [1:0] beyond;
  assign beyond_o = |beyond;
  for (genvar k = 0; k < 2; k++) begin : gen_axis
    logic signed [SlopeBits-1:0] from_u, from_v;
    logic signed [OffsetBits-1:0] offset;
    assign from_u = k == 0 ? x_from_u_i : y_from_u_i;
    assign from_v = k == 0 ? x_from_v_i : y_from_v_i;
    assign offset = k == 0 ? x_offset_i : y_offset_i;

    // ---- four products of 18 x 18 bits ----
    logic signed [2*MulBits-1:0] hi_u, hi_v, lo_u, lo_v;
    lipp_multiplier i_hi_u (
      .clk_i, .a_i(u_i), .b_i(from_u[SlopeBits-1-:MulBits]), .p_o(hi_u)
    );
    lipp_multiplier i_hi_v (
      .clk_i, .a_i(v_i), .b_i(from_v[SlopeBits-1-:MulBits]), .p_o(hi_v)
    );
    lipp_multiplier i_lo_u (
      .clk_i, .a_i(u_i), .b_i({1'b0, from_u[LowBits-1:0]}), .p_o(lo_u)
    );
    lipp_multiplier i_lo_v (
      .clk_i, .a_i(v_i), .b_i({1'b0, from_v[LowBits-1:0]}), .p_o(lo_v)
    );

    // ---- their sum, with the carry of the lower half into the upper ----
    logic signed [2*MulBits:0] lo_q, lo_sum_q;
    logic signed [Whi-1:0] hi_q, hi_sum_q, sum_q;
    always_ff @(posedge clk_i) begin
      lo_q <= (2 * MulBits + 1)'(lo_u) + (2 * MulBits + 1)'(lo_v);
      hi_q <= Whi'(hi_u) + Whi'(hi_v);
      lo_sum_q <= lo_q + (2 * MulBits + 1)'($signed({1'b0, offset[LowBits-1:0]}));
      hi_sum_q <= hi_q + Whi'($signed(offset[OffsetBits-1:LowBits]));
      sum_q <= hi_sum_q + Whi'(lo_sum_q >>> LowBits);
    end

    assign beyond[k] = sum_q != Whi'($signed(sum_q[Wo-1:0]));
    if (k == 0) begin : gen_x
      assign x_o = (IndexBits + F)'(sum_q >>> (23 - F));
    end else begin : gen_y
      assign y_o = (IndexBits + F)'(sum_q >>> (23 - F));
    end
  end

endmodule

`default_nettype wire
