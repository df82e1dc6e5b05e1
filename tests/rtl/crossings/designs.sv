// SPDX-License-Identifier: Apache-2.0
// Designs for the check of clock crossings, each under a line that says what the check must find: of a good design the
// kinds of its crossings, of one with a planted fault a regular expression of the line about it.

// Resets of both clocks; registers of each clock, of pins that `--timed` names, and b's registers for what comes over.
`define DESIGN(name) \
  module top_``name ( \
    input logic a_clk, b_clk, rst_ni, input logic [7:0] pin, output logic [7:0] out \
  ); \
  logic a_rst_n, b_rst_n; \
  lipp_reset_sync i_a_reset (.clk_i(a_clk), .rst_ni, .rst_no(a_rst_n)); \
  lipp_reset_sync i_b_reset (.clk_i(b_clk), .rst_ni, .rst_no(b_rst_n)); \
  logic [7:0] a_q, b_q, d_q, over; \
  always_ff @(posedge a_clk) a_q <= pin; \
  always_ff @(posedge b_clk) {b_q, d_q} <= {over, pin}; \
  assign out = b_q;

`define SYNC(d) lipp_bit_sync i_sync (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(d), .q_o(over[0]));

// A row of two registers, that takes `first` and `second`, under a condition, and what is brought over.
`define ROW(condition, first, second, result) \
  (* async_reg = "true", keep = "true" *) logic [1:0] stage_q; \
  always_ff @(posedge b_clk) condition stage_q <= {second, first}; \
  assign over[0] = result;

`define FIFO(width, copies, bits) \
  logic valid; \
  logic [width - 1:0] words; \
  lipp_async_fifo #(.Width(width), .AddressBits(bits)) i_fifo ( \
    .in_clk_i(a_clk), .in_rst_ni(a_rst_n), .in_valid_i(a_q[0]), .in_ready_o(), .in_data_i({copies{a_q}}), \
    .out_clk_i(b_clk), .out_rst_ni(b_rst_n), .out_valid_o(valid), .out_ready_i(d_q[0]), .out_data_o(words) \
  ); \
  assign over = {words[6:0] ^ words[width - 1 -: 7], valid};

// good: bit
`DESIGN(bit_of_a_register)
  `SYNC(a_q[0])
endmodule

// good: bit
`DESIGN(bit_of_a_pin)
  `SYNC(pin[0])
endmodule

// good: bit
`DESIGN(three_stages)
  lipp_bit_sync #(.Stages(3)) i_sync (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(a_q[0]), .q_o(over[0]));
endmodule

// good: pulse
`DESIGN(pulse)
  lipp_pulse_sync i_pulse (
    .from_clk_i(a_clk), .from_rst_ni(a_rst_n), .from_pulse_i(a_q[0]), .from_busy_o(),
    .to_clk_i(b_clk), .to_rst_ni(b_rst_n), .to_pulse_o(over[0])
  );
endmodule

// good: Gray memory
`DESIGN(fifo)
  `FIFO(8, 1, 4)
endmodule

// good: Gray memory
`DESIGN(deep_fifo)
  `FIFO(16, 2, 6)
endmodule

// good: Gray memory
`DESIGN(fifo_of_blocks)
  `FIFO(32, 4, 9)
endmodule

// good: bit held
`DESIGN(serialiser)
  logic [1:0] pair;
  lipp_tmds_serialiser #(.Channels(1)) i_serialiser (
    .pixel_clk_i(a_clk), .pixel_rst_ni(a_rst_n), .symbol_i({a_q[1:0], a_q}), .shift_clk_i(b_clk),
    .shift_rst_ni(b_rst_n), .pair_o(pair)
  );
  assign over = {6'd0, pair};
endmodule

// fault: without a synchroniser
`DESIGN(no_synchroniser)
  assign over[0] = a_q[0];
endmodule

// fault: without a synchroniser
`DESIGN(enable_of_the_other_clock)
  logic [7:0] c_q;
  always_ff @(posedge b_clk) if (a_q[0]) c_q <= c_q + 1'b1;
  assign over = c_q;
endmodule

// fault: is read by
`DESIGN(one_register)
  `ROW(, a_q[0], stage_q[0], stage_q[0] & d_q[0])
endmodule

// fault: i_sync: logic before
`DESIGN(logic_before)
  `SYNC(a_q[0] & a_q[1])
endmodule

// fault: its register 0 is read by
`DESIGN(fan_out)
  `ROW(, a_q[0], stage_q[0], stage_q[1])
  assign over[1] = stage_q[0] ^ d_q[0];
endmodule

// fault: logic between
`DESIGN(logic_between)
  `ROW(, a_q[0], stage_q[0] ^ d_q[3], stage_q[1])
endmodule

// fault: have an enable|logic between
`DESIGN(enable_at_a_row)
  `ROW(if (d_q[1]), a_q[0], stage_q[0], stage_q[1])
endmodule

// fault: 2 clocks
`DESIGN(two_clocks_in_a_row)
  (* async_reg = "true", keep = "true" *) logic [1:0] stage_q;
  always_ff @(posedge a_clk) stage_q[0] <= d_q[0];
  always_ff @(posedge b_clk) stage_q[1] <= stage_q[0];
  assign over[0] = stage_q[1];
endmodule

// fault: 4 bits side by side
`DESIGN(bus)
  for (genvar k = 0; k < 4; k++) begin : gen_k
    lipp_bit_sync i_bit (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(a_q[k]), .q_o(over[k]));
  end
endmodule

// fault: i_one and i_two bring bits of one clock that meet
`DESIGN(bits_that_meet)
  logic one, two;
  lipp_bit_sync i_one (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(a_q[1]), .q_o(one));
  lipp_bit_sync i_two (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(a_q[2]), .q_o(two));
  assign over[0] = one ^ two;
endmodule

// fault: the written pointer changes [234] bits in one step
`DESIGN(binary_pointer)
  logic [3:0] count_q, seen;
  always_ff @(posedge a_clk or negedge a_rst_n)
    if (!a_rst_n) count_q <= '0; else if (a_q[0]) count_q <= count_q + 1'b1;
  for (genvar k = 0; k < 4; k++) begin : gen_bit
    lipp_bit_sync i_written (.clk_i(b_clk), .rst_ni(b_rst_n), .d_i(count_q[k]), .q_o(seen[k]));
  end
  assign over[3:0] = seen;
endmodule

// fault: words.* without a synchroniser
`DESIGN(memory_read_at_once)
  logic [7:0] words[16];
  always_ff @(posedge a_clk) if (a_q[0]) words[a_q[4:1]] <= a_q;
  assign over = words[d_q[3:0]];
endmodule

// fault: is reset by .*another clock
`DESIGN(reset_of_the_other_clock)
  always_ff @(posedge b_clk or negedge a_rst_n) if (!a_rst_n) over <= '0; else over <= {over, 1'b1};
endmodule

// fault: is reset by .*logic
`DESIGN(reset_by_logic)
  logic bad_n;
  assign bad_n = b_rst_n && d_q[5];
  always_ff @(posedge b_clk or negedge bad_n) if (!bad_n) over <= '0; else over <= {over, 1'b1};
endmodule

// fault: is reset by rst_ni, a pin
`DESIGN(reset_by_a_pin)
  always_ff @(posedge b_clk or negedge rst_ni) if (!rst_ni) over <= '0; else over <= {over, 1'b1};
endmodule

// fault: is made by logic
`DESIGN(clock_by_logic)
  logic gated;
  assign gated = b_clk & d_q[2];
  always_ff @(posedge gated) over <= d_q;
endmodule

// fault: without a synchroniser
`DESIGN(serialiser_without_turn)
  logic [3:0] place_q;
  logic load_q;
  logic [7:0] rest_q;
  always_ff @(posedge b_clk or negedge b_rst_n)
    if (!b_rst_n) place_q <= 4'd1; else place_q <= {place_q, place_q[3]};
  always_ff @(posedge b_clk) begin load_q <= place_q[0]; rest_q <= load_q ? a_q : {rest_q[0], rest_q[7:1]}; end
  assign over = rest_q;
endmodule
