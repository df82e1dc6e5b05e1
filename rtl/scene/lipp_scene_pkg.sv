// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Formats, parameters and latencies of the drawing: from the exit ray to the panel's pixel.
///
/// Lengths are in radii R of the domes, F is the number of fraction bits of the optics' build:
///   position    F + 9 bits, F - 3 fraction bits, [-2048, 2048): in the array's frame
///   slope       F + 4 bits, F + 1 fraction bits, [-4, 4): dx/dz, dy/dz
///   coordinate  20 bits, 8 fraction bits, [-2048, 2048): columns to the right or rows downwards
///   light       16 bits, linear, white is 65025 = 255^2
///   share       17 bits, 16 fraction bits, 0 to 65536: opacity, and what is left of the light
package lipp_scene_pkg;
  import lipp_math_pkg::*;

  // Most modules use only some of these, and a function only some fields of a build.
  /* verilator lint_off UNUSEDPARAM */
  /* verilator lint_off UNUSEDSIGNAL */

  /// Layers that the registers have room for, and slots: one number is the curve's.
  localparam int MostLayers = 8;
  localparam int MostSlots = 15;
  /// The slot number of the panel's curve.
  localparam int CurveSlot = 15;
  /// Entries of the panel's curve, as a power of two.
  localparam int CurveBits = 13;

  /// Bits of a texture coordinate, and of its fraction.
  localparam int CoordinateBits = 20;
  localparam int CoordinateFraction = 8;
  localparam int LightBits = 16;
  localparam int ShareBits = 17;
  /// A palette's entry: opacity of 9 bits, 256 the whole, and the bytes blue, green, red.
  localparam int EntryBits = 33;
  localparam logic [ShareBits-1:0] Whole = 17'h10000;
  /// Bits of a weight of texels: brightness.
  localparam int BrightnessBits = 9;

  /// What is built of the drawing. Logic that a build does not use is not there.
  typedef struct packed {
    logic [1:0]  samples_bits;  // rays for each pixel, as a power of two: 0 to 2
    logic        bilinear;      // texels are interpolated; otherwise the nearest
    logic [10:0] height;        // rows of texels of a slot, 2 to 1024; even with bilinear
    logic [3:0]  width_bits;    // columns, as a power of two: 5 to 10; 1024 to 261120 texels, a
                                // multiple of 1024
    logic [3:0]  slots;         // layers to 15
    logic [3:0]  layers;        // 1 to 8
  } scene_build_t;

  /// The default: four layers of 256 x 192 texels, a slot to load, the nearest texel, one ray.
  localparam scene_build_t FourLayers =
      '{layers: 4'd4, slots: 4'd5, width_bits: 4'd8, height: 11'd192, default: '0};

  /// How a layer is shown.
  typedef struct packed {
    logic [14:0] unused_high;
    logic [8:0]  brightness;  // 8 fraction bits; above 256 counts as 256
    logic [3:0]  slot;        // that holds its texels; of layers that name one, the first has it
    logic [1:0]  unused_low;
    logic        infinite;    // a sky: slopes alone decide
    logic        visible;
  } look_t;

  /// The registers of a layer.
  typedef struct packed {
    logic signed [31:0] s0;     // texels, 16 fraction bits
    logic signed [31:0] t0;
    logic signed [31:0] depth;  // radii, 20 fraction bits; a sky: the factor of the slopes
    logic signed [31:0] a;      // s from X, texels a radius, 24 fraction bits
    logic signed [31:0] b;      // s from Y
    logic signed [31:0] c;      // t from X
    logic signed [31:0] d;      // t from Y
    look_t              look;
  } layer_config_t;

  /// The registers of a scene. Layer 0 is in front. What a build lacks, it does not read.
  typedef struct packed {
    layer_config_t [MostLayers-1:0]   layers;
    // radii from a lenslet to the next, x; 30 fraction bits
    logic signed [31:0]               lattice_xi;
    logic signed [31:0]               lattice_xj;  // to the next row, x
    logic signed [31:0]               lattice_yj;  // y
    logic [2:0][LightBits-1:0]        background;  // [2] red, [1] green, [0] blue
  } scene_config_t;

  // ---- formats ----

  function automatic int position_bits(int f);
    return f + 9;
  endfunction

  function automatic int slope_bits(int f);
    return f + 4;
  endfunction

  /// Tells whether a build is legal: 1 to 8 layers, a slot for each, 32 to 1024 columns (a power of
  /// two), 2 to 1024 rows (with bilinear an even number), a multiple of 1024 texels up to 261120,
  /// and 1, 2 or 4 samples.
  function automatic bit legal(scene_build_t scene);
    int size;
    size = int'(scene.height) << scene.width_bits;
    return scene.layers >= 4'd1 && scene.layers <= 4'd8 && scene.slots >= scene.layers
        && scene.width_bits >= 4'd5 && scene.width_bits <= 4'd10
        && scene.height >= 11'd2 && scene.height <= 11'd1024
        && size % 1024 == 0 && size <= 255 * 1024
        && !(scene.bilinear && scene.height[0])
        && scene.samples_bits <= 2'd2;
  endfunction

  /// The build, or a small one in the place of an illegal one, whose module refuses it.
  function automatic scene_build_t built(scene_build_t scene);
    scene_build_t least;
    least = '{layers: 4'd1, slots: 4'd1, width_bits: 4'd5, height: 11'd32, default: '0};
    return legal(scene) ? scene : least;
  endfunction

  /// Texels of a slot.
  function automatic int texels(scene_build_t scene);
    return int'(scene.height) << scene.width_bits;
  endfunction

  /// Blocks of 1024 bytes of a slot: its texels, and its palette.
  function automatic int blocks(scene_build_t scene);
    return texels(scene) / 1024 + 1;
  endfunction

  function automatic int taps(scene_build_t scene);
    return scene.bilinear ? 4 : 1;
  endfunction

  /// Fraction bits that a build reads of the 24 of a coefficient.
  function automatic int coefficient_bits(int f);
    return f < 20 ? f + 4 : 24;
  endfunction

  // ---- latencies ----

  /// Latency of `lipp_exit_line`: root, inverse, slopes, products, sums.
  function automatic int exit_line_latency(int f);
    return quadratic_latency() + row_latency(f + 6, f + 6) + row_latency(f + 2, f + 8) + 1
        + row_latency(f + 4, f + 4) + 4;
  endfunction

  /// Latency of `lipp_layer_coordinate`: to the plane, to texels, sums.
  function automatic int layer_latency(int f);
    return row_latency(f + 9, f + 4) + 1 + row_latency(coefficient_bits(f) + 8, f + 9) + 1;
  endfunction

  /// Latency of `lipp_texel_slot`: texel, colour.
  function automatic int slot_latency();
    return 3 + 2;
  endfunction

  /// Latency of `lipp_texel_fetch`: addresses, crossbar, slot, crossbar.
  function automatic int fetch_latency();
    return 2 + 1 + slot_latency() + 1;
  endfunction

  /// Latency of `lipp_texel_blend`: shares and squares, products, two sums.
  function automatic int texel_blend_latency();
    return small_latency() + cell_latency() + 2;
  endfunction

  /// Latency of `lipp_composite`.
  function automatic int composite_latency(int layers);
    return (cell_latency() + 1) * layers + 2;
  endfunction

  /// Latency of `lipp_sample_mean`.
  function automatic int mean_latency(int samples_bits);
    return samples_bits == 0 ? 0 : 2;
  endfunction

  /// Latency of `lipp_curve_table`.
  function automatic int curve_latency();
    return 3;
  endfunction

  /// Clocks from an exit ray to its pixel in `lipp_scene`, without its handshakes.
  function automatic int scene_latency(int f, scene_build_t scene);
    return exit_line_latency(f) + layer_latency(f) + fetch_latency()
        + texel_blend_latency() + composite_latency(int'(scene.layers))
        + mean_latency(int'(scene.samples_bits)) + curve_latency();
  endfunction

  /* verilator lint_on UNUSEDSIGNAL */
  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
