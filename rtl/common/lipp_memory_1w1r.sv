// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Memory with one write port and one read port. The read latency is two clocks.
///
/// Output read_data_o(t) is the word at read_at_i(t - 2), as it was before t - 2. The module has a
/// register at its output. An FPGA family replaces this module by its memory cell (rtl/ecp5/).
module lipp_memory_1w1r #(
  parameter int Width = 36,
  parameter int AddressBits = 9
) (
  input  logic                   clk_i,
  input  logic                   write_i,
  input  logic [AddressBits-1:0] write_at_i,
  input  logic [Width-1:0]       write_data_i,
  input  logic [AddressBits-1:0] read_at_i,
  output logic [Width-1:0]       read_data_o
);

  if (Width < 1 || AddressBits < 1) begin : gen_illegal
    $fatal(1, "lipp_memory_1w1r: Width and AddressBits must be 1 or more");
  end

  logic [Width-1:0] words[1 << AddressBits];
  logic [Width-1:0] word_q;

  always_ff @(posedge clk_i) begin
    if (write_i) words[write_at_i] <= write_data_i;
    word_q <= words[read_at_i];
    read_data_o <= word_q;
  end

endmodule

`default_nettype wire
