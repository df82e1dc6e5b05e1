// SPDX-License-Identifier: Apache-2.0
/// Proves the assertions of fifo_checks for `lipp_fifo`, with a writer that never overfills the
/// FIFO and with any reader. The invariants below make the proof inductive.
module fifo_properties #(
  parameter int Width = 2,
  parameter int AddressBits = 2
) (
  input logic             clk_i,
  input logic             rst_ni,
  input logic             write_i,
  input logic [Width-1:0] data_i,
  input logic             ready_i,
  input logic             watch_i
);

  localparam int Room = 1 << AddressBits;
  localparam int C = AddressBits + 1;

  // These wires carry internal registers of the design: yosys flattens the hierarchy and connects
  // each wire to the register of the same name.
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.write_at_q ;
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.read_at_q ;
  (* hierconn *) wire [AddressBits:0] \i_fifo.stored_q ;
  (* hierconn *) wire [1:0] \i_fifo.reads_q ;
  (* hierconn *) wire [2:0] \i_fifo.level_q ;
  (* hierconn *) wire \i_fifo.some_q ;
  (* hierconn *) wire \i_fifo.free_q ;
  (* hierconn *) wire \i_fifo.valid_q ;
  (* hierconn *) wire [1:0] \i_fifo.fill_at_q ;
  (* hierconn *) wire [1:0] \i_fifo.drain_at_q ;
  (* hierconn *) wire [2:0] \i_fifo.ready_words_q ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[0] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[1] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[2] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[3] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.read_data ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.word_q ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.watched_word_q ;
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.i_memory.watched_at ;
  wire [AddressBits:0] stored = \i_fifo.stored_q ;
  wire [1:0] reads = \i_fifo.reads_q ;
  wire [2:0] level = \i_fifo.level_q ;
  wire [2:0] ready_words = \i_fifo.ready_words_q ;
  wire [AddressBits-1:0] read_at = \i_fifo.read_at_q ;
  wire [4*Width-1:0] places = {
    \i_fifo.place_q[3] , \i_fifo.place_q[2] , \i_fifo.place_q[1] , \i_fifo.place_q[0]
  };

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  always @* if (!started_q) assume(!rst_ni);

  logic valid;
  logic [Width-1:0] data;
  lipp_fifo #(.Width(Width), .AddressBits(AddressBits)) i_fifo (
    .clk_i, .rst_ni, .write_i, .data_i, .valid_o(valid), .ready_i, .data_o(data)
  );

  // The watched word is written to the address whose word memory_1w1r_kept stores.
  wire [C-1:0] count, ahead;
  wire [3:0] wrote;
  wire watching;
  wire [Width-1:0] watched;
  lipp_fifo_checks #(.Width(Width), .AddressBits(AddressBits), .AssumeWriter(1'b1)) i_checks (
    .clk_i, .rst_ni, .write_i, .data_i, .valid_o(valid), .ready_i, .data_o(data),
    .watch_i(watch_i && \i_fifo.write_at_q == \i_fifo.i_memory.watched_at ),
    .count_o(count), .wrote_o(wrote), .watching_o(watching), .ahead_o(ahead), .watched_o(watched)
  );

  // ---- invariants that make the proof inductive ----
  wire [C+1:0] total = stored + level;
  // position of the watched word among the words being read from the memory
  wire [C-1:0] flying = ahead - ready_words;
  wire [C-1:0] deep = ahead - level;           // position of the watched word in the memory
  wire [1:0] place = \i_fifo.drain_at_q + ahead[1:0];
  wire [AddressBits-1:0] at = read_at + deep[AddressBits-1:0];
  always @(posedge clk_i) begin
    if (rst_ni) begin
      overflow: assert(!(write_i && stored == Room));
      inside_count: assert(stored <= Room && total == count);
      inside_held: assert(level <= 4 && ready_words <= 4
          && level == ready_words + reads[0] + reads[1]);
      inside_flags: assert(\i_fifo.some_q == (stored != 0) && \i_fifo.free_q == (level < 4)
          && \i_fifo.valid_q == (ready_words != 0));
      inside_places: assert(\i_fifo.fill_at_q == \i_fifo.drain_at_q + ready_words[1:0]);
      inside_memory: assert(\i_fifo.write_at_q == read_at + stored[AddressBits-1:0]);
      // A word moves to the next stage in each clock, unless the output registers are full.
      inside_moves: assert((level > 2 || stored == wrote[0])
          && (ready_words + reads[1] > 1 || reads[0] == wrote[1])
          && (ready_words != 0 || reads[1] == wrote[2]));
      inside_recent: assert(wrote[0] <= stored && wrote[0] + wrote[1] <= stored + reads[0]
          && wrote[0] + wrote[1] + wrote[2] <= stored + reads[0] + reads[1]);
      if (watching) begin
        if (ahead < ready_words)
          inside_place: assert(places[place*Width +: Width] == watched);
        else if (ahead < level) begin
          if (flying == 0 && reads[1]) inside_read: assert(\i_fifo.read_data == watched);
          else inside_cell: assert(\i_fifo.i_memory.word_q == watched);
        end else
          inside_word: assert(at == \i_fifo.i_memory.watched_at
              && \i_fifo.i_memory.watched_word_q == watched);
      end
    end
  end

  // ---- cover statements: events that the proof must reach ----
  reg was_full_q, round_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      was_full_q <= 0;
      round_q <= 0;
    end else begin
      was_full_q <= was_full_q || count == Room;
      round_q <= round_q || (was_full_q && \i_fifo.write_at_q == 1);
    end
  end
  always @(posedge clk_i) begin
    if (rst_ni) begin
      cover_full: cover(count == Room && level == 4);
      cover_drained: cover(was_full_q && count == 0);
      cover_wrapped: cover(round_q && valid && ready_i && write_i);
      cover_watched: cover(watching && ahead == 0 && valid && ready_i && was_full_q);
    end
  end

endmodule
