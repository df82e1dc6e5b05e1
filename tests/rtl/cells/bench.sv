/// Benches of modules that a family's cells stand in for: each prints its ports each clock, behind its
/// name.
module bench (
  input logic clk_i
);

  mult18_bench i_mult18 (.clk_i);
  memory_1w1r_bench #(.Width(36), .AddressBits(9)) i_memory_36 (.clk_i);
  memory_1w1r_bench #(.Width(183), .AddressBits(8)) i_memory_183 (.clk_i);
  memory_1w1r_bench #(.Width(18), .AddressBits(9)) i_memory_18 (.clk_i);
  memory_1w1r_bench #(.Width(19), .AddressBits(10)) i_memory_19 (.clk_i);
  memory_1w1r_bench #(.Width(32), .AddressBits(11)) i_memory_32 (.clk_i);
  memory_1w1r_bench #(.Width(6), .AddressBits(12)) i_memory_6 (.clk_i);
  memory_1w1r_bench #(.Width(5), .AddressBits(13)) i_memory_5 (.clk_i);
  memory_1w1r_bench #(.Width(2), .AddressBits(14)) i_memory_2 (.clk_i);
  fifo_bench i_fifo (.clk_i);
  product_bench #(.Name("whole"), .Wa(18), .Wb(17), .Drop(3)) i_whole (.clk_i);
  product_bench #(.Name("both"), .Wa(27), .Wb(25), .Drop(20)) i_both (.clk_i);
  product_bench #(.Name("square"), .Wa(25), .Wb(25), .Drop(19), .Square(1'b1)) i_square (.clk_i);
  product_bench #(.Name("first"), .Wa(23), .Wb(18), .Drop(5)) i_first (.clk_i);
  product_bench #(.Name("second"), .Wa(16), .Wb(24), .Drop(6)) i_second (.clk_i);
  row_product_bench #(.Name("row_whole"), .Wa(18), .Wb(17), .Drop(3)) i_row_whole (.clk_i);
  row_product_bench #(.Name("row_both"), .Wa(28), .Wb(25), .Drop(17)) i_row_both (.clk_i);
  row_product_bench #(.Name("row_square"), .Wa(25), .Wb(25), .Drop(19), .Square(1'b1)) i_row_square (.clk_i);
  row_product_bench #(.Name("row_first"), .Wa(32), .Wb(12), .Drop(8)) i_row_first (.clk_i);
  row_product_bench #(.Name("row_second"), .Wa(16), .Wb(24), .Drop(6)) i_row_second (.clk_i);
  small_product_bench #(.Wa(17), .Drop(8)) i_small_17_8 (.clk_i);
  small_product_bench #(.Wa(17), .Drop(0)) i_small_17_0 (.clk_i);
  small_product_bench #(.Wa(16), .Drop(8)) i_small_16_8 (.clk_i);
  small_product_bench #(.Wa(9), .Drop(0)) i_small_9_0 (.clk_i);
  small_product_bench #(.Wa(3), .Drop(8)) i_small_3_8 (.clk_i);
  gated_sum_bench #(.W(1)) i_gated_1 (.clk_i);
  gated_sum_bench #(.W(19)) i_gated_19 (.clk_i);
  ring_bench #(.Width(7), .Cycles(2)) i_ring_2 (.clk_i);
  ring_bench #(.Width(50), .Cycles(9)) i_ring_9 (.clk_i);
  ring_bench #(.Width(28), .Cycles(17)) i_ring_17 (.clk_i);
  block_ring_bench #(.Width(9), .Cycles(5)) i_block_ring_5 (.clk_i);
  block_ring_bench #(.Width(24), .Cycles(18)) i_block_ring_18 (.clk_i);
  block_ring_bench #(.Width(75), .Cycles(32)) i_block_ring_32 (.clk_i);
  block_ring_bench #(.Width(1), .Cycles(65)) i_block_ring_65 (.clk_i);

endmodule

/// Random operands, extreme ones among them, into `lipp_mult18`; prints operands and product each clock.
module mult18_bench (
  input logic clk_i
);

  logic signed [17:0] a_q, b_q;
  logic signed [35:0] p;
  lipp_mult18 i_dut (.clk_i, .a_i(a_q), .b_i(b_q), .p_o(p));

  function automatic logic [17:0] operand(logic [31:0] bits);
    case (bits[31:28])
      4'd0: return 18'h20000;
      4'd1: return 18'h1ffff;
      4'd2: return 18'h3ffff;
      4'd3: return 18'h00000;
      default: return bits[17:0];
    endcase
  endfunction

  always_ff @(posedge clk_i) begin
    a_q <= operand($urandom);
    b_q <= operand($urandom);
    $display("mult18 %0d %0d %0d", a_q, b_q, p);
  end

endmodule

/// Random operands, extreme ones among them, into `lipp_wide_product`; prints operands and product.
module product_bench #(
  parameter string Name = "",
  parameter int Wa = 18,
  parameter int Wb = 18,
  parameter int Drop = 0,
  parameter bit Square = 1'b0
) (
  input logic clk_i
);

  logic signed [Wa-1:0] a_q;
  logic signed [Wb-1:0] b_q, b;
  logic signed [Wa+Wb-Drop-1:0] p;
  assign b = Square ? Wb'(a_q) : b_q;
  lipp_wide_product #(.Wa(Wa), .Wb(Wb), .Drop(Drop), .Square(Square)) i_dut (
    .clk_i, .a_i(a_q), .b_i(b), .p_o(p)
  );

  logic [63:0] noise;
  always_ff @(posedge clk_i) begin
    noise = {$urandom, $urandom};
    a_q <= noise[63] ? Wa'(noise[31:0]) : {noise[62], {(Wa - 1){noise[61]}}};
    noise = {$urandom, $urandom};
    b_q <= noise[63] ? Wb'(noise[31:0]) : {noise[62], {(Wb - 1){noise[61]}}};
    $display("%s %0d %0d %0d %0d %0d %0d", Name, Wa, Wb, Drop, a_q, b, p);
  end

endmodule

/// Random operands, extreme ones among them, into `lipp_row_multiplier`; prints operands and product.
module row_product_bench #(
  parameter string Name = "",
  parameter int Wa = 18,
  parameter int Wb = 18,
  parameter int Drop = 0,
  parameter bit Square = 1'b0
) (
  input logic clk_i
);

  logic signed [Wa-1:0] a_q;
  logic signed [Wb-1:0] b_q, b;
  logic signed [Wa+Wb-Drop-1:0] p;
  assign b = Square ? Wb'(a_q) : b_q;
  lipp_row_multiplier #(.Wa(Wa), .Wb(Wb), .Drop(Drop), .Square(Square)) i_dut (
    .clk_i, .a_i(a_q), .b_i(b), .p_o(p)
  );

  logic [63:0] noise;
  always_ff @(posedge clk_i) begin
    noise = {$urandom, $urandom};
    a_q <= noise[63] ? Wa'(noise[31:0]) : {noise[62], {(Wa - 1){noise[61]}}};
    noise = {$urandom, $urandom};
    b_q <= noise[63] ? Wb'(noise[31:0]) : {noise[62], {(Wb - 1){noise[61]}}};
    $display("%s %0d %0d %0d %0d %0d %0d", Name, Wa, Wb, Drop, a_q, b, p);
  end

endmodule

/// Random operands, extreme ones among them, into `lipp_small_product`; prints operands and product.
module small_product_bench #(
  parameter int Wa = 17,
  parameter int Drop = 0
) (
  input logic clk_i
);

  logic [Wa-1:0] a_q;
  logic [8:0] b_q;
  logic [Wa+8-Drop:0] p;
  lipp_small_product #(.Wa(Wa), .Drop(Drop)) i_dut (.clk_i, .a_i(a_q), .b_i(b_q), .p_o(p));

  logic [63:0] noise;
  always_ff @(posedge clk_i) begin
    noise = {$urandom, $urandom};
    a_q <= noise[63] || noise[62] ? Wa'(noise[31:0]) : {Wa{noise[61]}};
    b_q <= noise[60] ? noise[40:32] : noise[59] ? 9'd256 : {9{noise[58]}};
    $display("small%0d_%0d %0d %0d %0d", Wa, Drop, a_q, b_q, p);
  end

endmodule

/// Random words behind random gates, all open half of the time, into `lipp_gated_sum`; prints words, gates and sum.
module gated_sum_bench #(
  parameter int W = 1
) (
  input logic clk_i
);

  logic [W-1:0] a_q, x_q, b_q, y_q, s;
  lipp_gated_sum #(.W(W)) i_dut (.a_i(a_q), .x_i(x_q), .b_i(b_q), .y_i(y_q), .s_o(s));

  always_ff @(posedge clk_i) begin
    a_q <= W'($urandom);
    b_q <= W'($urandom);
    x_q <= W'($urandom) | {W{1'($urandom)}};
    y_q <= W'($urandom) | {W{1'($urandom)}};
    $display("gated%0d %0d %0d %0d %0d %0d", W, a_q, x_q, b_q, y_q, s);
  end

endmodule

/// Random words into `lipp_ring`; prints what goes in and what comes out.
module ring_bench #(
  parameter int Width = 1,
  parameter int Cycles = 2
) (
  input logic clk_i
);

  logic [Width-1:0] d_q, q;
  lipp_ring #(.Width(Width), .Cycles(Cycles)) i_dut (.clk_i, .d_i(d_q), .q_o(q));

  always_ff @(posedge clk_i) begin
    d_q <= Width'({$urandom, $urandom, $urandom});
    $display("ring%0d %0h %0h", Cycles, d_q, q);
  end

endmodule

/// Random words into `lipp_block_ring`; prints what goes in and what comes out.
module block_ring_bench #(
  parameter int Width = 1,
  parameter int Cycles = 5
) (
  input logic clk_i
);

  logic [Width-1:0] d_q, q;
  lipp_block_ring #(.Width(Width), .Cycles(Cycles)) i_dut (.clk_i, .d_i(d_q), .q_o(q));

  always_ff @(posedge clk_i) begin
    d_q <= Width'({$urandom, $urandom, $urandom});
    $display("block_ring%0d %0h %0h", Cycles, d_q, q);
  end

endmodule

/// Random writes and reads of `lipp_memory_1w1r`; prints its ports each clock.
module memory_1w1r_bench #(
  parameter int Width = 36,
  parameter int AddressBits = 9
) (
  input logic clk_i
);

  logic write_q;
  logic [AddressBits-1:0] write_at_q, read_at_q;
  logic [Width-1:0] data_q, out;
  lipp_memory_1w1r #(.Width(Width), .AddressBits(AddressBits)) i_dut (
    .clk_i, .write_i(write_q), .write_at_i(write_at_q), .write_data_i(data_q),
    .read_at_i(read_at_q), .read_data_o(out)
  );

  logic [223:0] noise;
  always_ff @(posedge clk_i) begin
    noise = {$urandom, $urandom, $urandom, $urandom, $urandom, $urandom, $urandom};
    write_q <= noise[223];
    // Half of the addresses are the outermost ones: first, last, all but one bit.
    write_at_q <= noise[222] ? noise[221-:AddressBits] : {AddressBits{noise[210]}};
    data_q <= Width'(noise[191:0]);
    read_at_q <= noise[209] ? noise[208-:AddressBits] : {AddressBits{noise[194]}};
    $display("memory_1w1r%0d %0d %0d %0h %0d %0h", Width, write_q, write_at_q, data_q, read_at_q, out);
  end

endmodule

/// Random traffic through `lipp_fifo`, full and empty included; prints what goes in and what comes out.
module fifo_bench #(
  parameter int Width = 24,
  parameter int AddressBits = 4
) (
  input logic clk_i
);

  localparam int Room = 1 << AddressBits;

  logic [2:0] reset_q = '0;
  logic write, valid, ready_q, busy_q;
  logic [Width-1:0] data_q, out;
  int inside_q = 0;
  lipp_fifo #(.Width(Width), .AddressBits(AddressBits)) i_dut (
    .clk_i, .rst_ni(reset_q[2]), .write_i(write), .data_i(data_q),
    .valid_o(valid), .ready_i(ready_q), .data_o(out)
  );
  assign write = reset_q[2] && busy_q && inside_q < Room;

  logic [223:0] noise;
  int clock_q = 0;
  always_ff @(posedge clk_i) begin
    noise = {$urandom, $urandom, $urandom, $urandom, $urandom, $urandom, $urandom};
    reset_q <= {reset_q[1:0], 1'b1};
    clock_q <= clock_q + 1;
    // By turns more comes in, or more goes out.
    busy_q <= clock_q[8] ? noise[223] || noise[222] : noise[223] && noise[222];
    ready_q <= clock_q[8] ? noise[221] && noise[220] : noise[221] || noise[220];
    data_q <= Width'(noise[191:0]);
    inside_q <= inside_q + int'(write) - int'(valid && ready_q);
    $display("fifo %0d %0h %0d %0h %0d", write, data_q, valid && ready_q && reset_q[2], out, inside_q);
  end

endmodule
