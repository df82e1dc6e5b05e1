// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Stores words in a FIFO, and outputs them as a valid/ready stream.
///
/// The FIFO stores 2^AddressBits words. The writer must not write into a full FIFO. The output
/// stays valid and stable until its word is taken. The throughput is one word per clock. A word
/// that is written into an empty FIFO is valid at the output after 4 clocks.
///
/// The FIFO's memory has a read latency of two clocks. The output has 4 registers for words read
/// from the memory. A read starts only while fewer than 4 words are in the output registers or on
/// their way to them, so that each word finds a free register. Both conditions for a read (some_q,
/// free_q) are registered, because the path from the counters to the memory's address is long.
module lipp_fifo #(
  parameter int Width = 36,
  parameter int AddressBits = 9
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             write_i,  // 1: write data_i; only while not full
  input  logic [Width-1:0] data_i,
  output logic             valid_o,  // 1: data_o is the oldest word of the FIFO
  input  logic             ready_i,  // 1: data_o is taken if valid_o is 1
  output logic [Width-1:0] data_o
);

  if (Width < 1 || AddressBits < 1) begin : gen_illegal
    $fatal(1, "lipp_fifo: Width and AddressBits must be 1 or more");
  end

  logic [AddressBits-1:0] write_at_q, read_at_q;
  logic [AddressBits:0] stored_q;  // number of words in the memory whose read has not started
  logic [1:0] reads_q;             // bit k: a read was started k + 1 clocks ago
  logic [2:0] level_q, level_d;    // number of words read or being read, but not yet taken
  logic some_q, some_d;            // some_q: stored_q != 0
  logic free_q;                    // 1: level_q < 4, so a read may start
  logic ask, take, arrive;
  logic [Width-1:0] read_data;

  assign ask = some_q && free_q;
  assign some_d = write_i || stored_q[AddressBits:1] != '0 || (stored_q[0] && !ask);
  assign level_d = level_q + 3'(ask) - 3'(take);
  assign arrive = reads_q[1];
  assign take = valid_o && ready_i;

  lipp_memory_1w1r #(.Width(Width), .AddressBits(AddressBits)) i_memory (
    .clk_i, .write_i, .write_at_i(write_at_q), .write_data_i(data_i),
    .read_at_i(read_at_q), .read_data_o(read_data)
  );

  // ---- fill and empty the 4 output registers ----
  logic [Width-1:0] place_q[4];
  logic [1:0] fill_at_q, drain_at_q;
  logic [2:0] ready_words_q;
  logic valid_q;  // 1: ready_words_q != 0
  assign valid_o = valid_q;
  assign data_o = place_q[drain_at_q];

  always_ff @(posedge clk_i) begin
    if (arrive) place_q[fill_at_q] <= read_data;
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      write_at_q <= '0;
      read_at_q <= '0;
      stored_q <= '0;
      some_q <= 1'b0;
      reads_q <= '0;
      level_q <= '0;
      free_q <= 1'b1;
      fill_at_q <= '0;
      drain_at_q <= '0;
      ready_words_q <= '0;
      valid_q <= 1'b0;
    end else begin
      write_at_q <= write_at_q + AddressBits'(write_i);
      if (ask) read_at_q <= read_at_q + 1'b1;
      stored_q <= stored_q + (AddressBits + 1)'(write_i) - (AddressBits + 1)'(ask);
      some_q <= some_d;
      reads_q <= {reads_q[0], ask};
      level_q <= level_d;
      free_q <= level_d < 3'd4;
      fill_at_q <= fill_at_q + 2'(arrive);
      drain_at_q <= drain_at_q + 2'(take);
      ready_words_q <= ready_words_q + 3'(arrive) - 3'(take);
      valid_q <= arrive || ready_words_q[2:1] != '0 || (ready_words_q[0] && !take);
    end
  end

endmodule

`default_nettype wire
