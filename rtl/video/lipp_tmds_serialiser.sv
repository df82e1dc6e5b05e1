// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Splits symbols of ten bits into bit pairs, for output cells that send a bit at each clock edge.
///
/// Input shift_clk_i is five times as fast as pixel_clk_i and comes from the same source, with any
/// phase. Each shift clock sends pair_o[0], then pair_o[1]. A symbol is copied two or three shift
/// clocks after the pixel clock edge that registered it, so that the symbol is stable when it is
/// copied. The first pair of the symbol is at pair_o three shift clocks after the copy.
///
/// A register that toggles with each symbol marks where symbols begin. A ring counter of five
/// positions counts the shift clocks of a symbol, and the first toggle after reset sets the ring.
///
/// If the edges of the two clocks coincide, a toggle may be detected one clock earlier or later, at
/// position 2 or 4 of the ring. A toggle at position 2, 3 or 4 does not change the ring. A toggle
/// detected at position 0 or 1 sets the ring again. The following signals set the ring:
///
///   clock      0  1  2  3  4
///   begins_q   1  .  .  .  .   a toggle was detected: this clock must be position 3
///   astray_q   .  1  .  .  .   the ring was at another position: now position 4
///   restart_q  .  .  1  .  .   position 0
///   place_q    .  .  .  1  2
module lipp_tmds_serialiser #(
  parameter int Channels = 3
) (
  input  logic                     pixel_clk_i,
  input  logic                     pixel_rst_ni,
  input  logic [Channels-1:0][9:0] symbol_i,

  input  logic                     shift_clk_i,
  input  logic                     shift_rst_ni,
  output logic [Channels-1:0][1:0] pair_o,
  // pixel clock sent with the symbols, high in the first five bits of each symbol
  output logic               [1:0] clock_o
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

  // The shift clock is as fast as the FPGA allows, so between two registers there is at most one
  // LUT of four inputs and a wire across a third of the FPGA.
  logic turn, turned_q, begins_q, aligned_q, astray_q, restart_q;
  logic [4:0] place_q;  // ring counter: one bit is high, its index is the position
  // Each channel has its own register near its pads. These registers differ in polarity and reset
  // value, because synthesis would merge equal registers.
  logic [Channels-1:0] load_q, low;
  logic [Channels-1:0][9:0] shift_q;
  for (genvar k = 0; k < Channels; k++) begin : gen_sense
    assign low[k] = k % 2 == 1;
  end
  lipp_bit_sync #(.Stages(3)) i_turn (
    .clk_i(shift_clk_i), .rst_ni(shift_rst_ni), .d_i(turn_q), .q_o(turn)
  );
  always_ff @(posedge shift_clk_i or negedge shift_rst_ni) begin
    if (!shift_rst_ni) begin
      {turned_q, begins_q, aligned_q, astray_q, restart_q} <= '0;
      place_q <= 5'd1;
      for (int k = 0; k < Channels; k++) load_q[k] <= k % 4 >= 2;
    end else begin
      turned_q <= turn;
      begins_q <= turn != turned_q;
      astray_q <= begins_q && (!aligned_q || place_q[0] || place_q[1]);
      aligned_q <= aligned_q || begins_q;
      restart_q <= astray_q;
      place_q <= restart_q ? 5'b00010 : {place_q[3:0], place_q[4]};
      load_q <= {Channels{place_q[0]}} ^ low;
    end
  end
  // The path from the symbols to the pins crosses the FPGA in three steps. The bit pairs 0 to 4 of
  // a symbol are at the end of shift_q in the ring's positions 2, 3, 4, 0 and 1.
  logic [Channels-1:0][1:0] first_q, second_q;
  logic high_q, before_q;
  logic [1:0] second_clock_q;
  always_ff @(posedge shift_clk_i) begin
    // The pixel clock is high for two bit pairs and the first bit of the third pair. Each register
    // stage has at most one LUT before it.
    high_q <= place_q[2] || place_q[3];
    before_q <= high_q;
    second_clock_q <= {high_q, high_q || before_q};
    clock_o <= second_clock_q;
    // The zero bits shifted in at the top are never sent.
    for (int k = 0; k < Channels; k++) begin
      shift_q[k] <= load_q[k] != low[k] ? symbol_q[k] : {shift_q[k][1:0], shift_q[k][9:2]};
      {pair_o[k], second_q[k], first_q[k]} <= {second_q[k], first_q[k], shift_q[k][1:0]};
    end
  end

endmodule

`default_nettype wire
