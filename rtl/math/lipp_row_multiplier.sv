// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies two signed words, with the same result as `lipp_multiplier` but with a shorter
/// latency. Carry chains add the cross terms row by row.
///
/// The result is that of `lipp_cut_product`. The module has fewer registers than `lipp_multiplier`
/// and a lower maximum clock frequency. All registers come after the product, so a simulator moves
/// only one word per clock. Synthesis for an FPGA family with suitable carry chains replaces this
/// module (rtl/ecp5/). The latency is lipp_math_pkg::row_latency(Wa, Wb), which is 3 or 4 clocks.
module lipp_row_multiplier #(
  parameter int Wa = 18,       // width of a in bits, 3 to 32
  parameter int Wb = 18,       // width of b in bits, 3 to 32
  parameter int Drop = 0,      // number of low bits to truncate
  parameter bit Square = 1'b0, // 1: b equals a, one cross term is doubled
  localparam int Wp = Wa + Wb - Drop
) (
  input  logic                 clk_i,
  input  logic signed [Wa-1:0] a_i,
  input  logic signed [Wb-1:0] b_i,
  output logic signed [Wp-1:0] p_o
);
  import lipp_math_pkg::*;

  localparam int La = low_bits(Wa);
  localparam int Lb = low_bits(Wb);
  localparam int Latency = row_latency(Wa, Wb);

  if (Wa < 3 || Wb < 3 || Wa > 32
      || Wb > 32 || Drop < 0 || Drop >= Wa + Wb) begin : gen_illegal_width
    $fatal(1, "lipp_row_multiplier: Wa and Wb must be 3 to 32, and Drop less than their sum");
  end
  if (La > 0 && Lb > 0 && Drop < La + Lb) begin : gen_illegal_drop
    $fatal(1, "lipp_row_multiplier: Drop must cut off the product of the lower parts");
  end
  if (Square && Wa != Wb) begin : gen_illegal_square
    $fatal(1, "lipp_row_multiplier: Square takes words of one width");
  end

  logic [Wp-1:0] p;
  lipp_cut_product #(.Wa(Wa), .Wb(Wb), .Drop(Drop), .Square(Square)) i_product (.a_i, .b_i,
      .p_o(p));

  for (genvar k = 0; k < Latency; k++) begin : gen_stage
    logic [Wp-1:0] q;
    if (k == 0) begin : gen_first
      always_ff @(posedge clk_i) q <= p;
    end else begin : gen_next
      always_ff @(posedge clk_i) q <= gen_stage[k-1].q;
    end
  end
  assign p_o = $signed(gen_stage[Latency-1].q);

endmodule

`default_nettype wire
