// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Sends the reply to a request as bytes: first the head (status and fields), then the data words.
///
/// Input start_i starts a reply while ready_o is high. Until ready_o is high again, head_i must be
/// stable. The head is sent four bytes at a time. The builder then takes words_i words from the
/// word_* stream, at most one every six clocks, and sends each word as four bytes, the low byte
/// first. Output words_done_o pulses when the last data word is taken. The next reply can start
/// when the last bytes have been sent. The reply's first byte is valid two clocks after start_i.
module lipp_reply_builder #(
  parameter int HeadBytes = 34
) (
  input  logic                           clk_i,
  input  logic                           rst_ni,
  input  logic                           start_i,
  output logic                           ready_o,  // output of a register
  input  logic [8*HeadBytes-1:0]         head_i,
  input  logic [$clog2(HeadBytes+1)-1:0] bytes_i,  // number of bytes of the head
  input  logic [9:0]                     words_i,  // number of words after the head
  input  logic                           word_valid_i,
  output logic                           word_ready_o,  // output of a register
  input  logic [31:0]                    word_i,
  output logic                           words_done_o,

  output logic                           out_valid_o,
  input  logic                           out_ready_i,
  output logic [7:0]                     out_data_o,
  output logic                           out_last_o
);

  if (HeadBytes < 4) begin : gen_illegal
    $fatal(1, "lipp_reply_builder: HeadBytes must be 4 or more");
  end

  localparam int HeadWords = (HeadBytes + 3) / 4;
  localparam int AtBits = $clog2(HeadWords + 1);
  localparam int CountBits = $clog2(HeadBytes + 1);

  logic [9:0] remaining_q;            // number of words still to send
  logic [CountBits-1:0] head_left_q;  // bytes of the reply's head still to send
  logic busy, head_load, take, start;
  assign start = start_i && ready_o;
  assign head_load = !busy && head_left_q != '0;
  assign take = word_valid_i && word_ready_o;
  assign words_done_o = take && remaining_q == 10'd1;

  // The next four bytes of the reply's head are selected one clock before they are sent.
  logic head_ends;
  logic [AtBits-1:0] at_q;
  logic [HeadWords-1:0][31:0] head;
  logic [31:0] part_q;
  assign head = (32 * HeadWords)'(head_i);
  assign head_ends = head_left_q <= CountBits'(4);
  always_ff @(posedge clk_i) part_q <= head[at_q];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {remaining_q, head_left_q, at_q, ready_o, word_ready_o} <= '0;
    end else begin
      ready_o <= !busy && head_left_q == '0 && remaining_q == '0 && !start;
      word_ready_o <= !busy && head_left_q == '0 && remaining_q != '0 && !take;
      if (start) {remaining_q, head_left_q} <= {words_i, bytes_i};
      else if (take) remaining_q <= remaining_q - 1'b1;
      if (head_load) begin
        head_left_q <= head_ends ? '0 : head_left_q - CountBits'(4);
        at_q <= head_ends ? '0 : at_q + 1'b1;
      end
    end
  end

  lipp_reply_writer #(.Bytes(4)) i_writer (
    .clk_i, .rst_ni, .load_i(head_load || take), .bytes_i(head_load ? part_q : word_i),
    .count_i(head_load && head_ends ? head_left_q[2:0] : 3'd4),
    .last_i(head_load ? head_ends && remaining_q == '0 : remaining_q == 10'd1), .busy_o(busy),
    .valid_o(out_valid_o), .ready_i(out_ready_i), .data_o(out_data_o), .last_o(out_last_o)
  );

endmodule

`default_nettype wire
