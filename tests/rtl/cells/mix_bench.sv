// SPDX-License-Identifier: Apache-2.0
// Both netlists side by side; the reset comes now and again, at any time between clocks.
module bench (input logic clk_i);
  logic [31:0] in_q, one, other, faulty;
  logic [9:0] count_q = '0;
  logic rst_n;
  always_ff @(posedge clk_i) begin
    count_q <= count_q + 1'b1;
    in_q <= $urandom();
    if (count_q > 10'd20 && one != other) $display("differ %08x %08x", one, other);
    if (count_q > 10'd20 && one != faulty) $display("fault seen");
  end
  assign rst_n = !(count_q inside {[3:9], [500:503], 700}) && !(in_q[31:26] == 6'd9);
  mix i_one (.clk_i, .rst_ni(rst_n), .in_i(in_q), .out_o(one));
  lean i_other (.clk_i, .rst_ni(rst_n), .in_i(in_q), .out_o(other));
  faulty i_faulty (.clk_i, .rst_ni(rst_n), .in_i(in_q), .out_o(faulty));
endmodule
