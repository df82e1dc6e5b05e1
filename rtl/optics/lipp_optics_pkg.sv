// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Number formats, latencies and constants that the modules of the ray trace share.
///
/// F is the number of fraction bits of the build, and W = F + 2. Rays use three number formats:
///
///   near   signed, W bits,     F + 1 fraction bits, [-1, 1): directions, cosines, normals
///   wide   signed, W bits,     F     fraction bits, [-2, 2): lattice coordinates, slopes, ratios
///   far    signed, W + 2 bits, F     fraction bits, [-8, 8): lengths along the ray, in radii.
///
/// Results are rounded as floor(x + 1/2), with x in units of the last kept bit.
package lipp_optics_pkg;
  import lipp_math_pkg::*;

  // These lint warnings are off, because a module uses only some definitions, and a function only
  // some fields of a build.
  /* verilator lint_off UNUSEDPARAM */
  /* verilator lint_off UNUSEDSIGNAL */

  /// Status of an exit ray. The Python module `lippmann.optics.rays` uses the same status numbers.
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

  /// Build parameters of the optics, which software reads in the register `build`. Logic that a
  /// build does not use is not generated.
  typedef struct packed {
    logic       shear;          // 1: supports sheared lattices (module shear)
    logic       converge;       // 1: supports displays for a near eye (module converge)
    logic       cross_cells;    // 1: cross terms of products use multiplier cells
    logic [2:0] walk;           // maximum number of further domes that a ray tries
    logic       aims;           // 1: rays aim at aperture points; 0: chief rays only
    logic       viewer;         // 1: plano side to the viewer; 0: to the panel
    logic [1:0] model;          // lens model, a value of model_e
    logic       grid;           // lattice, a value of grid_e
    logic [4:0] fraction_bits;  // F, number of fraction bits, 14 to 23
  } build_t;

  /// Default build: exact lens model, square grid, chief rays only, F = 23.
  localparam build_t ExactSquare = '{fraction_bits: 5'd23, model: 2'(ModelExact), default: '0};

  /// Return whether rays of a build with the exact model can leave the cell of their lenslet.
  function automatic bit strays(build_t build);
    return build.aims || build.viewer || build.converge;
  endfunction

  /// Return whether a build's slope uses a separate coefficient for the aperture point.
  function automatic bit slope_aims(build_t build);
    return build.aims && (build.model == 2'(ModelParaxial) || build.converge);
  endfunction

  /// Width of signed pixel coordinates, which have 4 fraction bits and start at the panel's centre.
  localparam int PixelBits = 18;
  /// Width of the signed coefficients of the affine map: 36 fraction bits, in [-1/4, 1/4).
  localparam int SlopeBits = 35;
  /// Width of the signed offsets of the affine map: 40 fraction bits, in [-2048, 2048).
  localparam int OffsetBits = 52;
  /// Width of signed lenslet indices.
  localparam int IndexBits = 12;
  /// Parameters of the optics, signed with F fraction bits unless a comment says otherwise. R is
  /// the dome's radius, T the thickness of a lenslet, px the pitch along the rows, py the pitch
  /// across the rows. The host computes the parameters from a display file
  /// (`lippmann.fixed.configuration`). A field of 32 bits contains a narrower signed word.
  typedef struct packed {
    logic signed [SlopeBits-1:0]  x_from_u;  // lattice x = x_from_u u + x_from_v v + x_offset
    logic signed [SlopeBits-1:0]  x_from_v;
    logic signed [SlopeBits-1:0]  y_from_u;
    logic signed [SlopeBits-1:0]  y_from_v;
    logic signed [OffsetBits-1:0] x_offset;
    logic signed [OffsetBits-1:0] y_offset;
    logic signed [31:0] slope_x;         // slope per a - x (exact) or per x; F + E fraction bits
    logic signed [31:0] slope_y;
    logic signed [31:0] slope_aim_x;     // slope per a; F + E fraction bits
    logic signed [31:0] slope_aim_y;
    logic signed [31:0] point_x;         // point on first face per x, radii, F fraction bits
    logic signed [31:0] point_y;
    logic signed [31:0] point_aim_x;     // point on first face per a, radii, F fraction bits
    logic signed [31:0] point_aim_y;
    logic signed [31:0] index;                 // refractive index n, F fraction bits, below 4
    logic signed [31:0] index_square;          // n^2, F fraction bits, below 8
    logic signed [31:0] index_inverse;         // 1/n, F + 1 fraction bits
    logic signed [31:0] index_inverse_square;  // 1/n^2, F fraction bits
    logic signed [31:0] depth;           // z of the dome's centre, 1 - T/R, F fraction bits
    logic signed [31:0] depth_rest;      // 1 - depth^2, F + 3 fraction bits
    logic signed [31:0] exit_z;          // z of the last face, radii, F + 1 fraction bits
    logic signed [31:0] cell_half;       // half pitch px / (2 R), F + 1 fraction bits
    logic signed [31:0] cell_pitch_x;    // pitch px / R, F fraction bits
    logic signed [31:0] cell_pitch_y;    // (distance between rows) / R, F fraction bits
    logic signed [31:0] cell_half_y;     // py / (2 R), F + 1 fraction bits (square grid)
    logic signed [31:0] cell_rise;       // h in lipp_cell_step, F + 1 fraction bits, [-4, 4)
    logic signed [31:0] converge_share;  // factor s in lipp_converge, F + 11 fraction bits
    logic signed [31:0] converge_x;      // x of offset o in lipp_converge, F + 2 fraction bits
    logic signed [31:0] converge_y;
    logic signed [31:0] extent_i;        // maximum |2 i + j| (square: |2 i|) of a lenslet
    logic signed [31:0] extent_j;        // maximum |j| of a lenslet
    logic signed [31:0] shear_x;         // (x shift per row) / px, F fraction bits
    logic signed [31:0] shear_lean;      // shear s, F fraction bits
    logic signed [31:0] shear_row;       // (x step to the next row) / R, F fraction bits
  } optics_config_t;

  /// Width of unsigned column and row numbers of a panel.
  localparam int PanelBits = 14;
  /// Width of an index of the jitter table, which has 2^TableBits entries.
  localparam int TableBits = 6;

  /// The raster's settings for a frame: window, panel size, and jitter of the rays.
  typedef struct packed {
    logic [PanelBits-1:0] first_column;
    logic [PanelBits-1:0] last_column;
    logic [PanelBits-1:0] first_row;
    logic [PanelBits-1:0] last_row;
    logic [PanelBits-1:0] width;   // width of the panel in pixels
    logic [PanelBits-1:0] height;
    logic [15:0]          samples; // rays per pixel; 0 means 65536
    jitter_e              jitter;
    logic [TableBits-1:0] table_first;
    logic [31:0]          seed;
  } raster_config_t;

  /// Jitter of a ray: signed offsets from the centres of pixel and lenslet.
  typedef struct packed {
    logic signed [11:0] b;   // aperture point b in rows, 10 fraction bits
    logic signed [11:0] a;   // aperture point a in pitches, 10 fraction bits
    logic signed [3:0]  dv;  // upward offset from the pixel's centre, 4 fraction bits
    logic signed [3:0]  du;  // rightward offset from the pixel's centre, 4 fraction bits
  } jitter_t;

  /// Return whether a signed register value needs more than the given number of bits.
  function automatic bit beyond_bits(logic signed [31:0] word, int bits);
    return word >>> (bits - 1) != word >>> 31;
  endfunction

  /// Return E, the number of extra fraction bits of a direction before the dome, for exact builds
  /// with the plano side to the panel. Slopes and lateral directions have E more fraction bits, and
  /// dz has 3 E more. E is 0 if a word of F + 2 bits fits a multiplier cell.
  function automatic int extra_bits(int f);
    return f + 2 > MulBits ? 1 : 0;
  endfunction

  /// Return the number of extra fraction bits of a build's slopes and of its directions in the air.
  function automatic int air_bits(build_t build);
    return build.model == 2'(ModelExact) && !build.viewer ? extra_bits(int'(build.fraction_bits))
        : 0;
  endfunction

  // The following functions return the latencies of the modules of the ray trace in clocks.

  function automatic int pixel_latency();
    return mul_latency(MulBits, MulBits) + 3;
  endfunction

  function automatic int lenslet_latency(int grid);
    return grid == GridHex ? 4 : 1;
  endfunction

  /// Return the latency of `lipp_extent`: one clock each for sum, comparisons and their OR.
  function automatic int extent_latency();
    return 3;
  endfunction

  function automatic int aim_latency(int grid);
    return lenslet_latency(grid) + 1;
  endfunction

  /// Return the latency of `lipp_converge` in clocks.
  function automatic int converge_latency(int f);
    return mul_latency(MulBits, f + 9) + 2;
  endfunction

  /// Return the latency of `lipp_shear` in clocks.
  function automatic int shear_latency(int f);
    return mul_latency(f + 4, f + 4) + 2;
  endfunction

  /// Return the width of a pixel's x and y from its lenslet's centre, which have F fraction bits.
  /// The range is [-8, 8) with converge or shear, otherwise [-2, 2).
  function automatic int local_bits(int f, bit converge, bit shear);
    return f + (converge || shear ? 4 : 2);
  endfunction

  /// Return the latency of `lipp_blend` for a factor x of wx bits.
  function automatic int blend_latency(int f, int wx);
    return mul_latency(wx, f + 2) + 2;
  endfunction

  /// Return the latency of `lipp_unit_slope`: squares, sum of the squares, root, product.
  function automatic int unit_latency(int f);
    return mul_latency(f + 2, f + 2) + 2 + rsqrt_latency() + mul_latency(f + 2, f + 2) + 1;
  endfunction

  function automatic int enter_flat_latency(int f);
    return mul_latency(f + 2, f + 2) + 1 + mul_latency(f + 2, f + 2) + 2 + sqrt_latency(1'b0);
  endfunction

  /// Return the latency of the product zc dz or l dz in `lipp_meet_dome`.
  function automatic int axial_latency(int f);
    return mul_latency(f + 4, f + 2 + 3 * extra_bits(f));
  endfunction

  /// Return the latency of `lipp_meet_dome` up to the length b, a signed distance along the ray.
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

  /// Return the latency up to the factor k of the normal in `lipp_leave_dome`, `lipp_enter_dome`.
  function automatic int bend_latency(int f);
    return mul_latency(f + 4, f + 4) + 2 + sqrt_latency(1'b1) + 2;
  endfunction

  function automatic int dome_latency(int f);
    return bend_latency(f) + mul_latency(f + 2, f + 2) + 3;
  endfunction

  /// Return the latency of `lipp_leave_flat`: the longer of its paths to the point on the flat face
  /// and to the root of the squared cosine.
  function automatic int leave_flat_latency(int f);
    int root_path, air;
    root_path = rsqrt_latency() + 2 * mul_latency(f + 4, f + 2) + 3;
    air = mul_latency(f + 4, f + 4) + 2 + sqrt_latency(1'b1) + 1;
    return mul_latency(f + 2, f + 2) + 2 + (root_path > air ? root_path : air);
  endfunction

  /// Return the latency of `lipp_exit_flat` (viewer = 1) or `lipp_exit_dome` (viewer = 0).
  function automatic int exit_latency(bit viewer, int f);
    return dome_latency(f) + (viewer ? leave_flat_latency(f) : 1);
  endfunction

  /// Return the latency of `lipp_start_ray` up to the ray's slope and its point on the first face.
  function automatic int slope_latency(int f, bit converge, bit shear);
    return 1 + blend_latency(f, local_bits(f, converge, shear));
  endfunction

  /// Return the latency of `lipp_pixel_to_lens` from a pixel to the lenslet aimed at, and to the
  /// pixel's point measured from that lenslet's centre.
  function automatic int lens_latency(int f, int grid, bit aims, bit converge, bit shear);
    return pixel_latency() + lenslet_latency(grid) + (aims ? aim_latency(grid) : 0)
        + (converge ? converge_latency(f) : 0) + (shear ? shear_latency(f) : 0);
  endfunction

  /// Return the latency that each further dome adds to `lipp_walk_domes`.
  function automatic int walk_latency(int grid, int f, bit shear);
    return meet_dome_latency(f) + cell_step_latency(grid, f, shear) + 2;
  endfunction

  /// Return the latency of `lipp_ray_pipeline` in clocks.
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
