// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reads a range of entries of the tile table or block table, and outputs them as a word stream.
///
/// Input start_i starts the read. Each entry is sampled 4 clocks after table_at_o became the index
/// of the entry.
module lipp_table_reader (
  input  logic        clk_i,
  input  logic        rst_ni,
  input  logic        start_i,
  input  logic [15:0] first_i,  // index of the first entry, stable until the last is taken
  input  logic [9:0]  count_i,  // number of entries, 1 or more
  output logic        word_valid_o,
  input  logic        word_ready_i,
  output logic [31:0] word_o,

  output logic [15:0] table_at_o,
  input  logic [31:0] table_crc_i    // table entry at table_at_o, at most 3 clocks later
);

  logic [9:0] at_q, remaining_q;
  logic [1:0] pause_q;
  assign table_at_o = first_i + 16'(at_q);

  always_ff @(posedge clk_i) if (!word_valid_o) word_o <= table_crc_i;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {at_q, remaining_q, pause_q, word_valid_o} <= '0;
    end else if (start_i) begin
      {at_q, remaining_q, pause_q} <= {10'd0, count_i, 2'd3};
    end else if (word_valid_o) begin
      if (word_ready_i) begin
        {at_q, remaining_q, pause_q} <= {at_q + 10'd1, remaining_q - 10'd1, 2'd3};
        word_valid_o <= 1'b0;
      end
    end else if (remaining_q != '0) begin
      pause_q <= pause_q - 1'b1;
      word_valid_o <= pause_q == '0;
    end
  end

endmodule

`default_nettype wire
