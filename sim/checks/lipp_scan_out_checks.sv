// SPDX-License-Identifier: Apache-2.0
/// Checks the video signals of `lipp_scan_out` as a video transmitter needs them: while de_o is low
/// the output is black, and while de_o is high no sync is active.
module lipp_scan_out_checks #(
  parameter bit HPositive = 1'b1,
  parameter bit VPositive = 1'b1
) (
  input logic        clk_i,
  input logic        rst_ni,
  input logic        de_o,
  input logic        hsync_o,
  input logic        vsync_o,
  input logic [23:0] rgb_o,
  input logic        frame_start_o
);

`ifdef FORMAL
  wire checked = rst_ni;
`else
  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;
`endif

  reg past_valid_q;  // 1: one clock has passed since reset
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) past_valid_q <= 0;
    else past_valid_q <= 1;
  end
  always @(posedge clk_i) begin
    if (checked && past_valid_q) begin
      blank: assert(de_o || rgb_o == 0);
      apart: assert(!de_o || (hsync_o != HPositive && vsync_o != VPositive));
      first: assert(!frame_start_o || de_o);
    end
  end

endmodule

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_scan_out lipp_scan_out_checks #(.HPositive(HPositive),
    .VPositive(VPositive)) i_checks (.*);
`endif
