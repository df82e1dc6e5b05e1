// SPDX-License-Identifier: Apache-2.0
/// Checks at the ports of `lipp_config_bank` that config_o changes only when no module uses it.
///
/// The active copy changes only while busy_o is high, and only if no module used the copy two
/// clocks before the change. The new value is config_i of the previous clock. Output busy_o is high
/// from the clock after a request on, and equals hold_o of the previous clock.
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
  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;
`endif

  reg past_valid_q;  // 1: the registers below hold values of the previous clock
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

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_config_bank lipp_config_bank_checks #(.Width(Width)) i_checks (.*);
`endif
