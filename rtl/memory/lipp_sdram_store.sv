// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Stores frames in two pixel buffers in an SDR SDRAM.
///
/// Three clients use the frame store through the ports show_*, read_* and write_*. Clients show and
/// read fetch pixels, and client write stores pixels. A client's request has a valid/ready
/// handshake. The request selects a buffer, the index of its first pixel, and a number of pixels,
/// both even. The pixels follow as a stream, row by row, with red in bits 23:16, green in 15:8 and
/// blue in 7:0. The next request of a client is accepted after the last pixel of its current
/// request. For client write, the next request is accepted after the pulse write_done_o. A read
/// request accepted after write_done_o returns the written pixels. All requests wait until the
/// SDRAM is initialised.
///
/// Two pixels R G B and R' G' B' are stored as three words: {R, G}, {B, R'}, {G', B'}. Each buffer
/// begins at the start of a row. A pixel read while it is written may be half old, half new.
///
/// Client show has priority: it waits for at most one transaction of another client and one refresh
/// (`lipp_sdram_arbiter`). A transaction of client write has at most WriteBlock words, a
/// transaction of client read at most ReadBlock words. Client show reads ahead while its line
/// buffer of 2^ShowBits pixel pairs has room.
///
/// Input mem_clk_i has the frequency MemoryHz and is asynchronous to clk_i. Input rst_ni cancels
/// all requests and all pixels in transit, and starts the initialisation of the SDRAM again, which
/// may lose its contents. `lipp_sdram_controller` describes the SDRAM's pins.
module lipp_sdram_store
  import lipp_sdram_pkg::*;
#(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int MemoryHz = 125_000_000,
  parameter timing_t Timing = Grade75,
  parameter int PadClocks = 0,
  parameter int ShowBlock = 384,
  parameter int WriteBlock = 48,
  parameter int ReadBlock = 96,
  parameter int ShowBits = 10,
  parameter int WriteBits = 5,
  parameter int ReadBits = 7,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,

  input  logic                 show_valid_i,
  output logic                 show_ready_o,
  input  logic                 show_buffer_i,
  input  logic [PlaceBits-1:0] show_first_i,
  input  logic [PlaceBits:0]   show_count_i,
  output logic                 show_pixel_valid_o,
  input  logic                 show_pixel_ready_i,
  output logic [23:0]          show_rgb_o,

  input  logic                 write_valid_i,
  output logic                 write_ready_o,
  input  logic                 write_buffer_i,
  input  logic [PlaceBits-1:0] write_first_i,
  input  logic [PlaceBits:0]   write_count_i,
  input  logic                 write_pixel_valid_i,
  output logic                 write_pixel_ready_o,
  input  logic [23:0]          write_rgb_i,
  output logic                 write_done_o,

  input  logic                 read_valid_i,
  output logic                 read_ready_o,
  input  logic                 read_buffer_i,
  input  logic [PlaceBits-1:0] read_first_i,
  input  logic [PlaceBits:0]   read_count_i,
  output logic                 read_pixel_valid_o,
  input  logic                 read_pixel_ready_i,
  output logic [23:0]          read_rgb_o,

  input  logic                 mem_clk_i,
  output logic                 cke_o,
  output logic                 cs_no,
  output logic                 ras_no,
  output logic                 cas_no,
  output logic                 we_no,
  output logic [BankBits-1:0]  ba_o,
  output logic [RowBits-1:0]   a_o,
  output logic [1:0]           dqm_o,
  output logic [WordBits-1:0]  dq_o,
  output logic                 dq_oe_o,
  input  logic [WordBits-1:0]  dq_i
);

  logic mem_rst_n;
  lipp_reset_sync i_reset (.clk_i(mem_clk_i), .rst_ni, .rst_no(mem_rst_n));

  // ---- split the requests of the three clients into transactions ----
  logic show_valid, show_ready, write_valid, write_ready, read_valid, read_ready;
  transaction_t show_transaction, write_transaction, read_transaction;
  logic word_valid, word_show, word_take;
  logic [WordBits-1:0] read_word, write_word;

  lipp_sdram_read_port #(
    .Width(Width), .Height(Height), .Block(ShowBlock), .AddressBits(ShowBits)
  ) i_show (
    .clk_i, .rst_ni, .valid_i(show_valid_i), .ready_o(show_ready_o), .buffer_i(show_buffer_i),
    .first_i(show_first_i), .count_i(show_count_i), .pixel_valid_o(show_pixel_valid_o),
    .pixel_ready_i(show_pixel_ready_i), .rgb_o(show_rgb_o), .mem_clk_i, .mem_rst_ni(mem_rst_n),
    .mem_valid_o(show_valid), .mem_ready_i(show_ready), .mem_transaction_o(show_transaction),
    .mem_word_valid_i(word_valid && word_show), .mem_word_i(read_word)
  );
  lipp_sdram_write_port #(
    .Width(Width), .Height(Height), .Block(WriteBlock), .AddressBits(WriteBits)
  ) i_write (
    .clk_i, .rst_ni, .valid_i(write_valid_i), .ready_o(write_ready_o), .buffer_i(write_buffer_i),
    .first_i(write_first_i), .count_i(write_count_i), .pixel_valid_i(write_pixel_valid_i),
    .pixel_ready_o(write_pixel_ready_o), .rgb_i(write_rgb_i), .done_o(write_done_o), .mem_clk_i,
    .mem_rst_ni(mem_rst_n), .mem_valid_o(write_valid), .mem_ready_i(write_ready),
    .mem_transaction_o(write_transaction), .mem_word_take_i(word_take), .mem_word_o(write_word)
  );
  lipp_sdram_read_port #(
    .Width(Width), .Height(Height), .Block(ReadBlock), .AddressBits(ReadBits)
  ) i_read (
    .clk_i, .rst_ni, .valid_i(read_valid_i), .ready_o(read_ready_o), .buffer_i(read_buffer_i),
    .first_i(read_first_i), .count_i(read_count_i), .pixel_valid_o(read_pixel_valid_o),
    .pixel_ready_i(read_pixel_ready_i), .rgb_o(read_rgb_o), .mem_clk_i, .mem_rst_ni(mem_rst_n),
    .mem_valid_o(read_valid), .mem_ready_i(read_ready), .mem_transaction_o(read_transaction),
    .mem_word_valid_i(word_valid && !word_show), .mem_word_i(read_word)
  );

  // ---- arbitrate between the clients, and control the SDRAM ----
  logic valid, ready, is_write, is_show;
  transaction_t transaction;
  lipp_sdram_arbiter i_arbiter (
    .clk_i(mem_clk_i), .rst_ni(mem_rst_n), .show_valid_i(show_valid), .show_ready_o(show_ready),
    .show_i(show_transaction), .write_valid_i(write_valid), .write_ready_o(write_ready),
    .write_i(write_transaction), .read_valid_i(read_valid), .read_ready_o(read_ready),
    .read_i(read_transaction), .valid_o(valid), .ready_i(ready), .transaction_o(transaction),
    .write_o(is_write), .show_o(is_show)
  );
  lipp_sdram_controller #(
    .ClockHz(MemoryHz), .Timing(Timing), .PadClocks(PadClocks)
  ) i_controller (
    .clk_i(mem_clk_i), .rst_ni(mem_rst_n), .valid_i(valid), .ready_o(ready), .write_i(is_write),
    .tag_i(is_show), .transaction_i(transaction), .write_take_o(word_take),
    .write_word_i(write_word), .read_valid_o(word_valid), .read_tag_o(word_show),
    .read_word_o(read_word), .cke_o, .cs_no, .ras_no, .cas_no, .we_no, .ba_o, .a_o, .dqm_o, .dq_o,
    .dq_oe_o, .dq_i
  );

endmodule

`default_nettype wire
