// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reads pixels from the SDRAM: accepts requests for consecutive pixels, and outputs the pixels.
///
/// Towards the SDRAM controller, the port offers transactions and accepts words. The port offers a
/// transaction only when its buffer of 2^AddressBits pixel pairs has room for all words of the
/// transaction, so words from the memory never wait. Each pair of pixels crosses from the memory's
/// clock to the client's clock as one word. The next request is accepted after the last pixel of
/// the current request.
///
/// The latency from the words to the pixels is 2 memory clocks, then the latency of
/// `lipp_async_fifo`, then one client clock. The client clock is the delay of an output register,
/// which is needed because the FIFO's memory is slow.
module lipp_sdram_read_port
  import lipp_sdram_pkg::*;
#(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int Block = 96,       // maximum number of 16-bit words in a transaction
  parameter int AddressBits = 7,  // the FIFO holds 2^AddressBits pixel pairs
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,
  input  logic                 valid_i,
  output logic                 ready_o,
  input  logic                 buffer_i,
  input  logic [PlaceBits-1:0] first_i,  // index of the first pixel in the buffer, even
  input  logic [PlaceBits:0]   count_i,  // number of pixels of the request, even
  output logic                 pixel_valid_o,
  input  logic                 pixel_ready_i,
  output logic [23:0]          rgb_o,

  input  logic                 mem_clk_i,
  input  logic                 mem_rst_ni,
  output logic                 mem_valid_o,
  input  logic                 mem_ready_i,
  output transaction_t         mem_transaction_o,
  input  logic                 mem_word_valid_i,
  input  logic [WordBits-1:0]  mem_word_i
);

  localparam int Room = 3 << AddressBits;
  logic [PlaceBits:0] remaining_q;
  logic busy_q, take;
  logic split_valid, split_ready, split_free, pair_valid, pair_ready, rgb_valid, rgb_ready;
  transaction_t split_transaction;
  logic [47:0] pair;
  logic [23:0] rgb;

  // ---- split each request into transactions ----
  assign ready_o = !busy_q;
  assign take = pixel_valid_o && pixel_ready_i;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) busy_q <= 1'b0;
    else if (!busy_q) busy_q <= valid_i;
    else busy_q <= !(take && remaining_q == (PlaceBits + 1)'(1));
  end
  always_ff @(posedge clk_i) begin
    if (!busy_q) remaining_q <= count_i;
    else if (take) remaining_q <= remaining_q - 1'b1;
  end

  lipp_sdram_splitter #(
    .Width(Width), .Height(Height), .Block(Block), .Budget(Room), .MaxBudget(Room)
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

  // ---- convert words to pixels; with room reserved, i_join and i_pairs are always ready ----
  logic mem_pair_valid, join_ready, fifo_ready, unused_ready;
  logic [47:0] mem_pair;
  assign unused_ready = join_ready && fifo_ready;
  lipp_word_join #(.Width(WordBits), .Parts(3)) i_join (
    .clk_i(mem_clk_i), .rst_ni(mem_rst_ni), .in_valid_i(mem_word_valid_i),
    .in_ready_o(join_ready), .in_data_i(mem_word_i), .out_valid_o(mem_pair_valid),
    .out_ready_i(1'b1), .out_data_o(mem_pair)
  );
  lipp_async_fifo #(.Width(48), .AddressBits(AddressBits)) i_pairs (
    .in_clk_i(mem_clk_i), .in_rst_ni(mem_rst_ni), .in_valid_i(mem_pair_valid),
    .in_ready_o(fifo_ready), .in_data_i(mem_pair), .out_clk_i(clk_i), .out_rst_ni(rst_ni),
    .out_valid_o(pair_valid), .out_ready_i(pair_ready), .out_data_o(pair)
  );
  lipp_word_split #(.Width(24), .Parts(2)) i_split (
    .clk_i, .rst_ni, .in_valid_i(pair_valid), .in_ready_o(pair_ready), .in_data_i(pair),
    .out_valid_o(rgb_valid), .out_ready_i(rgb_ready), .out_data_o(rgb)
  );
  lipp_skid_buffer #(.Width(24)) i_buffer (
    .clk_i, .rst_ni, .clear_i(1'b0), .in_valid_i(rgb_valid), .in_ready_o(rgb_ready),
    .in_data_i(rgb), .out_valid_o(pixel_valid_o), .out_ready_i(pixel_ready_i), .out_data_o(rgb_o)
  );

endmodule

`default_nettype wire
