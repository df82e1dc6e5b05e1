// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Drives a board's status LEDs, and reads the button that selects the test pattern.
///
/// Output linked_o stays high for 2^HoldBits clocks after the last packet. Output alarm_o stays
/// high for 2^HoldBits clocks after the last error, and permanently if a clock has failed
/// (clock_lost_i). Each press of the button selects the next test pattern. After the last pattern,
/// a press selects 0, no pattern. A press counts if the button is stable for 2^IdleBits clocks.
module lipp_buttons_and_lamps #(
  parameter int HoldBits = 23,
  parameter int IdleBits = 20
) (
  input  logic       clk_i,
  input  logic       rst_ni,
  input  logic       packet_i,      // pulse: a packet was received
  input  logic       error_i,       // pulse: an error occurred
  input  logic       clock_lost_i,  // level, 1: a clock has failed since power-up
  input  logic       button_i,      // asynchronous pin of the button, high while pressed
  output logic       linked_o,
  output logic       alarm_o,
  output logic [2:0] pattern_o      // number of the selected test pattern; 0: none
);

  if (HoldBits < 1 || IdleBits < 1) begin : gen_illegal
    $fatal(1, "lipp_buttons_and_lamps: HoldBits and IdleBits must be 1 or more");
  end

  localparam logic [2:0] Last = lipp_panel_pkg::PatternRamp;

  // ---- keep each status LED on for 2^HoldBits clocks ----
  logic [HoldBits-1:0] link_q, error_q;  // number of clocks until linked_o and alarm_o fall
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {link_q, error_q} <= '0;
      {linked_o, alarm_o} <= '0;
    end else begin
      link_q <= packet_i ? '1 : link_q - HoldBits'(link_q != '0);
      error_q <= error_i ? '1 : error_q - HoldBits'(error_q != '0);
      linked_o <= packet_i || link_q != '0;
      alarm_o <= error_i || error_q != '0 || clock_lost_i;
    end
  end

  // ---- debounce the button, and count its presses ----
  logic button, pressed_q;
  logic [IdleBits-1:0] idle_q;
  lipp_bit_sync i_button (.clk_i, .rst_ni, .d_i(button_i), .q_o(button));
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      pressed_q <= 1'b0;
      idle_q <= '0;
      pattern_o <= '0;
    end else begin
      idle_q <= button == pressed_q ? '0 : idle_q + 1'b1;
      if (idle_q == '1) begin
        pressed_q <= button;
        if (button) pattern_o <= pattern_o == Last ? '0 : pattern_o + 1'b1;
      end
    end
  end

endmodule

`default_nettype wire
