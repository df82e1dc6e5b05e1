// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Converts linear light to panel bytes by the panel's curve, a table of 8192 bytes from the host.
///
/// With L the 16-bit light of a channel, the byte is
///
///   rgb_o = table[L < 4096 ? L : 4096 + (L >> 4)]        for each of red, green and blue.
///
/// For L < 4096, where the curve is steep, each L has its own table entry. Entries 4096 to 4351 are
/// never read. Each channel has its own copy of the table. The latency is curve_latency() clocks.
module lipp_curve_table (
  input  logic                                      clk_i,
  input  logic                                      write_i,  // 1: write a byte of the table
  input  logic [lipp_scene_pkg::CurveBits-1:0]      write_at_i,
  input  logic [7:0]                                write_data_i,
  input  logic [2:0][lipp_scene_pkg::LightBits-1:0] light_i,  // light; [2] red, [1] green, [0] blue
  output logic [2:0][7:0]                           rgb_o
);
  import lipp_scene_pkg::*;

  for (genvar c = 0; c < 3; c++) begin : gen_channel
    logic [CurveBits-1:0] at_q;
    always_ff @(posedge clk_i) begin
      at_q <= light_i[c][15:12] == '0 ? {1'b0, light_i[c][11:0]} : {1'b1, light_i[c][15:4]};
    end
    lipp_memory_1w1r #(.Width(8), .AddressBits(CurveBits)) i_table (
      .clk_i, .write_i, .write_at_i, .write_data_i, .read_at_i(at_q), .read_data_o(rgb_o[c])
    );
  end

endmodule

`default_nettype wire
