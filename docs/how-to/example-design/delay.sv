// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Delays a bit; shows that a user's module `delay` does not collide with lipp_delay.
module delay #(
  parameter int Clocks = 2
) (
  input  logic clk_i,
  input  logic bit_i,
  output logic bit_o
);

  logic [Clocks-1:0] bits_q;
  assign bit_o = bits_q[Clocks-1];
  always_ff @(posedge clk_i) bits_q <= {bits_q[Clocks-2:0], bit_i};

endmodule

`default_nettype wire
