// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Four-word FIFO; shows that a user's module `fifo` does not collide with lipp_fifo.
module fifo #(
  parameter int Bits = 8
) (
  input  logic            clk_i,
  input  logic            rst_ni,
  input  logic            push_i,
  output logic            full_o,
  input  logic [Bits-1:0] word_i,
  input  logic            pop_i,
  output logic            filled_o,
  output logic [Bits-1:0] word_o
);

  logic [Bits-1:0] words_q[4];
  logic [2:0] written_q, read_q;
  assign filled_o = written_q != read_q;
  assign full_o = written_q == {!read_q[2], read_q[1:0]};
  assign word_o = words_q[read_q[1:0]];

  always_ff @(posedge clk_i) begin
    if (push_i) words_q[written_q[1:0]] <= word_i;
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {written_q, read_q} <= '0;
    end else begin
      written_q <= written_q + 3'(push_i);
      read_q <= read_q + 3'(pop_i);
    end
  end

endmodule

`default_nettype wire
