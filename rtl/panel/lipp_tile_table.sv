// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Stores the CRC-32 of each tile of both frame buffers. The host reads the table to find the tiles
/// that it must send. An entry of 0 marks an invalid tile.
///
/// Reset clears the table, one entry per clock. While the table is cleared, output busy_o is high,
/// writes are not allowed, and reads are undefined. Output read_crc_o in clock t is the entry
/// requested in clock t - 2, as it was before clock t - 2.
module lipp_tile_table #(
  parameter int Width = 640,
  parameter int Height = 480,
  localparam int TileBits = $clog2(lipp_panel_pkg::tiles(Width) * lipp_panel_pkg::tiles(Height) + 1)
) (
  input  logic                clk_i,
  input  logic                rst_ni,
  output logic                busy_o,

  input  logic                write_i,
  input  logic                write_buffer_i,
  input  logic [TileBits-1:0] write_tile_i,
  input  logic [31:0]         write_crc_i,

  input  logic                read_buffer_i,
  input  logic [TileBits-1:0] read_tile_i,
  output logic [31:0]         read_crc_o
);
  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_tile_table: Width and Height must be 1 to 16383");
  end

  // number of table entries cleared since reset; the top bit is high when all are cleared
  logic [TileBits+1:0] cleared_q;
  assign busy_o = !cleared_q[TileBits+1];

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) cleared_q <= '0;
    else if (busy_o) cleared_q <= cleared_q + 1'b1;
  end

  lipp_memory_1w1r #(.Width(32), .AddressBits(TileBits + 1)) i_memory (
    .clk_i, .write_i(busy_o || write_i),
    .write_at_i(busy_o ? cleared_q[TileBits:0] : {write_buffer_i, write_tile_i}),
    .write_data_i(busy_o ? '0 : write_crc_i),
    .read_at_i({read_buffer_i, read_tile_i}), .read_data_o(read_crc_o)
  );

endmodule

`default_nettype wire
