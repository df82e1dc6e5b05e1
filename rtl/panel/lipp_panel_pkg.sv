// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Types and constants of the modules that show frames: tiles, pixel codings and test patterns.
///
/// The panel has Width x Height pixels {r, g, b}, stored row by row: the index of pixel (x, y) is y
/// * Width + x. The panel is divided into tiles of 32 x 32 pixels, numbered row by row. Tiles at
/// the right and lower edges are smaller if the panel's size is not a multiple of 32.
package lipp_panel_pkg;
  // Most modules use only some of these constants.
  /* verilator lint_off UNUSEDPARAM */

  localparam int Tile = 32;

  /// Coding of the pixels of a tile in a packet.
  typedef enum logic [7:0] {
    CodingRaw = 8'd0,    // three bytes R, G, B for each pixel
    CodingSolid = 8'd1,  // three bytes R, G, B for all pixels of the tile
    CodingQoi = 8'd2,    // operations of the QOI image format, without header and end
    CodingCopy = 8'd3    // no data: copies the same tile of the other frame buffer
  } coding_e;

  typedef enum logic [2:0] {
    PatternOff = 3'd0,
    PatternLens = 3'd1,
    PatternCentres = 3'd2,
    PatternViews = 3'd3,
    PatternChecker = 3'd4,
    PatternRamp = 3'd5
  } pattern_e;

  typedef struct packed {
    pattern_e kind;
    // indices i and j of the lenslet that PatternLens shows
    logic signed [lipp_optics_pkg::IndexBits-1:0] i;
    logic signed [lipp_optics_pkg::IndexBits-1:0] j;
  } pattern_t;

  /// Return the number of tiles along a panel side of `pixels` pixels.
  function automatic int tiles(int pixels);
    return (pixels + Tile - 1) / Tile;
  endfunction

  /// Return the latency of `lipp_test_pattern`. The summands are the latencies of the lattice
  /// coordinates, the lenslet, the products for PatternCentres, their sums, and the selection.
  function automatic int pattern_latency(int grid);
    return 1 + lipp_optics_pkg::pixel_latency() + lipp_optics_pkg::lenslet_latency(grid)
        + lipp_math_pkg::mul_latency(lipp_math_pkg::MulBits, lipp_math_pkg::MulBits) + 3;
  endfunction

  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
