// SPDX-License-Identifier: Apache-2.0
/// Checks at the ports of `lipp_flow_control` in which clocks rays are accepted and leave.
///
/// Output ready_o is low in the clock after hold_i, and high only while a FIFO entry is free. If
/// the reader is always ready and hold_i is low, ready_o rises within 6 clocks and stays high. A
/// ray leaves Latency + 4 clocks after it was accepted, or later if it waits for the reader. Output
/// idle_o is high exactly if no ray is inside and no ray has left in the last three clocks.
module lipp_flow_control_checks #(
  parameter int Latency = 100,
  parameter int AddressBits = 9,
  parameter int Width = 36
) (
  input logic             clk_i,
  input logic             rst_ni,
  input logic             hold_i,
  input logic             idle_o,
  input logic             valid_i,
  input logic             ready_o,
  input logic             valid_o,
  input logic             ready_i,
  input logic [Width-1:0] data_o
);

`ifdef FORMAL
  wire checked = rst_ni;
`else
  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;
`endif

  localparam int C = AddressBits + 1;
  localparam int Room = 1 << AddressBits;

  wire accept = valid_i && ready_o;
  wire leave = valid_o && ready_i;

  reg [C-1:0] inside_q;         // number of rays that were accepted and have not left yet
  reg [Latency+3:0] entered_q;  // bit k: a ray was accepted k + 1 clocks ago
  reg [C-1:0] recent_q;         // number of rays accepted in the last Latency + 3 clocks
  reg [2:0] flows_q;            // clocks with a ready reader and hold_i low, counted to 6
  reg stalled_q, hold_q;
  reg [2:0] leave_q;            // bit k: a ray left k + 1 clocks ago
  reg [Width-1:0] out_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      inside_q <= 0;
      entered_q <= 0;
      recent_q <= 0;
      flows_q <= 0;
      stalled_q <= 0;
      hold_q <= 0;
      leave_q <= 0;
    end else begin
      inside_q <= inside_q + C'(accept) - C'(leave);
      entered_q <= {entered_q[Latency+2:0], accept};
      recent_q <= recent_q + C'(accept) - C'(entered_q[Latency+2]);
      if (!ready_i || hold_i) flows_q <= 0;
      else if (flows_q < 6) flows_q <= flows_q + 1;
      stalled_q <= valid_o && !ready_i;
      hold_q <= hold_i;
      leave_q <= {leave_q[1:0], leave};
    end
  end
  always @(posedge clk_i) out_q <= data_o;

  always @(posedge clk_i) begin
    if (checked) begin
      room: assert(inside_q <= C'(Room) && (!ready_o || inside_q < C'(Room)));
      hold: assert(!hold_q || !ready_o);
      idle: assert(idle_o == (inside_q == 0 && leave_q == 0));
      open: assert(flows_q < 6 || ready_o);
      latency: assert(valid_o == (inside_q > recent_q));
      stable_data: assert(!stalled_q || data_o == out_q);
    end
  end

endmodule

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_flow_control lipp_flow_control_checks #(
  .Latency(Latency), .AddressBits(AddressBits), .Width(Width)
) i_checks (.*);
`endif
