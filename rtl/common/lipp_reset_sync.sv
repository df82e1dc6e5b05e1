// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Makes a clock's reset of an asynchronous one: it begins at once and ends with the clock.
///
/// rst_no falls with rst_ni, also while the clock stands still, and rises with the Stages-th rising
/// edge after rst_ni has risen, or one later if that was at an edge. So all registers leave reset
/// in the same clock.
module lipp_reset_sync #(
  parameter int Stages = 2
) (
  input  logic clk_i,
  input  logic rst_ni,  // asynchronous, such as a pin or a PLL's lock
  output logic rst_no
);

  if (Stages < 2) begin : gen_illegal
    $fatal(1, "lipp_reset_sync: Stages must be 2 or more");
  end

  // Not to be moved, merged or made a shift register. High in reset, as many cells want it: there
  // the inverter at the output meets theirs, and both vanish.
  (* async_reg = "true", keep = "true" *) logic [Stages-1:0] stage_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) stage_q <= '1;
    else stage_q <= {stage_q[Stages-2:0], 1'b0};
  end
  assign rst_no = !stage_q[Stages-1];

endmodule

`default_nettype wire
