// SPDX-License-Identifier: Apache-2.0
/// Proves that `lipp_sdram_arbiter` keeps its priorities and loses no transaction, with clients
/// that keep their transactions stable and a memory that accepts a transaction at any time.
///
/// The transactions of each client are numbered, and the other bits are arbitrary. The numbers at
/// the output therefore show if a transaction was lost, duplicated or exchanged.
module sdram_arbiter_properties
  import lipp_sdram_pkg::*;
(
  input logic       clk_i,
  input logic       rst_ni,
  input logic [2:0] valid_i,  // one bit per client: show, write, read
  input logic [2:0][$bits(transaction_t)-13:0] payload_i,
  input logic       ready_i
);

  logic started_q = 0;
  always_ff @(posedge clk_i) started_q <= 1;
  always_comb if (!started_q) assume(!rst_ni);

  // ---- model the clients: a transaction's highest bits are its number and its client ----
  logic [2:0] accepted, valid_q;
  logic [2:0][9:0] number_q;
  logic [2:0] ready;
  transaction_t [2:0] offered;
  transaction_t out;
  logic valid, is_write, is_show;
  always_comb begin
    for (int k = 0; k < 3; k++) offered[k] = transaction_t'({number_q[k], 2'(k), payload_i[k]});
  end
  assign accepted = valid_i & ready;
  lipp_sdram_arbiter i_dut (
    .clk_i, .rst_ni, .show_valid_i(valid_i[0]), .show_ready_o(ready[0]), .show_i(offered[0]),
    .write_valid_i(valid_i[1]), .write_ready_o(ready[1]), .write_i(offered[1]),
    .read_valid_i(valid_i[2]), .read_ready_o(ready[2]), .read_i(offered[2]), .valid_o(valid),
    .ready_i, .transaction_o(out), .write_o(is_write), .show_o(is_show)
  );
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {valid_q, number_q} <= '0;
    else begin
      valid_q <= valid_i & ~accepted;
      for (int k = 0; k < 3; k++) number_q[k] <= number_q[k] + 10'(accepted[k]);
    end
  end
  always_comb if (rst_ni) assume((valid_i & valid_q) == valid_q);

  // ---- prove that the numbers of each client's transactions are in order ----
  logic [2:0][9:0] got_q;
  logic [1:0] client;
  assign client = is_show ? 2'd0 : is_write ? 2'd1 : 2'd2;
  // number of transactions of other clients while client k waits
  logic [1:0] show_waited_q, write_waited_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      got_q <= '0;
      {show_waited_q, write_waited_q} <= '0;
    end else if (valid && ready_i) begin
      got_q[client] <= got_q[client] + 1'b1;
      show_waited_q <= valid_i[0] && !accepted[0] ? show_waited_q + 1'b1 : '0;
      write_waited_q <= valid_i[1] && !accepted[1] ? write_waited_q + 1'b1 : '0;
    end
  end

  always_ff @(posedge clk_i) begin
    if (rst_ni && started_q) begin
      whose: assert(!valid || out == offered[client]);
      in_order: assert(got_q == number_q);
      one: assert(accepted == (valid && ready_i ? 3'(1 << client) : 3'd0));
      goes_on: assert(valid == (valid_i != '0));
      show_first: assert(show_waited_q <= 1);
      write_second: assert(write_waited_q <= 1);
      read_third: assert(!(ready_i && valid_i == 3'b100) || accepted[2]);
      inside_show: assert(show_waited_q == 0 || !i_dut.show_served_q);
      inside_write: assert(write_waited_q == 0 || i_dut.show_served_q);
    end
  end

  // ---- cover statements: events that the proof must reach ----
  always_ff @(posedge clk_i) begin
    if (rst_ni && started_q) begin
      cover_turns: cover(number_q[0] == 3 && number_q[1] == 2 && valid_q[2]);
      cover_all: cover(number_q[0] == 1 && number_q[1] == 1 && number_q[2] == 2);
      cover_waits: cover(show_waited_q == 1 && valid_q[1]);
    end
  end

endmodule
