// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Sends bytes on an asynchronous serial line with 8 data bits, no parity and one stop bit.
///
/// Input step_i is 2^16 times the baud rate divided by the clock frequency. Each edge of tx_o is
/// within one clock of its exact time. Consecutive bytes follow each other without a pause.
module lipp_uart_tx (
  input  logic        clk_i,
  input  logic        rst_ni,
  input  logic [15:0] step_i,
  input  logic        valid_i,
  output logic        ready_o,
  input  logic [7:0]  data_i,
  output logic        tx_o      // serial line, high when idle
);

  logic [9:0] shift_q;        // stop bit, data bits and start bit, in bits 9 to 0
  logic [3:0] remaining_q;    // number of bits still to send
  logic [15:0] phase_q;
  logic tick_q;          // high in the last clock of a bit
  assign tx_o = shift_q[0];
  assign ready_o = remaining_q == 4'd0 || (remaining_q == 4'd1 && tick_q);

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      shift_q <= '1;
      remaining_q <= '0;
      phase_q <= '0;
      tick_q <= 1'b0;
    end else begin
      if (remaining_q == 4'd0) {tick_q, phase_q} <= {1'b0, step_i};
      else {tick_q, phase_q} <= 17'(phase_q) + 17'(step_i);
      if (valid_i && ready_o) begin
        shift_q <= {1'b1, data_i, 1'b0};
        remaining_q <= 4'd10;
      end else if (tick_q) begin
        shift_q <= {1'b1, shift_q[9:1]};
        remaining_q <= remaining_q - 4'd1;
      end
    end
  end

endmodule

`default_nettype wire
