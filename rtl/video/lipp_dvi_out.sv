// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Converts the video of lipp_scan_out to the bits of DVI's four differential pairs. The board's
/// top adds the vendor's output cells.
///
/// A pixel lasts one clock of pixel_clk_i. Input shift_clk_i is five times as fast as pixel_clk_i
/// and comes from the same source. Output pair_o[0] is blue, pair_o[1] green and pair_o[2] red.
/// Output pair_o[3] is the pixel clock, which is high during the first five bits of each symbol.
///
///   tmds_encoder (blue with both syncs, green, red) -> tmds_serialiser -> pair_o
module lipp_dvi_out (
  input  logic            pixel_clk_i,
  input  logic            pixel_rst_ni,
  input  logic            de_i,
  input  logic            hsync_i,
  input  logic            vsync_i,
  input  logic [23:0]     rgb_i,

  input  logic            shift_clk_i,
  input  logic            shift_rst_ni,
  output logic [3:0][1:0] pair_o
);

  logic [2:0][9:0] symbol;
  for (genvar k = 0; k < 3; k++) begin : gen_channel
    lipp_tmds_encoder i_encoder (
      .clk_i(pixel_clk_i), .rst_ni(pixel_rst_ni), .de_i, .data_i(rgb_i[8*k+:8]),
      .control_i(k == 0 ? {vsync_i, hsync_i} : 2'b00), .symbol_o(symbol[k])
    );
  end
  lipp_tmds_serialiser #(.Channels(3)) i_serialiser (
    .pixel_clk_i, .pixel_rst_ni, .symbol_i(symbol), .shift_clk_i, .shift_rst_ni,
    .pair_o(pair_o[2:0]), .clock_o(pair_o[3])
  );

endmodule

`default_nettype wire
