// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Brings a bit of another clock, or of a pin, to this clock.
///
/// q_o follows d_i with the Stages-th rising edge after a change, or one later if the change was at
/// an edge: a latency of Stages - 1 to Stages + 1 clocks. A level that is shorter than a clock may
/// be lost. The registers in a row give a metastable first one the time to settle. For one bit
/// only: bits brought over side by side may arrive in different clocks; see `lipp_async_fifo` for
/// words.
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

  // Not to be moved, merged or made a shift register.
  (* async_reg = "true", keep = "true" *) logic [Stages-1:0] stage_q;
  assign q_o = stage_q[Stages-1];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) stage_q <= {Stages{ResetValue}};
    else stage_q <= {stage_q[Stages-2:0], d_i};
  end

endmodule

`default_nettype wire
