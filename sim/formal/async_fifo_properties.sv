// SPDX-License-Identifier: Apache-2.0
/// Proves that `lipp_async_fifo` loses and reorders no word between two arbitrary clocks: the
/// solver chooses when each clock has an edge.
///
/// A synchroniser samples a bit either before or after an edge of the other clock, so a bit that
/// changes while it is sampled gives its old or its new value. The sampled count is therefore the
/// old or the new count, if at most one bit of the count changes at a time (function one_bit).
module async_fifo_properties #(
  parameter int Width = 2,
  parameter int AddressBits = 2  // log2 of the number of entries; the code below lists 2^2 words
) (
  input logic             in_clk_i,
  input logic             out_clk_i,
  input logic             rst_ni,
  input logic             in_valid_i,
  input logic [Width-1:0] in_data_i,
  input logic             out_ready_i
);

  localparam int C = AddressBits + 1;
  localparam int Places = 1 << AddressBits;

  logic in_ready, out_valid;
  logic [Width-1:0] out_data;
  lipp_async_fifo #(.Width(Width), .AddressBits(AddressBits)) i_fifo (
    .in_clk_i, .in_rst_ni(rst_ni), .in_valid_i, .in_ready_o(in_ready), .in_data_i,
    .out_clk_i, .out_rst_ni(rst_ni), .out_valid_o(out_valid), .out_ready_i,
    .out_data_o(out_data)
  );

  // Reset is active only in the first step of the proof: a later reset leads to the same state.
  reg started_q = 0;
  always @($global_clock) started_q <= 1;
  always @* assume(rst_ni == started_q);

  // These wires carry internal registers of the design: yosys flattens the hierarchy and connects
  // each wire to the register of the same name.
  (* hierconn *) wire [C-1:0] \i_fifo.written_q ;
  (* hierconn *) wire [C-1:0] \i_fifo.written_gray_q ;
  (* hierconn *) wire [C-1:0] \i_fifo.written_next_q ;
  (* hierconn *) wire [C-1:0] \i_fifo.read_q ;
  (* hierconn *) wire [C-1:0] \i_fifo.read_gray_q ;
  (* hierconn *) wire [C-1:0] \i_fifo.read_next_q ;
  (* hierconn *) wire [1:0] \i_fifo.gen_bit[0].i_written.stage_q ;
  (* hierconn *) wire [1:0] \i_fifo.gen_bit[1].i_written.stage_q ;
  (* hierconn *) wire [1:0] \i_fifo.gen_bit[2].i_written.stage_q ;
  (* hierconn *) wire [1:0] \i_fifo.gen_bit[0].i_read.stage_q ;
  (* hierconn *) wire [1:0] \i_fifo.gen_bit[1].i_read.stage_q ;
  (* hierconn *) wire [1:0] \i_fifo.gen_bit[2].i_read.stage_q ;
  (* hierconn *) wire [Width-1:0] \i_fifo.words[0] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.words[1] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.words[2] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.words[3] ;
  wire [C-1:0] written = \i_fifo.written_q ;
  wire [C-1:0] read = \i_fifo.read_q ;
  wire [5:0] written_stages = {
    \i_fifo.gen_bit[2].i_written.stage_q , \i_fifo.gen_bit[1].i_written.stage_q ,
    \i_fifo.gen_bit[0].i_written.stage_q
  };
  wire [5:0] read_stages = {
    \i_fifo.gen_bit[2].i_read.stage_q , \i_fifo.gen_bit[1].i_read.stage_q ,
    \i_fifo.gen_bit[0].i_read.stage_q
  };

  function automatic [C-1:0] binary(input [C-1:0] gray);
    binary = {gray[2], gray[2] ^ gray[1], gray[2] ^ gray[1] ^ gray[0]};
  endfunction
  // These words are the counts in the two stages of the synchronisers; the second count is older.
  wire [C-1:0] written1 = binary({written_stages[4], written_stages[2], written_stages[0]});
  wire [C-1:0] written2 = binary({written_stages[5], written_stages[3], written_stages[1]});
  wire [C-1:0] read1 = binary({read_stages[4], read_stages[2], read_stages[0]});
  wire [C-1:0] read2 = binary({read_stages[5], read_stages[3], read_stages[1]});

  // ---- the watched word: the solver chooses its index, modulo twice the number of entries ----
  (* anyconst *) reg [C-1:0] watch;
  reg [Width-1:0] watched_q;
  always @(posedge in_clk_i) begin
    if (in_valid_i && in_ready && written == watch) watched_q <= in_data_i;
  end
  wire [C-1:0] inside = written - read;
  wire [C-1:0] place = watch - read;
  wire [4*Width-1:0] words = {
    \i_fifo.words[3] , \i_fifo.words[2] , \i_fifo.words[1] , \i_fifo.words[0]
  };

  // ---- keep the counts of the previous step ----
  reg [C-1:0] written_gray_q, read_gray_q;
  reg past_valid_q = 0;
  always @($global_clock) begin
    written_gray_q <= \i_fifo.written_gray_q ;
    read_gray_q <= \i_fifo.read_gray_q ;
    past_valid_q <= started_q;
  end
  wire [C-1:0] written_change = written_gray_q ^ \i_fifo.written_gray_q ;
  wire [C-1:0] read_change = read_gray_q ^ \i_fifo.read_gray_q ;

  always @* begin
    if (rst_ni) begin
      // The word at the output is the last word that was read; its index is `read` - 1.
      in_order: assert(!out_valid || C'(read - 1) != watch || out_data == watched_q);
      room: assert(inside <= Places && (!in_ready || inside < Places));
      one_bit: assert(!past_valid_q || ((written_change & (written_change - 1)) == 0
          && (read_change & (read_change - 1)) == 0));

      inside_gray: assert(binary(\i_fifo.written_gray_q ) == written
          && binary(\i_fifo.written_next_q ) == C'(written + 1)
          && binary(\i_fifo.read_gray_q ) == read
          && binary(\i_fifo.read_next_q ) == C'(read + 1));
      // The reader never sees more words than there are, nor the writer more free entries.
      inside_written: assert(C'(written2 - read) <= C'(written1 - read)
          && C'(written1 - read) <= inside);
      inside_read: assert(C'(written - read2) <= Places - in_ready
          && C'(written - read1) <= C'(written - read2) && inside <= C'(written - read1));
      inside_words: assert(place >= inside
          || words[watch[AddressBits-1:0]*Width +: Width] == watched_q);
    end
  end

  // ---- cover statements: events that the proof must reach ----
  reg was_full_q;
  always @(posedge in_clk_i or negedge rst_ni) begin
    if (!rst_ni) was_full_q <= 0;
    else was_full_q <= was_full_q || (inside == Places && out_valid);
  end
  always @* begin
    if (rst_ni) begin
      cover_full: cover(inside == Places && out_valid && !in_ready);
      cover_drained: cover(was_full_q && inside == 0 && !out_valid);
    end
  end

endmodule
