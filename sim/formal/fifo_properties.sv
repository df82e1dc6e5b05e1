/// The contract of `fifo` towards its reader, and the invariants that prove it.
///
/// The properties use the ports and the registers of `fifo`. One word is watched: watch_i selects
/// the word that is written in that clock. The solver chooses freely, so that what holds for this
/// word holds for every word.
module fifo_properties #(
  parameter int Width = 2,
  parameter int AddressBits = 2,
  parameter bit Assume = 1'b0  // 1: the writer's obligation is assumed, 0: proved
) (
  input logic                             clk_i,
  input logic                             rst_ni,
  input logic                             write_i,
  input logic [Width-1:0]                 data_i,
  input logic                             valid_i,
  input logic                             ready_i,
  input logic [Width-1:0]                 out_i,
  input logic                             watch_i,
  // the FIFO's registers
  input logic [AddressBits-1:0]           write_at_i,
  input logic [AddressBits-1:0]           read_at_i,
  input logic [AddressBits:0]             stored_i,
  input logic [1:0]                       asked_i,
  input logic [2:0]                       held_i,
  input logic                             some_i,
  input logic                             free_i,
  input logic [1:0]                       put_i,
  input logic [1:0]                       get_i,
  input logic [2:0]                       ready_words_i,
  input logic [4*Width-1:0]               place_i,
  input logic [Width-1:0]                 word_i,
  input logic [Width-1:0]                 read_data_i,
  input logic [(Width<<AddressBits)-1:0]  words_i,
  // for proofs that use this one
  output logic [AddressBits:0]            count_o,
  output logic                            watching_o,
  output logic [AddressBits:0]            ahead_o,
  output logic [Width-1:0]                watched_o,
  output logic [2:0]                      waits_o
);

  localparam int Room = 1 << AddressBits;
  localparam int C = AddressBits + 1;

  wire take = valid_i && ready_i;

  // ---- words written and not yet taken ----
  reg [C-1:0] count_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) count_q <= 0;
    else count_q <= count_q + write_i - take;
  end
  assign count_o = count_q;

  // ---- the writer's obligation: never overfill ----
  always @(posedge clk_i) begin
    if (rst_ni && write_i) begin
      if (Assume) assume(count_q < Room);
      else promise: assert(count_q < Room);
    end
  end

  // ---- the watched word, and the number of words ahead of it ----
  reg watching_q;
  reg [C-1:0] ahead_q;
  reg [Width-1:0] watched_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) watching_q <= 0;
    else if (write_i && watch_i && !watching_q) watching_q <= 1;
    else if (take && ahead_q == 0) watching_q <= 0;
  end
  always @(posedge clk_i) begin
    if (write_i && watch_i && !watching_q) begin
      ahead_q <= count_q - take;
      watched_q <= data_i;
    end else begin
      ahead_q <= ahead_q - take;
    end
  end
  assign watching_o = watching_q;
  assign ahead_o = ahead_q;
  assign watched_o = watched_q;

  // ---- values one clock ago ----
  reg stalled_q;
  reg [Width-1:0] out_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) stalled_q <= 0;
    else stalled_q <= valid_i && !ready_i;
  end
  always @(posedge clk_i) out_q <= out_i;

  // ---- events some clocks ago ----
  reg [3:0] first_q;   // a word was written into the empty FIFO
  reg [2:0] waits_q;   // a word was in the memory
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      first_q <= 0;
      waits_q <= 0;
    end else begin
      first_q <= {first_q[2:0], write_i && count_q == 0};
      waits_q <= {waits_q[1:0], stored_i != 0};
    end
  end
  assign waits_o = waits_q;

  // ---- the contract ----
  always @(posedge clk_i) begin
    if (rst_ni) begin
      held_valid: assert(!stalled_q || valid_i);
      stable_data: assert(!stalled_q || out_i == out_q);
      out_of_nothing: assert(!valid_i || count_q != 0);
      // The word written as the n-th is taken as the n-th, with the same bits.
      in_order: assert(!(watching_q && ahead_q == 0 && valid_i) || out_i == watched_q);
      none_lost: assert(!watching_q || ahead_q < count_q);
      overflow: assert(!(write_i && stored_i == Room));
      four_clocks: assert(!first_q[3] || valid_i);
      not_before: assert(first_q[2:0] == 0 || !valid_i);
      no_bubble: assert(!waits_q[2] || valid_i);
    end
  end

  // ---- invariants that make the contract inductive ----
  wire [C+1:0] total = stored_i + held_i;
  wire [C-1:0] flying = ahead_q - ready_words_i;   // among the words on the way
  wire [C-1:0] deep = ahead_q - held_i;            // among those in the memory
  wire [1:0] place = get_i + ahead_q[1:0];
  wire [AddressBits-1:0] at = read_at_i + deep[AddressBits-1:0];
  always @(posedge clk_i) begin
    if (rst_ni) begin
      inside_count: assert(stored_i <= Room && total == count_q && count_q <= Room);
      inside_held: assert(held_i <= 4 && ready_words_i <= 4
          && held_i == ready_words_i + asked_i[0] + asked_i[1]);
      inside_flags: assert(some_i == (stored_i != 0) && free_i == (held_i < 4));
      inside_places: assert(put_i == get_i + ready_words_i[1:0]);
      inside_memory: assert(write_at_i == read_at_i + stored_i[AddressBits-1:0]);
      inside_first: assert((first_q[0] == 0 || (stored_i == 1 && held_i == 0))
          && (first_q[1] == 0 || (held_i == 1 && asked_i == 1))
          && (first_q[2] == 0 || asked_i[1]));
      inside_waits: assert((!waits_q[0] || asked_i[0] || held_i >= 3)
          && (!waits_q[1] || asked_i[1] || ready_words_i >= 2));
      // The memory empties as fast as it is filled, unless the places at the output are taken.
      inside_stored: assert((waits_q[0] || stored_i <= 1)
          && (waits_q[1] || stored_i <= 1 || (stored_i <= 2 && held_i >= 3))
          && (waits_q[2] || stored_i <= 1 || (stored_i <= 3 && ready_words_i >= 1)));
      if (watching_q) begin
        if (ahead_q < ready_words_i)
          inside_place: assert(place_i[place*Width +: Width] == watched_q);
        else if (ahead_q < held_i) begin
          if (flying == 0 && asked_i[1]) inside_read: assert(read_data_i == watched_q);
          else inside_cell: assert(word_i == watched_q);
        end else inside_word: assert(words_i[at*Width +: Width] == watched_q);
      end
    end
  end

  // ---- covers ----
  if (Assume) begin : gen_cover
    reg was_full_q, round_q;
    always @(posedge clk_i or negedge rst_ni) begin
      if (!rst_ni) begin
        was_full_q <= 0;
        round_q <= 0;
      end else begin
        was_full_q <= was_full_q || count_q == Room;
        round_q <= round_q || (was_full_q && write_at_i == 1);
      end
    end
    always @(posedge clk_i) begin
      if (rst_ni) begin
        cover_full: cover(count_q == Room && held_i == 4);
        cover_drained: cover(was_full_q && count_q == 0);
        cover_wrapped: cover(round_q && take && write_i);
        cover_watched: cover(watching_q && ahead_q == 0 && take && was_full_q);
      end
    end
  end

endmodule
