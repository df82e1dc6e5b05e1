// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Product of two short unsigned words that needs no multiplier cell: p(t) = a(t - Latency) b(t - Latency).
///
/// The product comes first and all registers follow it: a simulator then moves one word a clock, and
/// synthesis may move the registers into the product. Synthesis for a family without such retiming
/// replaces this module (rtl/ecp5/). Latency is lipp_math_pkg::low_latency(Wb).
module lipp_small_product #(
  parameter int Wa = 8,  // bits of a, 1 to 17
  parameter int Wb = 8,  // bits of b, 1 to 17: the fewer, the less logic
  localparam int Wp = Wa + Wb
) (
  input  logic          clk_i,
  input  logic [Wa-1:0] a_i,
  input  logic [Wb-1:0] b_i,
  output logic [Wp-1:0] p_o
);
  import lipp_math_pkg::*;

  localparam int Latency = low_latency(Wb);

  if (Wa < 1 || Wa > 17 || Wb < 1 || Wb > 17) begin : gen_illegal
    $fatal(1, "lipp_small_product: Wa and Wb must be 1 to 17");
  end

  for (genvar k = 0; k < Latency; k++) begin : gen_stage
    logic [Wp-1:0] q;
    if (k == 0) begin : gen_first
      always_ff @(posedge clk_i) q <= Wp'(a_i) * Wp'(b_i);
    end else begin : gen_next
      always_ff @(posedge clk_i) q <= gen_stage[k-1].q;
    end
  end
  assign p_o = gen_stage[Latency-1].q;

endmodule

`default_nettype wire
