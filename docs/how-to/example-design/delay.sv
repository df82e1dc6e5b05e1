// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// A user's own delay of a bit, with a reset, which lipp_delay has not.
module delay #(
  parameter int Clocks = 2
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o
);

  logic [Clocks-1:0] bits_q;
  assign bit_o = bits_q[Clocks-1];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) bits_q <= '0;
    else bits_q <= {bits_q[Clocks-2:0], bit_i};
  end

endmodule

`default_nettype wire
