// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Multiplies an unsigned word a by an unsigned fraction b in logic, and rounds to nearest:
///
///   p = a b                 with Drop = 0
///   p = (a b + 2^7) >> 8    with Drop = 8.
///
/// All registers come after the product, so a simulator moves only one word per clock. Synthesis
/// may move the registers into the product. FPGA families whose synthesis cannot retime registers
/// replace this module (rtl/ecp5/). The latency is lipp_math_pkg::small_latency() clocks.
module lipp_small_product #(
  parameter int Wa = 17,   // width of a in bits, 3 to 17
  parameter int Drop = 0,  // number of low bits to truncate, 0 or 8
  localparam int Wp = Wa + 9 - Drop
) (
  input  logic          clk_i,
  input  logic [Wa-1:0] a_i,
  input  logic [8:0]    b_i,
  output logic [Wp-1:0] p_o
);
  import lipp_math_pkg::*;

  localparam int Latency = small_latency();
  localparam logic [Wa+8:0] Half = Drop == 0 ? '0 : (Wa + 9)'(128);

  if (Wa < 3 || Wa > 17 || (Drop != 0 && Drop != 8)) begin : gen_illegal
    $fatal(1, "lipp_small_product: Wa must be 3 to 17 and Drop 0 or 8");
  end

  for (genvar k = 0; k < Latency; k++) begin : gen_stage
    logic [Wp-1:0] q;
    if (k == 0) begin : gen_first
      always_ff @(posedge clk_i) q <= Wp'(((Wa + 9)'(a_i) * (Wa + 9)'(b_i) + Half) >> Drop);
    end else begin : gen_next
      always_ff @(posedge clk_i) q <= gen_stage[k-1].q;
    end
  end
  assign p_o = gen_stage[Latency-1].q;

endmodule

`default_nettype wire
