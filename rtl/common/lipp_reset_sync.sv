// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Synchronises the end of an asynchronous reset to clk_i. The reset at output rst_no starts at
/// once and ends at an edge of clk_i.
///
/// Output rst_no falls together with rst_ni, even if clk_i is stopped. Output rst_no rises at the
/// Stages-th rising edge after rst_ni has risen, or one edge later if rst_ni rises at an edge.
/// Therefore all registers that rst_no resets leave reset in the same clock.
module lipp_reset_sync #(
  parameter int Stages = 2
) (
  input  logic clk_i,
  input  logic rst_ni,  // asynchronous reset, such as a pin or a PLL's lock
  output logic rst_no
);

  if (Stages < 2) begin : gen_illegal
    $fatal(1, "lipp_reset_sync: Stages must be 2 or more");
  end

  // Synthesis must neither move nor merge these registers, nor turn them into a shift register. The
  // registers are high in reset, because many FPGA cells have an active-high reset. The inverter at
  // rst_no then cancels the inverter of each cell.
  (* async_reg = "true", keep = "true" *) logic [Stages-1:0] stage_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) stage_q <= '1;
    else stage_q <= {stage_q[Stages-2:0], 1'b0};
  end
  assign rst_no = !stage_q[Stages-1];

endmodule

`default_nettype wire
