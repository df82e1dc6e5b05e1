// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Types and constants of the panel's modules: tiles, codings, test patterns.
///
/// The panel is Width x Height pixels {r, g, b}, stored row by row: the index of pixel (x, y) is
/// y * Width + x. It is divided into tiles of 32 x 32 pixels, numbered row by row; tiles at the
/// right and lower edges are cut off by the panel's edge.
package lipp_panel_pkg;
  // Most modules use only some of these.
  /* verilator lint_off UNUSEDPARAM */

  localparam int Tile = 32;

  /// Coding of a tile's pixels in a packet.
  typedef enum logic [7:0] {
    CodingRaw = 8'd0,    // three bytes a pixel
    CodingSolid = 8'd1,  // three bytes
    CodingQoi = 8'd2,    // QOI operations, without header and end marker
    CodingCopy = 8'd3    // no data: the front buffer's pixels there
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
    logic signed [lipp_optics_pkg::IndexBits-1:0] i;  // the lenslet of PatternLens
    logic signed [lipp_optics_pkg::IndexBits-1:0] j;
  } pattern_t;

  /// Number of tiles along a side with that many pixels.
  function automatic int tiles(int pixels);
    return (pixels + Tile - 1) / Tile;
  endfunction

  /// Latency of `lipp_test_pattern`: coordinates, lenslet, products of the centre, its sums,
  /// choice.
  function automatic int pattern_latency(int grid);
    return 1 + lipp_optics_pkg::pixel_latency() + lipp_optics_pkg::lenslet_latency(grid)
        + lipp_math_pkg::mul_latency(lipp_math_pkg::MulBits, lipp_math_pkg::MulBits) + 3;
  endfunction

  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
