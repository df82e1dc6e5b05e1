// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Synchronises one bit, from another clock or from a pin, to clk_i.
///
/// Output q_o follows d_i at the Stages-th rising edge after a change, or one edge later if d_i
/// changes at an edge. The latency is Stages - 1 to Stages + 1 clocks. A pulse shorter than one
/// clock may be lost. The chain of registers gives a metastable first register time to settle. Use
/// this module for single bits only, because several bits may arrive in different clocks. Use
/// `lipp_async_fifo` for words of several bits.
module lipp_bit_sync #(
  parameter int Stages = 2,
  parameter bit ResetValue = 1'b0
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic d_i,     // asynchronous to clk_i
  output logic q_o
);

  if (Stages < 2) begin : gen_illegal
    $fatal(1, "lipp_bit_sync: Stages must be 2 or more");
  end

  // Synthesis must neither move nor merge these registers, nor turn them into a shift register.
  (* async_reg = "true", keep = "true" *) logic [Stages-1:0] stage_q;
  assign q_o = stage_q[Stages-1];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) stage_q <= {Stages{ResetValue}};
    else stage_q <= {stage_q[Stages-2:0], d_i};
  end

endmodule

`default_nettype wire
