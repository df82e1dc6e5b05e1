// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Double-buffers a configuration: the active copy config_o changes only while no module uses it.
///
/// Input apply_i requests a new copy of config_i. The copy is made as soon as idle_i is high, and
/// busy_o is high until then. While busy_o is high, no module may start to use config_o, so that
/// idle_i stays high until the copy is made. Output hold_o is the next clock's value of busy_o, for
/// a module that registers hold_o before use. Reset also requests a copy.
module lipp_config_bank #(
  parameter int Width = 32
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic [Width-1:0] config_i,
  input  logic             apply_i,
  input  logic             idle_i,    // 1: no module uses config_o
  output logic             busy_o,
  output logic             hold_o,
  output logic [Width-1:0] config_o
);

  if (Width < 1) begin : gen_illegal
    $fatal(1, "lipp_config_bank: Width must be 1 or more");
  end

  logic pending_q;
  logic copy_q;  // 1: copy in this clock; registered, because its fan-out is large
  logic [Width-1:0] config_q;
  assign busy_o = pending_q;
  assign hold_o = apply_i || (pending_q && !copy_q);
  assign config_o = config_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      pending_q <= 1'b1;
      copy_q <= 1'b0;
    end else begin
      pending_q <= hold_o;
      copy_q <= pending_q && idle_i && !copy_q;
    end
  end

  always_ff @(posedge clk_i) if (copy_q) config_q <= config_i;

endmodule

`default_nettype wire
