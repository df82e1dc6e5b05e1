// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Formats, latencies and constant tables that the steps of the ray share.
///
/// F is the number of fraction bits of the configuration, W = F + 2 its word:
///   near  signed W bits, F + 1 fraction bits, [-1, 1): directions, cosines, normals
///   wide  signed W bits, F     fraction bits, [-2, 2): lattice coordinates, slopes, ratios
///   far   signed W + 2 bits, F fraction bits, [-8, 8): lengths along the ray, in radii
/// "round" below always means floor(x + 1/2), in units of the last place kept.
package lipp_optics_pkg;
  import lipp_math_pkg::*;

  // Most modules use only some of these, and a function only some fields of a build.
  /* verilator lint_off UNUSEDPARAM */
  /* verilator lint_off UNUSEDSIGNAL */

  /// The status of a ray; the same numbers as in `lippmann.optics.rays`.
  typedef enum logic [2:0] {
    StatusOk = 3'd0,
    StatusMissed = 3'd1,
    StatusInternalReflection = 3'd2,
    StatusBlocked = 3'd3,
    StatusCrosstalk = 3'd4
  } ray_status_e;

  typedef enum int {
    ModelPinhole = 0,
    ModelParaxial = 1,
    ModelExact = 2
  } model_e;

  typedef enum int {
    GridSquare = 0,
    GridHex = 1
  } grid_e;

  typedef enum logic [1:0] {
    JitterOff = 2'd0,
    JitterTable = 2'd1,
    JitterLfsr = 2'd2
  } jitter_e;

  /// What is built of the optics: the word of the register `build`. Logic that a build does not use
  /// is not there.
  typedef struct packed {
    logic       shear;          // the lattice may be sheared
    logic       converge;       // elemental images may converge on a near eye
    logic       cross_cells;    // cross terms of products in multiplier cells
    logic [2:0] walk;           // further domes tried, for a ray that meets a dome outside its cell
    logic       aims;           // rays aim at aperture points; otherwise chief rays only
    logic       viewer;         // plano side to the viewer
    logic [1:0] model;          // model_e
    logic       grid;           // grid_e
    logic [4:0] fraction_bits;  // F, 14 to 23
  } build_t;

  /// The default: chief rays, exact, with the widest words.
  localparam build_t ExactSquare = '{fraction_bits: 5'd23, model: 2'(ModelExact), default: '0};

  /// Tells whether exact rays of a build can leave their cell.
  function automatic bit strays(build_t build);
    return build.aims || build.viewer || build.converge;
  endfunction

  /// Tells whether the slope has a coefficient for the aperture point.
  function automatic bit slope_aims(build_t build);
    return build.aims && (build.model == 2'(ModelParaxial) || build.converge);
  endfunction

  /// Pixel coordinates: signed, 4 fraction bits, from the panel's centre.
  localparam int PixelBits = 18;
  /// Affine coefficients: signed, 36 fraction bits, [-1/4, 1/4).
  localparam int SlopeBits = 35;
  /// Affine offsets: signed, 40 fraction bits, [-2048, 2048).
  localparam int OffsetBits = 52;
  /// Lenslet indices: signed.
  localparam int IndexBits = 12;
  /// The parameters of the optics, in words with F fraction bits. The host computes them from a
  /// display file (`lippmann.fixed.configuration`). Fields of 32 bits hold narrower signed words.
  typedef struct packed {
    logic signed [SlopeBits-1:0]  x_from_u;  // lattice from pixel
    logic signed [SlopeBits-1:0]  x_from_v;
    logic signed [SlopeBits-1:0]  y_from_u;
    logic signed [SlopeBits-1:0]  y_from_v;
    logic signed [OffsetBits-1:0] x_offset;
    logic signed [OffsetBits-1:0] y_offset;
    logic signed [31:0] slope_x;         // wide, E more bits: slope from a - x (exact) or x
    logic signed [31:0] slope_y;
    logic signed [31:0] slope_aim_x;     // the same from a (paraxial, Converge)
    logic signed [31:0] slope_aim_y;
    logic signed [31:0] point_x;         // wide: point on the first face, in radii, from x
    logic signed [31:0] point_y;
    logic signed [31:0] point_aim_x;     // wide: the same from a
    logic signed [31:0] point_aim_y;
    logic signed [31:0] index;                 // n, F fraction bits, below 4
    logic signed [31:0] index_square;          // n^2, F fraction bits, below 8
    logic signed [31:0] index_inverse;         // near: 1/n
    logic signed [31:0] index_inverse_square;  // 1/n^2, F fraction bits
    logic signed [31:0] depth;           // far: zc = 1 - T/R
    logic signed [31:0] depth_rest;      // 1 - zc^2, F + 3 fraction bits
    logic signed [31:0] exit_z;          // F + 1 fraction bits: height of the last face, in radii
    logic signed [31:0] cell_half;       // near: px / (2 R)
    logic signed [31:0] cell_pitch_x;    // wide: px / R
    logic signed [31:0] cell_pitch_y;    // wide: row distance / R
    logic signed [31:0] cell_half_y;     // near: py / (2 R) (square)
    logic signed [31:0] cell_rise;       // (sqrt(3)/2) px / py - s / 2, F + 1 bits, [-4, 4)
    logic signed [31:0] converge_share;  // s = D / (D + E), F + 11 fraction bits (Converge)
    logic signed [31:0] converge_x;      // -s A, F + 2 fraction bits
    logic signed [31:0] converge_y;
    logic signed [31:0] extent_i;        // largest |2 i + j| (square: |2 i|), 14 bits
    logic signed [31:0] extent_j;        // largest |j|, 13 bits
    logic signed [31:0] shear_x;         // far: s row / px (Shear)
    logic signed [31:0] shear_lean;      // wide: s
    logic signed [31:0] shear_row;       // wide: x of the next row's lenslet / R
  } optics_config_t;

  /// Columns and rows of a panel: unsigned.
  localparam int PanelBits = 14;
  /// Entries of the jitter table, as a power of two.
  localparam int TableBits = 6;

  /// The window of a frame, and the jitter of its rays.
  typedef struct packed {
    logic [PanelBits-1:0] first_column;
    logic [PanelBits-1:0] last_column;
    logic [PanelBits-1:0] first_row;
    logic [PanelBits-1:0] last_row;
    logic [PanelBits-1:0] width;   // of the panel
    logic [PanelBits-1:0] height;
    logic [15:0]          samples; // rays per pixel, 0 for 65536
    jitter_e              jitter;
    logic [TableBits-1:0] table_first;
    logic [31:0]          seed;
  } raster_config_t;

  /// Jitter of a ray: its offset from the centres of pixel and lenslet; all signed.
  typedef struct packed {
    logic signed [11:0] b;   // aperture point, 10 fraction bits, in rows
    logic signed [11:0] a;   // in pitches
    logic signed [3:0]  dv;  // position on the pixel, 4 fraction bits, upward
    logic signed [3:0]  du;  // to the right
  } jitter_t;

  /// Tells whether a register's word is outside the range of so many bits.
  function automatic bit beyond_bits(logic signed [31:0] word, int bits);
    return word >>> (bits - 1) != word >>> 31;
  endfunction

  /// E, the bits more of slopes and directions on their way into the glass, in exact builds with
  /// the plano side to the panel: slopes and lateral directions have E, dz has 3 E. None where a
  /// word fits a multiplier cell.
  function automatic int extra_bits(int f);
    return f + 2 > MulBits ? 1 : 0;
  endfunction

  /// E of a build's slopes and of its directions in the air.
  function automatic int air_bits(build_t build);
    return build.model == 2'(ModelExact) && !build.viewer ? extra_bits(int'(build.fraction_bits))
        : 0;
  endfunction

  // Latencies of the steps of a ray, W = F + 2.

  function automatic int pixel_latency();
    return mul_latency(MulBits, MulBits) + 3;
  endfunction

  function automatic int lenslet_latency(int grid);
    return grid == GridHex ? 4 : 1;
  endfunction

  /// Latency of `lipp_extent`: sum, comparisons, their combination.
  function automatic int extent_latency();
    return 3;
  endfunction

  function automatic int aim_latency(int grid);
    return lenslet_latency(grid) + 1;
  endfunction

  /// Latency of `lipp_converge`.
  function automatic int converge_latency(int f);
    return mul_latency(MulBits, f + 9) + 2;
  endfunction

  /// Latency of `lipp_shear`.
  function automatic int shear_latency(int f);
    return mul_latency(f + 4, f + 4) + 2;
  endfunction

  /// Bits of a pixel's point relative to its lenslet's centre: a wide word, [-2, 2), or [-8, 8).
  function automatic int local_bits(int f, bit converge, bit shear);
    return f + (converge || shear ? 4 : 2);
  endfunction

  /// Latency of a sum of two products, one of wx bits and the others `wide` words, rounded.
  function automatic int blend_latency(int f, int wx);
    return mul_latency(wx, f + 2) + 2;
  endfunction

  /// Latency of `lipp_unit_slope`: squares, their sum, the root, the product.
  function automatic int unit_latency(int f);
    return mul_latency(f + 2, f + 2) + 2 + rsqrt_latency() + mul_latency(f + 2, f + 2) + 1;
  endfunction

  function automatic int enter_flat_latency(int f);
    return mul_latency(f + 2, f + 2) + 1 + mul_latency(f + 2, f + 2) + 2 + sqrt_latency(1'b0);
  endfunction

  /// Latency of the product of a far word and dz in `lipp_meet_dome`.
  function automatic int axial_latency(int f);
    return mul_latency(f + 4, f + 2 + 3 * extra_bits(f));
  endfunction

  /// Latency of `lipp_meet_dome` up to the length b along the ray.
  function automatic int foot_latency(int f);
    return axial_latency(f) + 3;
  endfunction

  function automatic int meet_dome_latency(int f);
    return foot_latency(f) + mul_latency(f + 8, f + 8) + 3 + sqrt_latency(1'b1) + 1
        + axial_latency(f) + 2;
  endfunction

  function automatic int cell_step_latency(int grid, int f, bit shear);
    return (grid == GridHex || shear ? mul_latency(f + 2, f + 2) + 2 : 0) + 2;
  endfunction

  /// Latency of `lipp_leave_dome` and of `lipp_enter_dome` up to the factor of the normal.
  function automatic int bend_latency(int f);
    return mul_latency(f + 4, f + 4) + 2 + sqrt_latency(1'b1) + 2;
  endfunction

  function automatic int dome_latency(int f);
    return bend_latency(f) + mul_latency(f + 2, f + 2) + 3;
  endfunction

  /// Latency of `lipp_leave_flat`: the longer of two paths, to the point on the face and to the
  /// root.
  function automatic int leave_flat_latency(int f);
    int root_path, air;
    root_path = rsqrt_latency() + 2 * mul_latency(f + 4, f + 2) + 3;
    air = mul_latency(f + 4, f + 4) + 2 + sqrt_latency(1'b1) + 1;
    return mul_latency(f + 2, f + 2) + 2 + (root_path > air ? root_path : air);
  endfunction

  /// Latency of `lipp_exit_flat` (viewer) and `lipp_exit_dome`.
  function automatic int exit_latency(bit viewer, int f);
    return dome_latency(f) + (viewer ? leave_flat_latency(f) : 1);
  endfunction

  /// Cycles from the point on the panel to the slope and the point on the first face.
  function automatic int slope_latency(int f, bit converge, bit shear);
    return 1 + blend_latency(f, local_bits(f, converge, shear));
  endfunction

  /// Cycles from the pixel to the lenslet aimed at, and to the pixel's point relative to it.
  function automatic int lens_latency(int f, int grid, bit aims, bit converge, bit shear);
    return pixel_latency() + lenslet_latency(grid) + (aims ? aim_latency(grid) : 0)
        + (converge ? converge_latency(f) : 0) + (shear ? shear_latency(f) : 0);
  endfunction

  /// Cycles for each further dome that is tried.
  function automatic int walk_latency(int grid, int f, bit shear);
    return meet_dome_latency(f) + cell_step_latency(grid, f, shear) + 2;
  endfunction

  /// Latency of `lipp_ray_pipeline`.
  function automatic int ray_latency(build_t build);
    int f, grid, walk, before_dome;
    bit aims, viewer, converge, shear;
    {f, grid, walk} = {int'(build.fraction_bits), int'(build.grid), int'(build.walk)};
    {aims, viewer, converge, shear} = {build.aims, build.viewer, build.converge, build.shear};
    before_dome = lens_latency(f, grid, aims, converge, shear)
        + slope_latency(f, converge, shear) + unit_latency(f);
    if (build.model != 2'(ModelExact)) return before_dome + 2;
    if (!viewer) before_dome += enter_flat_latency(f);
    return before_dome + walk * walk_latency(grid, f, shear) + meet_dome_latency(f)
        + exit_latency(viewer, f) + 2;
  endfunction

  /* verilator lint_on UNUSEDSIGNAL */
  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
