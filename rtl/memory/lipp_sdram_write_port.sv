// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Writes pixels to the SDRAM: accepts requests for consecutive pixels, and then the pixels.
///
/// Towards the SDRAM controller, the port offers transactions and outputs words. All words of a
/// transaction cross to the memory's clock before the port offers the transaction, so the
/// controller never waits for a word. Output done_o is a pulse after the memory accepted the last
/// transaction of the request. The SDRAM executes the last transaction of a request before any
/// request accepted after done_o. The next request is accepted after done_o.
module lipp_sdram_write_port
  import lipp_sdram_pkg::*;
#(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int Block = 48,       // maximum number of 16-bit words in a transaction
  parameter int AddressBits = 5,  // the FIFO holds 2^AddressBits pixel pairs
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,
  input  logic                 valid_i,
  output logic                 ready_o,
  input  logic                 buffer_i,
  input  logic [PlaceBits-1:0] first_i,  // index of the first pixel in the buffer, even
  input  logic [PlaceBits:0]   count_i,  // number of pixels of the request, even
  input  logic                 pixel_valid_i,
  output logic                 pixel_ready_o,
  input  logic [23:0]          rgb_i,
  output logic                 done_o,

  input  logic                 mem_clk_i,
  input  logic                 mem_rst_ni,
  output logic                 mem_valid_o,
  input  logic                 mem_ready_i,
  output transaction_t         mem_transaction_o,
  input  logic                 mem_word_take_i,
  output logic [WordBits-1:0]  mem_word_o
);

  if (3 << AddressBits < Block) begin : gen_illegal
    $fatal(1, "lipp_sdram_write_port: 3 * 2^AddressBits must be Block or more");
  end

  logic [PlaceBits:0] remaining_q;
  logic busy_q, some_q, take;  // some_q: pixels of the request are still to arrive
  logic split_valid, split_ready, split_free, join_ready, pair_valid, pair_ready;
  transaction_t split_transaction;
  logic [47:0] pair;

  // ---- split each request into transactions ----
  assign ready_o = !busy_q;
  assign pixel_ready_o = some_q && join_ready;
  assign take = pixel_valid_i && pixel_ready_o;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {busy_q, some_q} <= '0;
    else if (!busy_q) {busy_q, some_q} <= {2{valid_i}};
    else begin
      busy_q <= !done_o;
      some_q <= some_q && !(take && remaining_q == (PlaceBits + 1)'(1));
    end
  end
  always_ff @(posedge clk_i) begin
    if (!busy_q) remaining_q <= count_i;
    else if (take) remaining_q <= remaining_q - 1'b1;
  end

  // A pixel pair is added to the budget after it entered the FIFO, so its words arrive before the
  // transaction that writes them.
  lipp_sdram_splitter #(
    .Width(Width), .Height(Height), .Block(Block), .Budget(0), .MaxBudget((3 << AddressBits) + 9)
  ) i_splitter (
    .clk_i, .rst_ni, .valid_i(valid_i && !busy_q), .ready_o(split_free), .buffer_i, .first_i,
    .count_i, .pair_i(pair_valid && pair_ready), .valid_o(split_valid), .ready_i(split_ready),
    .transaction_o(split_transaction)
  );
  logic unused_free;  // split_free needs no check: it is high again before busy_q falls
  assign unused_free = split_free;
  lipp_async_fifo #(.Width($bits(transaction_t)), .AddressBits(2)) i_transactions (
    .in_clk_i(clk_i), .in_rst_ni(rst_ni), .in_valid_i(split_valid), .in_ready_o(split_ready),
    .in_data_i(split_transaction), .out_clk_i(mem_clk_i), .out_rst_ni(mem_rst_ni),
    .out_valid_o(mem_valid_o), .out_ready_i(mem_ready_i), .out_data_o(mem_transaction_o)
  );
  // Two done pulses are further apart than the latency of i_done, so i_done is never busy.
  logic last_taken, done_busy, unused_busy;
  assign last_taken = mem_valid_o && mem_ready_i && mem_transaction_o.last;
  assign unused_busy = done_busy;
  lipp_pulse_sync i_done (
    .from_clk_i(mem_clk_i), .from_rst_ni(mem_rst_ni), .from_pulse_i(last_taken),
    .from_busy_o(done_busy), .to_clk_i(clk_i), .to_rst_ni(rst_ni), .to_pulse_o(done_o)
  );

  // ---- convert pixels to words ----
  logic mem_pair_valid, mem_pair_ready, next_valid, next_ready, unused_valid;
  logic [47:0] mem_pair, next_pair;
  lipp_word_join #(.Width(24), .Parts(2)) i_join (
    .clk_i, .rst_ni, .in_valid_i(pixel_valid_i && some_q), .in_ready_o(join_ready),
    .in_data_i(rgb_i), .out_valid_o(pair_valid), .out_ready_i(pair_ready), .out_data_o(pair)
  );
  lipp_async_fifo #(.Width(48), .AddressBits(AddressBits)) i_pairs (
    .in_clk_i(clk_i), .in_rst_ni(rst_ni), .in_valid_i(pair_valid), .in_ready_o(pair_ready),
    .in_data_i(pair), .out_clk_i(mem_clk_i), .out_rst_ni(mem_rst_ni),
    .out_valid_o(mem_pair_valid), .out_ready_i(mem_pair_ready), .out_data_o(mem_pair)
  );
  // This register splits the timing path from the controller to the FIFO's counters.
  lipp_skid_buffer #(.Width(48)) i_next (
    .clk_i(mem_clk_i), .rst_ni(mem_rst_ni), .clear_i(1'b0), .in_valid_i(mem_pair_valid),
    .in_ready_o(mem_pair_ready), .in_data_i(mem_pair), .out_valid_o(next_valid),
    .out_ready_i(next_ready), .out_data_o(next_pair)
  );
  lipp_word_split #(.Width(WordBits), .Parts(3)) i_split (
    .clk_i(mem_clk_i), .rst_ni(mem_rst_ni), .in_valid_i(next_valid),
    .in_ready_o(next_ready), .in_data_i(next_pair), .out_valid_o(unused_valid),
    .out_ready_i(mem_word_take_i), .out_data_o(mem_word_o)
  );

endmodule

`default_nettype wire
