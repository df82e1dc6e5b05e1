// SPDX-License-Identifier: Apache-2.0
/// The contract of `lipp_config_bank`, at its ports.
///
/// The copy in use changes only if nothing used it two clocks before, while busy_o is high, and
/// only to what config_i was in the clock before. busy_o is high from the clock after a request on,
/// and is what hold_o was in the clock before.
module lipp_config_bank_checks #(
  parameter int Width = 32
) (
  input logic             clk_i,
  input logic             rst_ni,
  input logic [Width-1:0] config_i,
  input logic             apply_i,
  input logic             idle_i,
  input logic             busy_o,
  input logic             hold_o,
  input logic [Width-1:0] config_o
);

`ifdef FORMAL
  wire checked = rst_ni;
`else
  reg reset_q = 0;  // nothing is asserted before the first reset
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;
`endif

  reg past_valid_q;  // the values below are of the clock before
  reg applied_q, busy_q, hold_q, idle_q, idle_q2;
  reg [Width-1:0] config_q, used_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) past_valid_q <= 0;
    else past_valid_q <= 1;
  end
  always @(posedge clk_i) begin
    {applied_q, busy_q, hold_q} <= {apply_i, busy_o, hold_o};
    {idle_q, idle_q2} <= {idle_i, idle_q};
    {config_q, used_q} <= {config_i, config_o};
  end

  always @(posedge clk_i) begin
    if (checked && past_valid_q) begin
      only_idle: assert(config_o == used_q || (idle_q2 && busy_q));
      copied: assert(config_o == used_q || config_o == config_q);
      busy: assert(!applied_q || busy_o);
      hold: assert(busy_o == hold_q);
    end
  end

endmodule

`ifndef FORMAL  // simulation: beside every instance
bind lipp_config_bank lipp_config_bank_checks #(.Width(Width)) i_checks (.*);
`endif
