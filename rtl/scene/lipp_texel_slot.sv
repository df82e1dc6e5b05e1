// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Stores the texels and palette of a layer (a slot), and reads the colour of an addressed texel.
///
/// The bytes of a slot are the texels row by row, then the palette of 256 entries r, g, b, a. A
/// palette entry is stored from input entry_i when its fourth byte is written.
///
/// With Scene.bilinear = 1 the texels are in four banks, one for each parity of column and row.
/// Texel (column, row) is in bank {row[0], column[0]} at the address row / 2 * (width / 2) + column
/// / 2. Each bank has its own address and its own copy of the palette. With Scene.bilinear = 0
/// there is one bank, with the address row * width + column. Output colour_o is the palette entry
/// of each bank's texel, slot_latency() clocks after the address.
module lipp_texel_slot #(
  parameter lipp_scene_pkg::scene_build_t Scene = lipp_scene_pkg::FourLayers,
  localparam int Taps = lipp_scene_pkg::taps(lipp_scene_pkg::built(Scene)),
  localparam int Depth = lipp_scene_pkg::texels(lipp_scene_pkg::built(Scene)) / Taps,
  localparam int AddressBits = $clog2(Depth)
) (
  input  logic                             clk_i,
  input  logic                             write_i,
  input  logic [19:0]                      write_at_i,
  input  logic [7:0]                       write_data_i,
  input  logic [lipp_scene_pkg::EntryBits-1:0] entry_i,  // last four bytes written, newest first
  input  logic [Taps-1:0][AddressBits-1:0] read_at_i,
  output logic [Taps-1:0][lipp_scene_pkg::EntryBits-1:0] colour_o
);
  import lipp_scene_pkg::*;

  localparam scene_build_t Built = built(Scene);
  localparam int ColumnBits = int'(Built.width_bits);
  localparam logic [9:0] PaletteBlock = 10'(texels(Built) / 1024);

  if (!legal(Scene)) begin : gen_illegal
    $fatal(1, "lipp_texel_slot: Scene is not legal");
  end

  // ---- decode the write address ----
  logic texel_q, entry_q;
  logic [19:0] at_q;
  logic [7:0] data_q;
  logic [EntryBits-1:0] entry_data_q;
  always_ff @(posedge clk_i) begin
    texel_q <= write_i && write_at_i[19:10] < PaletteBlock;
    entry_q <= write_i && write_at_i[19:10] == PaletteBlock && write_at_i[1:0] == 2'd3;
    at_q <= write_at_i;
    data_q <= write_data_i;
    entry_data_q <= entry_i;
  end
  logic unused_at;
  assign unused_at = ^at_q;

  // ---- read the texel, then its colour in the palette ----
  for (genvar k = 0; k < Taps; k++) begin : gen_bank
    logic write;
    logic [AddressBits-1:0] write_at;
    if (Taps == 1) begin : gen_nearest
      assign write = texel_q;
      assign write_at = at_q[AddressBits-1:0];
    end else begin : gen_bilinear
      localparam logic [1:0] Bank = 2'(k);
      assign write = texel_q && {at_q[ColumnBits], at_q[0]} == Bank;
      // The address within a bank is {row / 2, column / 2}.
      assign write_at = AddressBits'({at_q[19:ColumnBits+1], at_q[ColumnBits-1:1]});
    end

    logic [7:0] texel;
    lipp_texel_memory #(.Depth(Depth)) i_texels (
      .clk_i, .write_i(write), .write_at_i(write_at), .write_data_i(data_q),
      .read_at_i(read_at_i[k]), .read_data_o(texel)
    );
    lipp_memory_1w1r #(.Width(EntryBits), .AddressBits(8)) i_palette (
      .clk_i, .write_i(entry_q), .write_at_i(at_q[9:2]), .write_data_i(entry_data_q),
      .read_at_i(texel), .read_data_o(colour_o[k])
    );
  end

endmodule

`default_nettype wire
