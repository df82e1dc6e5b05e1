// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies two signed words with multiplier cells only and truncates the product by Drop bits.
///
/// The result is that of `lipp_cut_product`. All registers come after the product, so a simulator
/// moves only one word per clock. Synthesis can move the registers into the multiplier cells. FPGA
/// families whose synthesis cannot retime registers replace this module by multiplier cells
/// (rtl/ecp5/). The latency is lipp_math_pkg::mul_latency(Wa, Wb) clocks.
module lipp_wide_product #(
  parameter int Wa = 18,       // width of a in bits
  parameter int Wb = 18,       // width of b in bits
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

  localparam int Latency = mul_latency(Wa, Wb);

  if (Wa < 1 || Wb < 1 || Wa + Wb > 64 || Drop >= Wa + Wb) begin : gen_illegal
    $fatal(1,
        "lipp_wide_product: Wa and Wb must be 1 or more, 64 at most together, and more than Drop");
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
