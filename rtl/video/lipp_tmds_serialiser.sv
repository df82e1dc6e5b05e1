// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Symbols of ten bits to pairs of bits, for cells that send one bit at each edge of a clock.
///
/// shift_clk_i is five times as fast as pixel_clk_i and made from the same source, at any phase.
/// Each shift clock sends pair_o[0], then pair_o[1]. A symbol is copied two to four shift clocks
/// after the clock that brought it, when it has long been still; the first pair of it is at pair_o
/// a clock later.
///
/// A bit that changes with each symbol tells where symbols begin. Where the clocks' edges meet, it
/// is seen now a clock sooner, now a clock later: the count to five then goes on as it was.
module lipp_tmds_serialiser #(
  parameter int Channels = 3
) (
  input  logic                     pixel_clk_i,
  input  logic                     pixel_rst_ni,
  input  logic [Channels-1:0][9:0] symbol_i,

  input  logic                     shift_clk_i,
  input  logic                     shift_rst_ni,
  output logic [Channels-1:0][1:0] pair_o
);

  if (Channels < 1) begin : gen_illegal
    $fatal(1, "lipp_tmds_serialiser: Channels must be 1 or more");
  end

  logic [Channels-1:0][9:0] symbol_q;
  logic turn_q;
  always_ff @(posedge pixel_clk_i) symbol_q <= symbol_i;
  always_ff @(posedge pixel_clk_i or negedge pixel_rst_ni) begin
    if (!pixel_rst_ni) turn_q <= 1'b0;
    else turn_q <= !turn_q;
  end

  logic turn, turned_q, begins;
  lipp_bit_sync i_turn (.clk_i(shift_clk_i), .rst_ni(shift_rst_ni), .d_i(turn_q), .q_o(turn));
  assign begins = turn != turned_q;

  logic [2:0] count_q;  // 0 to 4
  logic [Channels-1:0][9:0] rest_q;
  always_ff @(posedge shift_clk_i or negedge shift_rst_ni) begin
    if (!shift_rst_ni) begin
      turned_q <= 1'b0;
      count_q <= '0;
    end else begin
      turned_q <= turn;
      // Expected at 0, or a clock sooner.
      if (count_q == 3'd4) count_q <= '0;
      else count_q <= begins ? 3'd1 : count_q + 3'd1;
    end
  end
  always_ff @(posedge shift_clk_i) begin
    for (int k = 0; k < Channels; k++) begin
      rest_q[k] <= count_q == '0 ? symbol_q[k] : rest_q[k] >> 2;
    end
  end
  for (genvar k = 0; k < Channels; k++) begin : gen_pair
    assign pair_o[k] = rest_q[k][1:0];
  end

endmodule

`default_nettype wire
