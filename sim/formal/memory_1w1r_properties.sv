// SPDX-License-Identifier: Apache-2.0
/// Proves that memory_1w1r_kept can replace `lipp_memory_1w1r` in larger proofs.
///
/// A read takes two clocks and returns the word last written at its address before the read began.
module memory_1w1r_properties #(
  parameter int Width = 2,
  parameter int AddressBits = 3  // log2 of the number of words; the code below lists 2^3 words
) (
  input logic                   clk_i,
  input logic                   write_i,
  input logic [AddressBits-1:0] write_at_i,
  input logic [Width-1:0]       write_data_i,
  input logic [AddressBits-1:0] read_at_i
);

  logic [Width-1:0] read_data;
  lipp_memory_1w1r #(.Width(Width), .AddressBits(AddressBits)) i_memory (
    .clk_i, .write_i, .write_at_i, .write_data_i, .read_at_i, .read_data_o(read_data)
  );

  (* hierconn *) wire [Width-1:0] \i_memory.word_q ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[0] ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[1] ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[2] ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[3] ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[4] ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[5] ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[6] ;
  (* hierconn *) wire [Width-1:0] \i_memory.words[7] ;
  wire [8*Width-1:0] words = {
    \i_memory.words[7] , \i_memory.words[6] , \i_memory.words[5] , \i_memory.words[4] ,
    \i_memory.words[3] , \i_memory.words[2] , \i_memory.words[1] , \i_memory.words[0]
  };

  (* anyconst *) reg [AddressBits-1:0] watched_at;
  reg written_q = 0;
  reg [2:1] read_watched_q = 0;  // bit k: a read of the watched word began k clocks ago
  reg [Width-1:0] watched_word_q, watched_word_q2, watched_word_q3;
  always @(posedge clk_i) begin
    if (write_i && write_at_i == watched_at) begin
      watched_word_q <= write_data_i;
      written_q <= 1;
    end
    watched_word_q2 <= watched_word_q;
    watched_word_q3 <= watched_word_q2;
    read_watched_q <= {read_watched_q[1], read_at_i == watched_at && written_q};
  end
  always @(posedge clk_i) begin
    as_written: assert(!read_watched_q[2] || read_data == watched_word_q3);
    inside_words: assert(!written_q || words[watched_at*Width +: Width] == watched_word_q);
    inside_asked: assert(!read_watched_q[1] || \i_memory.word_q == watched_word_q2);
    cover_read: cover(read_watched_q[2] && watched_word_q3 == 1 && watched_word_q2 == 2);
    cover_while_written: cover(read_watched_q[1] && written_q && watched_word_q != watched_word_q2);
  end

endmodule
