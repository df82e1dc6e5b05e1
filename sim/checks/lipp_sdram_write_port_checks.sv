// SPDX-License-Identifier: Apache-2.0
/// Checks at `lipp_sdram_write_port` that the client's requests are legal, that each word is
/// available when the controller takes the word, and that done_o marks the end of each request.
module lipp_sdram_write_port_checks #(
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
  input logic                 mem_word_take_i,
  input logic                 next_valid,
  input logic                 last_taken,
  input logic                 done_busy
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
    if (mem_rst_ni && reset_q) begin
      there: assert(!mem_word_take_i || next_valid);
      told: assert(!last_taken || !done_busy);
    end
  end

endmodule

bind lipp_sdram_write_port lipp_sdram_write_port_checks #(.PlaceBits(PlaceBits)) i_checks (.*);
