// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// What a board's lamps show, and its button that steps through the test patterns.
///
/// linked_o lasts 2^HoldBits clocks after the last packet, alarm_o as long after the last error,
/// and for ever once the clock was lost. Each press of the button takes the next pattern, and after
/// the last one none; the button counts when it has been still for 2^IdleBits clocks.
module lipp_board_lamps #(
  parameter int HoldBits = 23,
  parameter int IdleBits = 20
) (
  input  logic       clk_i,
  input  logic       rst_ni,
  input  logic       packet_i,      // pulse
  input  logic       error_i,       // pulse
  input  logic       clock_lost_i,  // level
  input  logic       button_i,      // a pin, high while it is pressed
  output logic       linked_o,
  output logic       alarm_o,
  output logic [2:0] pattern_o      // 0: none
);

  if (HoldBits < 1 || IdleBits < 1) begin : gen_illegal
    $fatal(1, "lipp_board_lamps: HoldBits and IdleBits must be 1 or more");
  end

  localparam logic [2:0] Last = lipp_panel_pkg::PatternRamp;

  // ---- lamps ----
  logic [HoldBits-1:0] link_q, error_q;  // clocks that are left
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

  // ---- button ----
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
