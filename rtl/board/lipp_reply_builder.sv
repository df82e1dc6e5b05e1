// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Builds the reply to a request: its head, and the words that follow.
///
/// start_i begins while ready_o is high; head_i and bytes_i are read in the clock after it. words_i
/// words are then taken from the stream, each as four bytes, the low one first; words_done_o is a
/// pulse with the last. The next start waits until the last bytes have been sent.
module lipp_reply_builder #(
  parameter int HeadBytes = 34
) (
  input  logic                           clk_i,
  input  logic                           rst_ni,
  input  logic                           start_i,
  output logic                           ready_o,
  input  logic [8*HeadBytes-1:0]         head_i,
  input  logic [$clog2(HeadBytes+1)-1:0] bytes_i,       // of the head
  input  logic [9:0]                     words_i,
  input  logic                           word_valid_i,
  output logic                           word_ready_o,
  input  logic [31:0]                    word_i,
  output logic                           words_done_o,

  output logic                           out_valid_o,
  input  logic                           out_ready_i,
  output logic [7:0]                     out_data_o,
  output logic                           out_last_o
);

  logic [9:0] left_q;  // words
  logic busy, take, start, head_waits_q;
  assign ready_o = !busy && !head_waits_q && left_q == '0;
  assign start = start_i && ready_o;
  assign word_ready_o = !busy && !head_waits_q && left_q != '0;
  assign take = word_valid_i && word_ready_o;
  assign words_done_o = take && left_q == 10'd1;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      left_q <= '0;
      head_waits_q <= 1'b0;
    end else begin
      head_waits_q <= start;
      if (start) left_q <= words_i;
      else if (take) left_q <= left_q - 1'b1;
    end
  end

  // A word is the low four bytes; the others are not sent, and need no choice.
  logic [8*HeadBytes-1:0] bytes;
  always_comb begin
    bytes = head_i;
    if (!head_waits_q) bytes[31:0] = word_i;
  end
  lipp_reply_writer #(.Bytes(HeadBytes)) i_writer (
    .clk_i, .rst_ni, .load_i(head_waits_q || take),
    .bytes_i(bytes),
    .count_i(head_waits_q ? bytes_i : ($clog2(HeadBytes + 1))'(4)),
    .last_i(left_q == (head_waits_q ? '0 : 10'd1)), .busy_o(busy),
    .valid_o(out_valid_o), .ready_i(out_ready_i), .data_o(out_data_o), .last_o(out_last_o)
  );

endmodule

`default_nettype wire
