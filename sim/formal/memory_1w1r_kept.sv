// SPDX-License-Identifier: Apache-2.0
/// Replaces `lipp_memory_1w1r` in proofs, to reduce the number of states.
///
/// The module stores one word, at an address that the solver chooses. At all other addresses the
/// module returns arbitrary words. Every behaviour of the memory is a behaviour of this module, so
/// a proof with this module is valid for the memory.
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

  (* anyconst *) reg [AddressBits-1:0] watched_at;
  (* anyseq *) reg [Width-1:0] other;
  reg [Width-1:0] watched_word_q, word_q;
  always @(posedge clk_i) begin
    if (write_i && write_at_i == watched_at) watched_word_q <= write_data_i;
    word_q <= read_at_i == watched_at ? watched_word_q : other;
    read_data_o <= word_q;
  end

endmodule
