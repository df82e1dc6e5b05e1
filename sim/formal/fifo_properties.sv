// SPDX-License-Identifier: Apache-2.0
/// `lipp_fifo` with a writer that never overfills it, and any reader: the contract of fifo_checks, and
/// the invariants that make it inductive.
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

  // Internal registers: flattening connects these wires to those of the same name.
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.write_at_q ;
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.read_at_q ;
  (* hierconn *) wire [AddressBits:0] \i_fifo.stored_q ;
  (* hierconn *) wire [1:0] \i_fifo.asked_q ;
  (* hierconn *) wire [2:0] \i_fifo.held_q ;
  (* hierconn *) wire \i_fifo.some_q ;
  (* hierconn *) wire \i_fifo.free_q ;
  (* hierconn *) wire \i_fifo.valid_q ;
  (* hierconn *) wire [1:0] \i_fifo.put_q ;
  (* hierconn *) wire [1:0] \i_fifo.get_q ;
  (* hierconn *) wire [2:0] \i_fifo.ready_words_q ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[0] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[1] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[2] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[3] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.read_data ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.word_q ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.kept_q ;
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.i_memory.kept_at ;
  wire [AddressBits:0] stored = \i_fifo.stored_q ;
  wire [1:0] asked = \i_fifo.asked_q ;
  wire [2:0] held = \i_fifo.held_q ;
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

  // The watched word is one that is written to the address that the memory keeps.
  wire [C-1:0] count, ahead;
  wire [3:0] wrote;
  wire watching;
  wire [Width-1:0] watched;
  lipp_fifo_checks #(.Width(Width), .AddressBits(AddressBits), .AssumeWriter(1'b1)) i_checks (
    .clk_i, .rst_ni, .write_i, .data_i, .valid_o(valid), .ready_i, .data_o(data),
    .watch_i(watch_i && \i_fifo.write_at_q == \i_fifo.i_memory.kept_at ),
    .count_o(count), .wrote_o(wrote), .watching_o(watching), .ahead_o(ahead), .watched_o(watched)
  );

  // ---- invariants ----
  wire [C+1:0] total = stored + held;
  wire [C-1:0] flying = ahead - ready_words;  // among the words on the way
  wire [C-1:0] deep = ahead - held;           // among those in the memory
  wire [1:0] place = \i_fifo.get_q + ahead[1:0];
  wire [AddressBits-1:0] at = read_at + deep[AddressBits-1:0];
  always @(posedge clk_i) begin
    if (rst_ni) begin
      overflow: assert(!(write_i && stored == Room));
      inside_count: assert(stored <= Room && total == count);
      inside_held: assert(held <= 4 && ready_words <= 4
          && held == ready_words + asked[0] + asked[1]);
      inside_flags: assert(\i_fifo.some_q == (stored != 0) && \i_fifo.free_q == (held < 4)
          && \i_fifo.valid_q == (ready_words != 0));
      inside_places: assert(\i_fifo.put_q == \i_fifo.get_q + ready_words[1:0]);
      inside_memory: assert(\i_fifo.write_at_q == read_at + stored[AddressBits-1:0]);
      // A word moves on each clock, unless the places at the output are taken.
      inside_moves: assert((held > 2 || stored == wrote[0])
          && (ready_words + asked[1] > 1 || asked[0] == wrote[1])
          && (ready_words != 0 || asked[1] == wrote[2]));
      inside_recent: assert(wrote[0] <= stored && wrote[0] + wrote[1] <= stored + asked[0]
          && wrote[0] + wrote[1] + wrote[2] <= stored + asked[0] + asked[1]);
      if (watching) begin
        if (ahead < ready_words)
          inside_place: assert(places[place*Width +: Width] == watched);
        else if (ahead < held) begin
          if (flying == 0 && asked[1]) inside_read: assert(\i_fifo.read_data == watched);
          else inside_cell: assert(\i_fifo.i_memory.word_q == watched);
        end else
          inside_word: assert(at == \i_fifo.i_memory.kept_at
              && \i_fifo.i_memory.kept_q == watched);
      end
    end
  end

  // ---- covers ----
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
      cover_full: cover(count == Room && held == 4);
      cover_drained: cover(was_full_q && count == 0);
      cover_wrapped: cover(round_q && valid && ready_i && write_i);
      cover_watched: cover(watching && ahead == 0 && valid && ready_i && was_full_q);
    end
  end

endmodule
