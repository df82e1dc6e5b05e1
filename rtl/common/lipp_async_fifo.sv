// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Transfers a stream of words between two asynchronous clocks, with valid/ready handshakes.
///
/// The FIFO stores 2^AddressBits words in its memory and one more word in its output register. A
/// word that is written into an empty FIFO is valid at the output after Stages + 1 rising edges of
/// out_clk_i. An entry that was read is free for the writer after Stages + 1 rising edges of
/// in_clk_i. With 16 or more entries, Stages = 2 and equal clock frequencies, the throughput is one
/// word per clock. Both sides must be reset together; output in_ready_o is low during reset.
///
/// Each side counts its words in Gray code, which changes one bit at a time. The synchronisers of
/// the opposite side therefore sample either the old or the new count, never another value. The
/// reader may see too few words, and the writer too few free entries, for some clocks. Neither ever
/// sees more than there are. The Gray code of the next count is computed one clock in
/// advance, so that no adder lies in the timing path from one count to the next.
module lipp_async_fifo #(
  parameter int Width = 8,
  parameter int AddressBits = 4,
  parameter int Stages = 2
) (
  input  logic             in_clk_i,
  input  logic             in_rst_ni,
  input  logic             in_valid_i,
  output logic             in_ready_o,
  input  logic [Width-1:0] in_data_i,

  input  logic             out_clk_i,
  input  logic             out_rst_ni,
  output logic             out_valid_o,
  input  logic             out_ready_i,
  output logic [Width-1:0] out_data_o
);

  if (Width < 1 || AddressBits < 2) begin : gen_illegal
    $fatal(1, "lipp_async_fifo: Width must be 1 or more and AddressBits 2 or more");
  end

  localparam int C = AddressBits + 1;  // width of a count modulo twice the number of entries

  logic [Width-1:0] words[1 << AddressBits];
  logic [C-1:0] written_q, written_gray_q, written_next_q, written_after, written_gray;
  logic [C-1:0] read_q, read_gray_q, read_next_q, read_after, read_gray;

  // ---- write words, with in_clk_i ----
  logic write, open_q;
  assign in_ready_o = open_q;
  assign write = in_valid_i && in_ready_o;
  assign written_after = written_q + C'(2);
  // The FIFO is full if the write count exceeds the read count by the number of entries. In Gray
  // code, the counts of a full FIFO differ in the two highest bits.
  logic [C-1:0] full;
  assign full = read_gray ^ (C'(3) << (AddressBits - 1));
  always_ff @(posedge in_clk_i or negedge in_rst_ni) begin
    if (!in_rst_ni) begin
      written_q <= '0;
      written_gray_q <= '0;
      written_next_q <= C'(1);
      open_q <= 1'b0;
    end else begin
      if (write) begin
        written_q <= written_q + 1'b1;
        written_gray_q <= written_next_q;
        written_next_q <= written_after ^ (written_after >> 1);
      end
      open_q <= write ? written_next_q != full : written_gray_q != full;
    end
  end
  always_ff @(posedge in_clk_i) if (write) words[written_q[AddressBits-1:0]] <= in_data_i;

  // ---- read words, with out_clk_i ----
  logic read;
  assign read = read_gray_q != written_gray && (!out_valid_o || out_ready_i);
  assign read_after = read_q + C'(2);
  always_ff @(posedge out_clk_i or negedge out_rst_ni) begin
    if (!out_rst_ni) begin
      read_q <= '0;
      read_gray_q <= '0;
      read_next_q <= C'(1);
      out_valid_o <= 1'b0;
    end else begin
      if (read) begin
        read_q <= read_q + 1'b1;
        read_gray_q <= read_next_q;
        read_next_q <= read_after ^ (read_after >> 1);
      end
      out_valid_o <= read || (out_valid_o && !out_ready_i);
    end
  end
  always_ff @(posedge out_clk_i) if (read) out_data_o <= words[read_q[AddressBits-1:0]];

  // ---- synchronise each bit of the Gray-coded counts to the other clock ----
  for (genvar k = 0; k < C; k++) begin : gen_bit
    lipp_bit_sync #(.Stages(Stages)) i_written (
      .clk_i(out_clk_i), .rst_ni(out_rst_ni), .d_i(written_gray_q[k]), .q_o(written_gray[k])
    );
    lipp_bit_sync #(.Stages(Stages)) i_read (
      .clk_i(in_clk_i), .rst_ni(in_rst_ni), .d_i(read_gray_q[k]), .q_o(read_gray[k])
    );
  end

endmodule

`default_nettype wire
