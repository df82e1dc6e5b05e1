// SPDX-License-Identifier: Apache-2.0
/// Checks at `lipp_sdram_read_port` that the client's requests are legal, and that the FIFO has
/// room for each word that arrives from the SDRAM.
module lipp_sdram_read_port_checks #(
  parameter int PlaceBits = 8
) (
  input logic                 clk_i,
  input logic                 rst_ni,
  input logic                 valid_i,
  input logic                 ready_o,
  input logic [PlaceBits-1:0] first_i,
  input logic [PlaceBits:0]   count_i,
  input logic                 split_free,
  input logic                 mem_clk_i,
  input logic                 mem_rst_ni,
  input logic                 mem_pair_valid,
  input logic                 fifo_ready
);

  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  always @(posedge clk_i) begin
    if (rst_ni && reset_q && valid_i && ready_o) begin
      even: assert(!first_i[0] && !count_i[0] && count_i != 0);
      free: assert(split_free);
    end
  end
  always @(posedge mem_clk_i) begin
    if (mem_rst_ni && reset_q) promised: assert(!mem_pair_valid || fifo_ready);
  end

endmodule

bind lipp_sdram_read_port lipp_sdram_read_port_checks #(.PlaceBits(PlaceBits)) i_checks (.*);
