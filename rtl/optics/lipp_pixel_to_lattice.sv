// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 1 of the ray trace: maps pixel coordinates (u, v) to lattice coordinates (x, y), with the
/// array's pitch, rotation and offset.
///
/// Each coefficient is split into 2^17 ah + al and each offset into 2^17 oh + ol, so that the parts
/// fit a multiplier. In the formulas all words are integers. The affine map for x is
///
///   hi = (u ah_u + v ah_v) + oh,   lo = (u al_u + v al_v) + ol
///   x  = floor((hi + floor(lo / 2^17)) / 2^(23 - F)).
///
/// The map for y has the same formulas with its own coefficients. The map is exact up to the final
/// floor(). The offsets include 2^(39 - F), so that the final floor() rounds to nearest.
///
/// The inputs u_i (columns to the right) and v_i (rows upward) are measured from the panel's
/// centre. Pixel coordinates are signed with 4 fraction bits. Coefficients are signed with 36
/// fraction bits, offsets are signed with 40 fraction bits. The outputs x_o and y_o are signed and
/// have IndexBits + F bits, F of them fraction bits. The outputs are in pitches; on a hexagonal
/// grid, y is in rows. Output beyond_o reports that x or y is outside [-2048, 2048). The latency is
/// pixel_latency() clocks.
module lipp_pixel_to_lattice #(
  parameter int F = 23
) (
  input  logic                                           clk_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0]   u_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0]   v_i,
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   x_from_u_i,  // x per u, 36 fraction bits
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   x_from_v_i,
  input  logic signed [lipp_optics_pkg::OffsetBits-1:0]  x_offset_i,
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   y_from_u_i,  // y per u, 36 fraction bits
  input  logic signed [lipp_optics_pkg::SlopeBits-1:0]   y_from_v_i,
  input  logic signed [lipp_optics_pkg::OffsetBits-1:0]  y_offset_i,
  output logic signed [lipp_optics_pkg::IndexBits+F-1:0] x_o,
  output logic signed [lipp_optics_pkg::IndexBits+F-1:0] y_o,
  output logic                                           beyond_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int LowBits = SlopeBits - MulBits;  // width of the unsigned part al, 17 bits
  localparam int Wo = OffsetBits - LowBits;
  localparam int Whi = Wo + 2;  // width of hi, a sum of three words

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

    // ---- multiply u and v by the parts of their coefficients, 18 x 18 bits ----
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

    // ---- add the products, and add the carry of the low half to the high half ----
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
