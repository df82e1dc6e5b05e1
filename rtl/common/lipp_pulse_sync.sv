// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Transfers pulses from one clock domain to another: each accepted pulse of from_clk_i becomes one
/// pulse that lasts one clock of to_clk_i.
///
/// A pulse is accepted while from_busy_o is low. The output pulse follows after Stages rising edges
/// of to_clk_i. Output from_busy_o stays high for one more rising edge of to_clk_i, and then for
/// Stages rising edges of from_clk_i. An input pulse is ignored while from_busy_o is high. A delay
/// is one edge longer if a signal changes at an edge of the other clock. Both clock domains must be
/// reset together.
module lipp_pulse_sync #(
  parameter int Stages = 2
) (
  input  logic from_clk_i,
  input  logic from_rst_ni,
  input  logic from_pulse_i,
  output logic from_busy_o,

  input  logic to_clk_i,
  input  logic to_rst_ni,
  output logic to_pulse_o
);

  // Each pulse toggles a level. The receiver sends the level back as an acknowledgement.
  logic level_q, back, there, there_q;
  assign from_busy_o = level_q != back;
  always_ff @(posedge from_clk_i or negedge from_rst_ni) begin
    if (!from_rst_ni) level_q <= 1'b0;
    else level_q <= level_q ^ (from_pulse_i && !from_busy_o);
  end
  lipp_bit_sync #(.Stages(Stages)) i_there (
    .clk_i(to_clk_i), .rst_ni(to_rst_ni), .d_i(level_q), .q_o(there)
  );

  assign to_pulse_o = there != there_q;
  always_ff @(posedge to_clk_i or negedge to_rst_ni) begin
    if (!to_rst_ni) there_q <= 1'b0;
    else there_q <= there;
  end
  lipp_bit_sync #(.Stages(Stages)) i_back (
    .clk_i(from_clk_i), .rst_ni(from_rst_ni), .d_i(there_q), .q_o(back)
  );

endmodule

`default_nettype wire
