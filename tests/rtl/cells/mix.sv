// SPDX-License-Identifier: Apache-2.0
// A design of every cell that is written: tables, choosers, carries, registers of every kind, memory of tables.
module mix (input logic clk_i, rst_ni, input logic [31:0] in_i, output logic [31:0] out_o);
  logic [31:0] in_q, sum_q, chosen_q, set_q, kept_q, word_q;
  logic [11:0] async_q, async_set_q, async_kept_q;
  logic [31:0] words[16];
  always_ff @(posedge clk_i) begin
    in_q <= in_i;
    sum_q <= in_q + {in_i[15:0], in_i[31:16]} - kept_q;
    for (int k = 0; k < 8; k++) chosen_q[4*k+:4] <= {4{in_q[(in_i[7:3] + 5'(k))]}} ^ in_i[4*k+:4];
    if (in_i[0]) kept_q <= sum_q ^ (sum_q < in_q ? chosen_q : word_q);
    if (in_i[1]) set_q <= '1; else if (!in_i[2]) set_q <= {set_q[30:0], sum_q[31]};
    if (in_i[3]) words[in_i[7:4]] <= sum_q;
    word_q <= words[in_i[11:8]];
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {async_q, async_set_q, async_kept_q} <= {12'd0, 12'hfff, 12'h0f5};
    else begin
      async_q <= async_q * 12'd5 + in_i[11:0];
      async_set_q <= async_set_q ^ in_q[11:0];
      if (!in_i[12]) async_kept_q <= async_kept_q + 12'(in_i[4:0] == in_q[4:0]);
    end
  end
  assign out_o = sum_q ^ chosen_q ^ set_q ^ kept_q ^ word_q
      ^ 32'(async_q) ^ {async_set_q, 20'd0} ^ {async_kept_q, 8'd0};
endmodule
