// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Number formats, parameters and latencies of the modules that draw the scene from exit rays.
///
/// Lengths are in radii of the domes. F is the optics' number of fraction bits. The formats are:
///
///   position    F + 9 bits, F - 3 fraction bits, [-2048, 2048): x, y from the array's origin
///   slope       F + 4 bits, F + 1 fraction bits, [-4, 4): dx/dz, dy/dz
///   coordinate  20 bits, 8 fraction bits, [-2048, 2048): columns to the right or rows downwards
///   light       16 bits, linear, white is 65025 = 255^2
///   share       17 bits, 16 fraction bits, 0 to 65536: opacity, or transmittance
package lipp_scene_pkg;
  import lipp_math_pkg::*;

  // These lint warnings are off, because a module uses only some definitions, and a function only
  // some fields of a build.
  /* verilator lint_off UNUSEDPARAM */
  /* verilator lint_off UNUSEDSIGNAL */

  /// Maximum number of layers, and of slots without slot 15, which is reserved for the curve.
  localparam int MostLayers = 8;
  localparam int MostSlots = 15;
  /// Slot number of the panel's curve.
  localparam int CurveSlot = 15;
  /// Width of an index of the panel's curve, which has 2^CurveBits entries.
  localparam int CurveBits = 13;

  /// Width of a texture coordinate, and number of its fraction bits.
  localparam int CoordinateBits = 20;
  localparam int CoordinateFraction = 8;
  localparam int LightBits = 16;
  localparam int ShareBits = 17;
  /// Width of a palette entry: an opacity of 9 bits (256 is opaque), and bytes blue, green, red.
  localparam int EntryBits = 33;
  localparam logic [ShareBits-1:0] Whole = 17'h10000;
  /// Width of a layer's brightness.
  localparam int BrightnessBits = 9;

  /// Build parameters of the drawing. Logic that a build does not use is not generated.
  typedef struct packed {
    logic [1:0]  samples_bits;  // log2 of the rays per pixel, 0 to 2
    logic        bilinear;      // 1: bilinear filter; 0: nearest texel
    logic [10:0] height;        // texel rows of a slot, 2 to 1024; an even number if bilinear
    logic [3:0]  width_bits;    // log2 of the texel columns of a slot, 5 to 10
                                // columns times rows must be a multiple of 1024, at most 261120
    logic [3:0]  slots;         // number of slots, from `layers` to 15
    logic [3:0]  layers;        // number of layers, 1 to 8
  } scene_build_t;

  /// Default build: four layers, five slots of 256 x 192 texels, nearest texel, one ray per pixel.
  localparam scene_build_t FourLayers =
      '{layers: 4'd4, slots: 4'd5, width_bits: 4'd8, height: 11'd192, default: '0};

  /// Appearance of a layer: the fields of the register `look`.
  typedef struct packed {
    logic [14:0] unused_high;
    logic [8:0]  brightness;  // brightness factor in units of 1/256, up to 256
    logic [3:0]  slot;        // number of the layer's slot
    logic [1:0]  unused_low;
    logic        infinite;    // 1: a sky; texel position depends on slopes only
    logic        visible;
  } look_t;

  /// Registers of one layer.
  typedef struct packed {
    logic signed [31:0] s0;     // texture coordinate s at the origin, 16 fraction bits
    logic signed [31:0] t0;
    logic signed [31:0] depth;  // distance, radii, 20 fraction bits; sky: factor of slopes
    logic signed [31:0] a;      // s per x on the layer, texels per radius, 24 fraction bits
    logic signed [31:0] b;      // s per y on the layer, texels per radius, 24 fraction bits
    logic signed [31:0] c;      // t per x on the layer, texels per radius, 24 fraction bits
    logic signed [31:0] d;      // t per y on the layer, texels per radius, 24 fraction bits
    look_t              look;
  } layer_config_t;

  /// Registers of a scene. Layer 0 is in front. A build ignores the fields of layers that it lacks.
  typedef struct packed {
    layer_config_t [MostLayers-1:0]   layers;
    // The steps between lenslets are in radii with 30 fraction bits; xi is the x step within a row.
    logic signed [31:0]               lattice_xi;
    logic signed [31:0]               lattice_xj;  // x step to next row, radii, 30 fraction bits
    logic signed [31:0]               lattice_yj;  // y step to next row, radii, 30 fraction bits
    logic [2:0][LightBits-1:0]        background;  // light; [2] red, [1] green, [0] blue
  } scene_config_t;

  // ---- check a build, and return its widths and sizes ----

  function automatic int position_bits(int f);
    return f + 9;
  endfunction

  function automatic int slope_bits(int f);
    return f + 4;
  endfunction

  /// Return whether a build is legal. A legal build has 1 to 8 layers, a slot for each layer, 32 to
  /// 1024 columns (a power of two), 2 to 1024 rows (an even number if bilinear), a multiple of 1024
  /// texels up to 261120, and 1, 2 or 4 samples per pixel.
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

  /// Return the build if it is legal, otherwise a small legal build, so that elaboration of an
  /// illegal build reaches its error message.
  function automatic scene_build_t built(scene_build_t scene);
    scene_build_t least;
    least = '{layers: 4'd1, slots: 4'd1, width_bits: 4'd5, height: 11'd32, default: '0};
    return legal(scene) ? scene : least;
  endfunction

  /// Return the number of texels of a slot.
  function automatic int texels(scene_build_t scene);
    return int'(scene.height) << scene.width_bits;
  endfunction

  /// Return the number of 1024-byte blocks of a slot, for its texels and its palette.
  function automatic int blocks(scene_build_t scene);
    return texels(scene) / 1024 + 1;
  endfunction

  function automatic int taps(scene_build_t scene);
    return scene.bilinear ? 4 : 1;
  endfunction

  /// Return how many of the 24 fraction bits of a layer's coefficient a build reads.
  function automatic int coefficient_bits(int f);
    return f < 20 ? f + 4 : 24;
  endfunction

  // ---- latencies of the modules in clocks ----

  /// Return the latency of `lipp_exit_line`: root, 1 / dz, slopes, products with z, sums.
  function automatic int exit_line_latency(int f);
    return quadratic_latency() + row_latency(f + 6, f + 6) + row_latency(f + 2, f + 8) + 1
        + row_latency(f + 4, f + 4) + 4;
  endfunction

  /// Return the latency of `lipp_layer_coordinate`: intersection, products, sums.
  function automatic int layer_latency(int f);
    return row_latency(f + 9, f + 4) + 1 + row_latency(coefficient_bits(f) + 8, f + 9) + 1;
  endfunction

  /// Return the latency of `lipp_texel_slot`: a read of the texel, then a read of the palette.
  function automatic int slot_latency();
    return 3 + 2;
  endfunction

  /// Return the latency of `lipp_texel_fetch`: address, crossbar to the slots, slot, crossbar back.
  function automatic int fetch_latency();
    return 2 + 1 + slot_latency() + 1;
  endfunction

  /// Return the latency of `lipp_texel_blend`: opacities and squares, products, two sums.
  function automatic int texel_blend_latency();
    return small_latency() + cell_latency() + 2;
  endfunction

  /// Return the latency of `lipp_composite` in clocks.
  function automatic int composite_latency(int layers);
    return (cell_latency() + 1) * layers + 2;
  endfunction

  /// Return the latency of `lipp_sample_mean` in clocks.
  function automatic int mean_latency(int samples_bits);
    return samples_bits == 0 ? 0 : 2;
  endfunction

  /// Return the latency of `lipp_curve_table` in clocks.
  function automatic int curve_latency();
    return 3;
  endfunction

  /// Return the latency of `lipp_scene` from exit ray to pixel, excluding its handshakes.
  function automatic int scene_latency(int f, scene_build_t scene);
    return exit_line_latency(f) + layer_latency(f) + fetch_latency()
        + texel_blend_latency() + composite_latency(int'(scene.layers))
        + mean_latency(int'(scene.samples_bits)) + curve_latency();
  endfunction

  /* verilator lint_on UNUSEDSIGNAL */
  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
