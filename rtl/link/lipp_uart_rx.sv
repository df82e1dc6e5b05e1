// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Receives bytes from an asynchronous serial line with 8 data bits, no parity and one stop bit.
///
/// Input step_i is 2^16 times the baud rate divided by the clock frequency. The maximum of step_i
/// is 2^13, which is 8 clocks per bit. Each bit is the majority of three samples, at 3/8, 4/8 and
/// 5/8 of the bit time, accurate to half a clock. Therefore a spike shorter than 1/8 bit is
/// ignored, and a start bit shorter than half a bit counts as noise. A byte is at the output at 6/8
/// of its stop bit. After 6/8 of a stop bit, the next start bit is accepted, so a sender that is 2
/// % too fast or too slow is tolerated.
///
/// Output framing_error_o pulses if the stop bit was low: the byte is lost, and the line must go
/// high before the next byte. Output overflow_o pulses if a byte arrived before the previous byte
/// was taken: the new byte is lost.
module lipp_uart_rx (
  input  logic        clk_i,
  input  logic        rst_ni,
  input  logic [15:0] step_i,
  input  logic        rx_i,             // serial line, high when idle, asynchronous to clk_i
  output logic        valid_o,
  input  logic        ready_i,
  output logic [7:0]  data_o,
  output logic        framing_error_o,  // pulse: the stop bit was low, so the byte is lost
  output logic        overflow_o        // pulse: byte lost, as data_o was not taken
);

  localparam logic [3:0] StopBit = 4'd9;  // index of the stop bit; the start bit is 0

  logic line;
  lipp_bit_sync #(.ResetValue(1'b1)) i_sync (.clk_i, .rst_ni, .d_i(rx_i), .q_o(line));

  // The position in a byte: index of the bit, eighth of the bit, and fraction of the eighth.
  logic [3:0] bit_q;
  logic [2:0] eighth_q;
  logic [12:0] phase_q;
  logic [19:0] place_d;
  logic enter_q;  // high in the first clock of each eighth of a bit
  assign place_d = {bit_q, eighth_q, phase_q} + 20'(step_i);

  logic busy_q, broken_q, bit_done, majority;
  logic [2:0] sample_q;
  logic [7:0] shift_q;
  assign bit_done = busy_q && enter_q && eighth_q == 3'd6;
  assign majority = (sample_q[0] && sample_q[1]) || (sample_q[2] && (sample_q[0] || sample_q[1]));

  always_ff @(posedge clk_i) begin
    if (busy_q) {bit_q, eighth_q, phase_q} <= place_d;
    // The position starts one clock ahead, to correct two mean delays of half a clock: from the
    // start bit's edge to its first low sample, and from the start of an eighth to its first clock.
    else {bit_q, eighth_q, phase_q} <= {3'b0, step_i, 1'b0};
    enter_q <= busy_q && place_d[15:13] != eighth_q;
    if (enter_q && eighth_q inside {[3'd3:3'd5]}) sample_q <= {sample_q[1:0], line};
    if (bit_done) shift_q <= {majority, shift_q[7:1]};
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {busy_q, broken_q} <= '0;
      {valid_o, framing_error_o, overflow_o} <= '0;
      data_o <= '0;
    end else begin
      {framing_error_o, overflow_o} <= '0;
      if (ready_i) valid_o <= 1'b0;
      if (!busy_q) begin
        busy_q <= !line && !broken_q;
        if (line) broken_q <= 1'b0;
      end else if (bit_done && bit_q == 4'd0) begin
        busy_q <= !majority;
      end else if (bit_done && bit_q == StopBit) begin
        busy_q <= 1'b0;
        broken_q <= !majority;
        framing_error_o <= !majority;
        overflow_o <= majority && valid_o && !ready_i;
        if (majority && (!valid_o || ready_i)) begin
          valid_o <= 1'b1;
          data_o <= shift_q;
        end
      end
    end
  end

endmodule

`default_nettype wire
