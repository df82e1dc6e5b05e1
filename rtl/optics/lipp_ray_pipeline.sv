// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// All steps of a ray, from pixel to exit ray: one ray every clock, without stalls.
///
///   pixel_to_lattice -> lenslet_{square,hex} -> (aim) -> (converge) -> (shear) ->
///   blend, unit_slope ->
///     pinhole, paraxial:              the slope is the exit ray's
///     exact, plano side to the panel:  enter_flat -> meet_dome -> leave_dome
///     exact, plano side to the viewer: meet_dome -> enter_dome -> leave_flat
///
/// Input: pixel u_i (columns, to the right), v_i (rows, upward) from the panel's centre, 4 fraction
/// bits; aperture point a_i, b_i, wide words, in pitches and rows from the centre of the pixel's
/// lenslet (Aims = 0: the chief ray, not used).
/// Output: lens-local origin in radii, F + 1 fraction bits, measured from the centre of lenslet
/// (i, j); unit direction, near words; all along the array's axes, +z to the viewer. Status as in
/// `ray_status_e`: missed takes precedence over total internal reflection, blocked and crosstalk. The
/// origin of a missed ray is undefined. A ray is missed, too, where any word on its way wraps or
/// saturates, by more than roundings: flags `beyond` travel with it. So are all rays where a
/// register holds more than the word that is read of it.
/// Logic that a Model or an orientation does not use is not built. Walk is the number of further
/// domes tried when the ray meets a dome outside its cell; a ray that needs more counts as missed.
/// A ray that leaves the dome downward is blocked; neighbouring domes are not checked again.
/// Blocked are also rays of a pixel whose lenslet the array does not have, and rays that would leave
/// through such a lenslet, whatever else becomes of them.
/// Converge is for displays whose pixels belong to the lenslet through which a near eye sees them,
/// Shear for lattices whose rows are moved by a share of their height.
/// Latency ray_latency(F, Grid, Model, Viewer, Aims, Walk, Converge, Shear).
module lipp_ray_pipeline #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // cross terms of products in multiplier cells
  parameter int Grid = lipp_optics_pkg::GridSquare,
  parameter int Model = lipp_optics_pkg::ModelExact,
  parameter bit Viewer = 1'b0,  // plano side to the viewer
  parameter bit Aims = 1'b0,    // rays aim at aperture points
  parameter int Walk = 0,
  parameter bit Converge = 1'b0,  // elemental images converge on a near eye
  parameter bit Shear = 1'b0      // the lattice may be sheared
) (
  input  logic                                     clk_i,
  input  lipp_optics_pkg::optics_config_t               config_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0]  u_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0]  v_i,
  input  logic signed [F+1:0]                      a_i,
  input  logic signed [F+1:0]                      b_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0]  i_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0]  j_o,
  output logic signed [F+3:0]                      x_o,
  output logic signed [F+3:0]                      y_o,
  output logic signed [F+3:0]                      z_o,
  output logic signed [F+1:0]                      dx_o,
  output logic signed [F+1:0]                      dy_o,
  output logic signed [F+1:0]                      dz_o,
  output lipp_optics_pkg::ray_status_e                      status_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wh = W + 1;
  localparam int Wf = W + 2;
  localparam int L = IndexBits + F;
  localparam bit Strays = Aims || Viewer || Converge;  // exact rays can leave their cell

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_ray_pipeline: F must be 14 to 23");
  end
  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "lipp_ray_pipeline: Grid must be GridSquare or GridHex");
  end
  if (Model != ModelPinhole && Model != ModelParaxial && Model != ModelExact)
  begin : gen_illegal_model
    $fatal(1, "lipp_ray_pipeline: Model must be ModelPinhole, ModelParaxial or ModelExact");
  end
  if (Viewer && Model != ModelExact) begin : gen_illegal_viewer
    $fatal(1, "lipp_ray_pipeline: Viewer must be 0 but for ModelExact: others read it from registers");
  end
  if (Aims && Model == ModelPinhole) begin : gen_illegal_aims
    $fatal(1, "lipp_ray_pipeline: Aims must be 0 for ModelPinhole, whose ray is the chief ray");
  end
  if (Walk < 0 || Walk > 4 || (Walk > 0 && (Model != ModelExact || !Strays)))
  begin : gen_illegal_walk
    $fatal(1, "lipp_ray_pipeline: Walk must be 0, or up to 4 where exact rays can leave their cell");
  end

  // ---- words of the registers ----
  // The optics stand still while rays are in the pipeline, far longer than these clocks.
  localparam bit SlopeAims = Aims && (Model == ModelParaxial || Converge);
  localparam bit Exact = Model == ModelExact;
  localparam bit Cells = Exact && Strays;
  // Slopes and directions in the air have these bits more.
  localparam int Air = Exact && !Viewer ? extra_bits(F) : 0;
  localparam int Wm = W + Air;
  logic [24:0] unfit_d, unfit_q;
  logic unfit_q2;
  assign unfit_d = {
    beyond_bits(config_i.slope_x, Wm), beyond_bits(config_i.slope_y, Wm),
    SlopeAims && beyond_bits(config_i.slope_aim_x, Wm),
    SlopeAims && beyond_bits(config_i.slope_aim_y, Wm),
    Model != ModelPinhole && beyond_bits(config_i.point_x, W),
    Model != ModelPinhole && beyond_bits(config_i.point_y, W),
    Aims && beyond_bits(config_i.point_aim_x, W), Aims && beyond_bits(config_i.point_aim_y, W),
    Exact && beyond_bits(config_i.index, W + 1), Exact && beyond_bits(config_i.index_square, Wf),
    Exact && beyond_bits(config_i.index_inverse, W),
    Viewer && beyond_bits(config_i.index_inverse_square, Wf),
    Exact && beyond_bits(config_i.depth, Wf),
    (Viewer || !Exact) && beyond_bits(config_i.exit_z, Wf),
    Exact && !Viewer && beyond_bits(config_i.depth_rest, F + 9),
    Cells && beyond_bits(config_i.cell_half, W),
    Cells && Grid == GridSquare && beyond_bits(config_i.cell_half_y, W),
    Cells && Grid == GridHex && beyond_bits(config_i.cell_rise, Wf),
    Cells && Shear && beyond_bits(config_i.shear_lean, W),
    Walk > 0 && (beyond_bits(config_i.cell_pitch_x, W) || beyond_bits(config_i.cell_pitch_y, W)),
    Walk > 0 && Shear && beyond_bits(config_i.shear_row, W),
    Converge && beyond_bits(config_i.converge_share, F + 9),
    Converge && (beyond_bits(config_i.converge_x, F + 9) || beyond_bits(config_i.converge_y, F + 9)),
    Shear && beyond_bits(config_i.shear_x, Wf),
    beyond_bits(config_i.extent_i, IndexBits + 2) || beyond_bits(config_i.extent_j, IndexBits + 1)
  };
  always_ff @(posedge clk_i) begin
    unfit_q <= unfit_d;
    unfit_q2 <= |unfit_q;
  end
  // Each build uses only some of the fields.
  logic unused_config;
  assign unused_config = ^config_i;

  // ---- pixel, panel, lenslet ----
  logic signed [L-1:0] lattice_x, lattice_y;
  logic lattice_beyond, lattice_beyond_late, index_beyond, own_beyond;
  lipp_delay #(.Width(1), .Cycles(lenslet_latency(Grid))) i_lattice_beyond (
    .clk_i, .d_i(lattice_beyond), .q_o(lattice_beyond_late)
  );
  assign own_beyond = lattice_beyond_late || index_beyond;
  lipp_pixel_to_lattice #(.F(F)) i_pixel_to_lattice (
    .clk_i, .u_i, .v_i,
    .x_from_u_i(config_i.x_from_u), .x_from_v_i(config_i.x_from_v),
    .x_offset_i(config_i.x_offset),
    .y_from_u_i(config_i.y_from_u), .y_from_v_i(config_i.y_from_v),
    .y_offset_i(config_i.y_offset),
    .x_o(lattice_x), .y_o(lattice_y), .beyond_o(lattice_beyond)
  );

  logic signed [IndexBits-1:0] own_i, own_j;
  logic signed [W-1:0] own_x, own_y;
  if (Grid == GridHex) begin : gen_hex
    lipp_lenslet_hex #(.F(F)) i_lenslet (
      .clk_i, .x_i(lattice_x), .y_i(lattice_y),
      .i_o(own_i), .j_o(own_j), .x_o(own_x), .y_o(own_y), .beyond_o(index_beyond)
    );
  end else begin : gen_square
    lipp_lenslet_square #(.F(F)) i_lenslet (
      .clk_i, .x_i(lattice_x), .y_i(lattice_y),
      .i_o(own_i), .j_o(own_j), .x_o(own_x), .y_o(own_y), .beyond_o(index_beyond)
    );
  end

  // ---- aperture point ----
  localparam int AimAt = lens_latency(F, Grid, Aims, 1'b0, 1'b0);
  logic signed [IndexBits-1:0] aim_i, aim_j;
  logic signed [W-1:0] aim_x, aim_y, aim_a, aim_b;
  logic aim_stray, aim_beyond;
  if (Aims) begin : gen_aim
    logic signed [W-1:0] a_late, b_late;
    logic own_beyond_late, outside;
    lipp_delay #(.Width(1), .Cycles(aim_latency(Grid))) i_beyond_match (
      .clk_i, .d_i(own_beyond), .q_o(own_beyond_late)
    );
    assign aim_beyond = own_beyond_late || outside;
    lipp_delay #(.Width(2 * W), .Cycles(pixel_latency() + lenslet_latency(Grid))) i_aim_match (
      .clk_i, .d_i({a_i, b_i}), .q_o({a_late, b_late})
    );
    lipp_aim #(.F(F), .Grid(Grid)) i_aim (
      .clk_i, .i_i(own_i), .j_i(own_j), .x_i(own_x), .y_i(own_y), .a_i(a_late), .b_i(b_late),
      .i_o(aim_i), .j_o(aim_j), .x_o(aim_x), .y_o(aim_y), .a_o(aim_a), .b_o(aim_b),
      .stray_o(aim_stray), .beyond_o(outside)
    );
  end else begin : gen_chief
    assign {aim_i, aim_j, aim_x, aim_y} = {own_i, own_j, own_x, own_y};
    assign aim_a = '0;
    assign aim_b = '0;
    assign aim_stray = 1'b0;
    assign aim_beyond = own_beyond;
    logic unused_aim;
    assign unused_aim = ^{a_i, b_i};
  end

  // ---- the pixel relative to that lenslet ----
  localparam int LocalAt = lens_latency(F, Grid, Aims, Converge, 1'b0);
  localparam int Wc = local_bits(F, Converge, 1'b0);
  logic signed [IndexBits-1:0] local_i, local_j;
  logic signed [W-1:0] local_a, local_b;
  logic signed [Wc-1:0] local_x, local_y;
  logic local_stray, local_beyond;
  lipp_delay #(.Width(2 * IndexBits + 2 * W + 1), .Cycles(LocalAt - AimAt)) i_local_match (
    .clk_i, .d_i({aim_i, aim_j, aim_a, aim_b, aim_stray}),
    .q_o({local_i, local_j, local_a, local_b, local_stray})
  );
  if (Converge) begin : gen_converge
    logic outside, beyond_late;
    lipp_converge #(.F(F), .CrossCells(CrossCells), .Grid(Grid)) i_converge (
      .clk_i, .i_i(aim_i), .j_i(aim_j), .x_i(aim_x), .y_i(aim_y),
      .share_i(config_i.converge_share[F+8:0]),
      .offset_x_i(config_i.converge_x[F+8:0]), .offset_y_i(config_i.converge_y[F+8:0]),
      .x_o(local_x), .y_o(local_y), .beyond_o(outside)
    );
    lipp_delay #(.Width(1), .Cycles(LocalAt - AimAt)) i_beyond_match (
      .clk_i, .d_i(aim_beyond), .q_o(beyond_late)
    );
    assign local_beyond = beyond_late || outside;
  end else begin : gen_parallel
    assign {local_x, local_y, local_beyond} = {aim_x, aim_y, aim_beyond};
  end

  // ---- along the rows: pixel and aperture point upright ----
  localparam int LensAt = lens_latency(F, Grid, Aims, Converge, Shear);
  localparam int Wx = local_bits(F, Converge, Shear);
  localparam int Wa = local_bits(F, 1'b0, Shear);
  logic signed [IndexBits-1:0] lens_i, lens_j;
  logic signed [Wa-1:0] a, b;
  logic signed [Wx-1:0] x, y;
  logic stray, beyond;
  if (Shear) begin : gen_shear
    logic signed [W-1:0] b_late;
    logic signed [Wc-1:0] y_late;
    logic outside_x, outside_a, beyond_late;
    lipp_delay #(.Width(2 * IndexBits + Wc + W + 2), .Cycles(LensAt - LocalAt)) i_lens_match (
      .clk_i, .d_i({local_i, local_j, local_y, local_b, local_stray, local_beyond}),
      .q_o({lens_i, lens_j, y_late, b_late, stray, beyond_late})
    );
    lipp_shear #(.F(F), .CrossCells(CrossCells), .Wx(Wc)) i_shear_x (
      .clk_i, .x_i(local_x), .y_i(local_y), .g_i(config_i.shear_x[F+3:0]),
      .x_o(x), .beyond_o(outside_x)
    );
    if (Aims) begin : gen_aimed
      lipp_shear #(.F(F), .CrossCells(CrossCells), .Wx(W)) i_shear_a (
        .clk_i, .x_i(local_a), .y_i(local_b), .g_i(config_i.shear_x[F+3:0]),
        .x_o(a), .beyond_o(outside_a)
      );
    end else begin : gen_centre
      assign a = '0;
      assign outside_a = 1'b0;
      logic unused_a;
      assign unused_a = ^local_a;
    end
    assign y = Wx'(y_late);
    assign b = Wa'(b_late);
    assign beyond = beyond_late || outside_x || outside_a;
  end else begin : gen_upright
    assign {lens_i, lens_j, a, b, stray, beyond} =
        {local_i, local_j, local_a, local_b, local_stray, local_beyond};
    assign {x, y} = {local_x, local_y};
  end

  // ---- lenslets that the array has: the pixel's ----
  // Where rays do not leave their lenslet the test of the exit's is enough.
  localparam bit Elsewhere = Aims || Walk > 0;
  localparam int OwnAt = pixel_latency() + lenslet_latency(Grid);
  logic own_missing;
  if (Elsewhere) begin : gen_own_extent
    logic missing;
    lipp_extent #(.Grid(Grid)) i_extent (
      .clk_i, .i_i(own_i), .j_i(own_j), .along_i(config_i.extent_i[IndexBits+1:0]),
      .across_i(config_i.extent_j[IndexBits:0]), .missing_o(missing)
    );
    lipp_delay #(.Width(1), .Cycles(LensAt - OwnAt)) i_own_match (
      .clk_i, .d_i(missing), .q_o(own_missing)
    );
  end else begin : gen_exit_extent
    assign own_missing = 1'b0;
  end

  // ---- slope of the ray, and its point on the first face ----
  localparam int SlopeAt = LensAt + slope_latency(F, Converge, Shear);
  // The exact slope follows from a - x; otherwise there is a coefficient for each of a and x.
  localparam bit Difference = Model == ModelExact && !Converge;
  logic signed [Wx:0] towards_x_d, towards_y_d;
  logic signed [Wa-1:0] a_q, b_q;
  logic signed [Wx-1:0] x_q, y_q, from_x_q, from_y_q;
  logic stray_q, beyond_q;
  assign towards_x_d = (Wx + 1)'(a) - (Wx + 1)'(x);
  assign towards_y_d = (Wx + 1)'(b) - (Wx + 1)'(y);
  always_ff @(posedge clk_i) begin
    {x_q, y_q, a_q, b_q, stray_q} <= {x, y, a, b, stray};
    from_x_q <= Difference ? Wx'(towards_x_d) : x;
    from_y_q <= Difference ? Wx'(towards_y_d) : y;
    beyond_q <= beyond || unfit_q2 || (!Converge && (towards_x_d[Wx] != towards_x_d[Wx-1]
        || towards_y_d[Wx] != towards_y_d[Wx-1]));
  end

  logic signed [Wm-1:0] mx, my;
  logic signed [Wh-1:0] hx, hy;
  logic [3:0] blend_beyond;
  lipp_blend #(.F(F), .CrossCells(CrossCells), .Second(SlopeAims), .Wx(Wx), .Wa(Wa), .Wk(Wm)) i_mx (
    .clk_i, .k_i(config_i.slope_x[Wm-1:0]), .x_i(from_x_q),
    .l_i(config_i.slope_aim_x[Wm-1:0]), .a_i(a_q), .y_o(mx), .beyond_o(blend_beyond[0])
  );
  lipp_blend #(.F(F), .CrossCells(CrossCells), .Second(SlopeAims), .Wx(Wx), .Wa(Wa), .Wk(Wm)) i_my (
    .clk_i, .k_i(config_i.slope_y[Wm-1:0]), .x_i(from_y_q),
    .l_i(config_i.slope_aim_y[Wm-1:0]), .a_i(b_q), .y_o(my), .beyond_o(blend_beyond[1])
  );
  if (Model == ModelPinhole) begin : gen_centre
    assign hx = '0;
    assign hy = '0;
    assign blend_beyond[3:2] = '0;
    logic unused_point;
    assign unused_point = ^{x_q, y_q};
  end else begin : gen_point
    lipp_blend #(
      .F(F), .CrossCells(CrossCells), .Second(Aims), .Wx(Wx), .Wa(Wa), .Wy(Wh)
    ) i_hx (
      .clk_i, .k_i(config_i.point_x[W-1:0]), .x_i(x_q),
      .l_i(config_i.point_aim_x[W-1:0]), .a_i(a_q), .y_o(hx), .beyond_o(blend_beyond[2])
    );
    lipp_blend #(
      .F(F), .CrossCells(CrossCells), .Second(Aims), .Wx(Wx), .Wa(Wa), .Wy(Wh)
    ) i_hy (
      .clk_i, .k_i(config_i.point_y[W-1:0]), .x_i(y_q),
      .l_i(config_i.point_aim_y[W-1:0]), .a_i(b_q), .y_o(hy), .beyond_o(blend_beyond[3])
    );
  end

  localparam int UnitAt = SlopeAt + unit_latency(F);
  logic signed [Wm-1:0] ex, ey, ez;
  logic steep;
  lipp_unit_slope #(.F(F), .Extra(Air), .CrossCells(CrossCells)) i_unit_slope (
    .clk_i, .mx_i(mx), .my_i(my), .ex_o(ex), .ey_o(ey), .ez_o(ez), .beyond_o(steep)
  );

  // ---- delays to the end of the pipeline ----
  localparam int OutAt = ray_latency(F, Grid, Model, Viewer, Aims, Walk, Converge, Shear) - 2;
  logic stray_after, beyond_after, stray_late, beyond_late, own_missing_late;
  lipp_delay #(.Width(2), .Cycles(extent_latency() - 1)) i_flags_match (
    .clk_i, .d_i({stray_q, beyond_q}), .q_o({stray_after, beyond_after})
  );
  lipp_delay #(.Width(3), .Cycles(OutAt - LensAt - extent_latency())) i_flags (
    .clk_i, .d_i({stray_after, beyond_after, own_missing}),
    .q_o({stray_late, beyond_late, own_missing_late})
  );

  // ---- through the lenslet ----
  localparam int Early = extent_latency() - 1;  // so that the test ends a clock after OutAt
  logic signed [IndexBits-1:0] early_i, early_j, out_i, out_j;  // the former before the others
  logic signed [Wf-1:0] out_x, out_y, out_z;
  logic signed [W-1:0] out_dx, out_dy, out_dz;
  logic out_missed, out_beyond, out_reflected, out_crosstalk;

  if (Model != ModelExact) begin : gen_ideal
    lipp_delay #(.Width(2 * IndexBits), .Cycles(OutAt - LensAt - Early)) i_lens (
      .clk_i, .d_i({lens_i, lens_j}), .q_o({early_i, early_j})
    );
    logic signed [Wh-1:0] hx_late, hy_late;
    logic blend_beyond_late;
    lipp_delay #(.Width(2 * Wh + 1), .Cycles(unit_latency(F))) i_h (
      .clk_i, .d_i({hx, hy, |blend_beyond}), .q_o({hx_late, hy_late, blend_beyond_late})
    );
    assign out_x = Wf'(hx_late) <<< 1;
    assign out_y = Wf'(hy_late) <<< 1;
    assign out_z = config_i.exit_z[Wf-1:0];
    assign {out_dx, out_dy, out_dz} = {ex, ey, ez};
    assign out_missed = 1'b0;
    assign out_beyond = blend_beyond_late || steep;
    assign out_reflected = 1'b0;
    assign out_crosstalk = stray_late && Model != ModelPinhole;
  end else begin : gen_exact
    // Direction at the dome, and the tangential part of n d.
    localparam int FirstAt = UnitAt + (Viewer ? 0 : enter_flat_latency(F));
    localparam int Wt = W + extra_bits(F);
    localparam int Wz = W + 3 * extra_bits(F);
    localparam int Wd = 2 * Wt + Wz;
    logic signed [Wt-1:0] first_dx, first_dy;
    logic signed [Wz-1:0] first_dz;
    logic first_beyond;
    if (Viewer) begin : gen_air
      assign first_dx = Wt'(ex) <<< (Wt - W);
      assign first_dy = Wt'(ey) <<< (Wt - W);
      assign first_dz = Wz'(ez) <<< (Wz - W);
      assign first_beyond = 1'b0;
    end else begin : gen_glass
      lipp_enter_flat #(.F(F), .CrossCells(CrossCells)) i_enter_flat (
        .clk_i, .ex_i(ex), .ey_i(ey), .index_inverse_i(config_i.index_inverse[W-1:0]),
        .tx_o(first_dx), .ty_o(first_dy), .dz_o(first_dz), .beyond_o(first_beyond)
      );
      logic unused_ez;
      assign unused_ez = ^ez;
    end

    // ---- further domes ----
    localparam int StepLatency = cell_step_latency(Grid, F, Shear);
    localparam int WalkLatency = walk_latency(Grid, F, Shear);
    localparam int MeetLatency = meet_dome_latency(F);
    localparam int LastAt = FirstAt + Walk * WalkLatency;  // the last dome's test starts here
    logic [Walk:0][Wh-1:0] walk_hx, walk_hy;
    logic [Walk:0][Wt-1:0] walk_dx, walk_dy;
    logic [Walk:0][Wz-1:0] walk_dz;
    logic [Walk:0][W-1:0] walk_nx, walk_ny, walk_nz, walk_cos;
    logic [Walk:0][IndexBits-1:0] walk_i, walk_j;
    logic [Walk:0][Wf-1:0] walk_s;
    logic [Walk:0] walk_missed, walk_beyond, meet_beyond;  // before the dome, and there
    logic blend_beyond_late;
    lipp_delay #(.Width(2 * Wh + 1), .Cycles(FirstAt - SlopeAt)) i_h (
      .clk_i, .d_i({hx, hy, |blend_beyond}), .q_o({walk_hx[0], walk_hy[0], blend_beyond_late})
    );
    assign walk_beyond[0] = blend_beyond_late || first_beyond;
    lipp_delay #(.Width(2 * IndexBits), .Cycles(FirstAt - LensAt)) i_lens (
      .clk_i, .d_i({lens_i, lens_j}), .q_o({walk_i[0], walk_j[0]})
    );
    assign {walk_dx[0], walk_dy[0], walk_dz[0]} = {first_dx, first_dy, first_dz};

    for (genvar k = 0; k <= Walk; k++) begin : gen_walk
      lipp_meet_dome #(.F(F), .CrossCells(CrossCells), .Upward(!Viewer)) i_meet_dome (
        .clk_i, .hx_i(walk_hx[k]), .hy_i(walk_hy[k]),
        .dx_i(walk_dx[k]), .dy_i(walk_dy[k]), .dz_i(walk_dz[k]),
        .zc_i(config_i.depth[Wf-1:0]), .oz_i(config_i.depth_rest[F+8:0]),
        .nx_o(walk_nx[k]), .ny_o(walk_ny[k]), .nz_o(walk_nz[k]),
        .cos_o(walk_cos[k]), .s_o(walk_s[k]), .missed_o(walk_missed[k]),
        .beyond_o(meet_beyond[k])
      );
      if (k < Walk) begin : gen_next
        logic signed [1:0] di, dj;
        logic signed [Wh-1:0] hx_late, hy_late;
        logic signed [IndexBits-1:0] i_late, j_late;
        logic met_beyond, beyond_before, moved_beyond, before_q;
        logic unused_inside;
        lipp_cell_step #(.F(F), .CrossCells(CrossCells), .Grid(Grid), .Shear(Shear)) i_cell_step (
          .clk_i, .nx_i(walk_nx[k]), .ny_i(walk_ny[k]), .half_i(config_i.cell_half[W-1:0]),
          .half_y_i(config_i.cell_half_y[W-1:0]), .rise_i(config_i.cell_rise[Wf-1:0]),
          .shear_i(config_i.shear_lean[W-1:0]),
          .di_o(di), .dj_o(dj), .inside_o(unused_inside)
        );
        lipp_delay #(.Width(2 * Wh), .Cycles(MeetLatency + StepLatency)) i_h_late (
          .clk_i, .d_i({walk_hx[k], walk_hy[k]}), .q_o({hx_late, hy_late})
        );
        lipp_move_lenslet #(.F(F), .Grid(Grid), .Shear(Shear)) i_move_lenslet (
          .clk_i, .hx_i(hx_late), .hy_i(hy_late), .di_i(di), .dj_i(dj),
          .cx_i(config_i.cell_pitch_x[W-1:0]), .cy_i(config_i.cell_pitch_y[W-1:0]),
          .rx_i(config_i.shear_row[W-1:0]),
          .hx_o(walk_hx[k+1]), .hy_o(walk_hy[k+1]), .beyond_o(moved_beyond)
        );
        lipp_delay #(.Width(2 * IndexBits + 1), .Cycles(MeetLatency + StepLatency)) i_lens_late (
          .clk_i, .d_i({walk_i[k], walk_j[k], walk_beyond[k]}), .q_o({i_late, j_late, beyond_before})
        );
        lipp_delay #(.Width(1), .Cycles(StepLatency)) i_met_beyond (
          .clk_i, .d_i(meet_beyond[k]), .q_o(met_beyond)
        );
        logic signed [IndexBits:0] i_q, j_q;
        logic index_beyond_q;
        always_ff @(posedge clk_i) begin
          i_q <= (IndexBits + 1)'(i_late) + (IndexBits + 1)'(di);
          j_q <= (IndexBits + 1)'(j_late) + (IndexBits + 1)'(dj);
          before_q <= beyond_before || met_beyond;
          walk_i[k+1] <= IndexBits'(i_q);
          walk_j[k+1] <= IndexBits'(j_q);
          index_beyond_q <= before_q || i_q[IndexBits] != i_q[IndexBits-1]
              || j_q[IndexBits] != j_q[IndexBits-1];
        end
        assign walk_beyond[k+1] = index_beyond_q || moved_beyond;
        lipp_delay #(.Width(Wd), .Cycles(WalkLatency)) i_d (
          .clk_i, .d_i({walk_dx[k], walk_dy[k], walk_dz[k]}),
          .q_o({walk_dx[k+1], walk_dy[k+1], walk_dz[k+1]})
        );
        logic unused_walk;
        assign unused_walk = ^{walk_nz[k], walk_cos[k], walk_s[k], walk_missed[k]};
      end
    end

    // ---- the dome that the ray meets ----
    localparam int DomeAt = LastAt + MeetLatency;
    logic signed [W-1:0] nx, ny, nz;
    logic signed [Wm-1:0] dome_ex, dome_ey;
    logic dome_steep;
    assign {nx, ny, nz} = {walk_nx[Walk], walk_ny[Walk], walk_nz[Walk]};
    lipp_delay #(.Width(2 * Wm + 1), .Cycles(DomeAt - UnitAt)) i_e (
      .clk_i, .d_i({ex, ey, steep}), .q_o({dome_ex, dome_ey, dome_steep})
    );
    logic inside_late, missed_late, reflected, walk_beyond_late, dome_beyond_late, leave_beyond;
    if (Strays) begin : gen_inside
      logic settled;
      logic [1:0] unused_di, unused_dj;
      lipp_cell_step #(.F(F), .CrossCells(CrossCells), .Grid(Grid), .Shear(Shear)) i_cell_step (
        .clk_i, .nx_i(nx), .ny_i(ny), .half_i(config_i.cell_half[W-1:0]),
        .half_y_i(config_i.cell_half_y[W-1:0]), .rise_i(config_i.cell_rise[Wf-1:0]),
        .shear_i(config_i.shear_lean[W-1:0]),
        .di_o(unused_di), .dj_o(unused_dj), .inside_o(settled)
      );
      lipp_delay #(.Width(1), .Cycles(OutAt - DomeAt - StepLatency)) i_inside (
        .clk_i, .d_i(settled), .q_o(inside_late)
      );
    end else begin : gen_own
      // A chief ray through the flat face stays in its lenslet.
      assign inside_late = 1'b1;
    end
    logic missed_early, dome_beyond_early, walk_beyond_early;
    lipp_delay #(.Width(2), .Cycles(OutAt - DomeAt - 1)) i_missed (
      .clk_i, .d_i({walk_missed[Walk], meet_beyond[Walk] || dome_steep}),
      .q_o({missed_early, dome_beyond_early})
    );
    always_ff @(posedge clk_i) {missed_late, dome_beyond_late} <= {missed_early, dome_beyond_early};
    lipp_delay #(.Width(2 * IndexBits + 1), .Cycles(OutAt - LastAt - Early)) i_lens_out (
      .clk_i, .d_i({walk_i[Walk], walk_j[Walk], walk_beyond[Walk]}),
      .q_o({early_i, early_j, walk_beyond_early})
    );
    lipp_delay #(.Width(1), .Cycles(Early)) i_walk_beyond (
      .clk_i, .d_i(walk_beyond_early), .q_o(walk_beyond_late)
    );

    if (Viewer) begin : gen_viewer
      localparam int GlassAt = DomeAt + dome_latency(F);
      logic signed [W-1:0] glass_dx, glass_dy, glass_nx, glass_ny, glass_nz;
      logic enter_beyond, enter_beyond_late, flat_beyond;
      assign leave_beyond = enter_beyond_late || flat_beyond;
      lipp_delay #(.Width(1), .Cycles(OutAt - GlassAt)) i_enter_beyond (
        .clk_i, .d_i(enter_beyond), .q_o(enter_beyond_late)
      );
      lipp_enter_dome #(.F(F), .CrossCells(CrossCells)) i_enter_dome (
        .clk_i, .nx_i(nx), .ny_i(ny), .cos_i(walk_cos[Walk]), .s_i(walk_s[Walk]),
        .ex_i(dome_ex), .ey_i(dome_ey),
        .index_inverse_i(config_i.index_inverse[W-1:0]),
        .index_inverse_square_i(config_i.index_inverse_square[Wf-1:0]),
        .dx_o(glass_dx), .dy_o(glass_dy), .beyond_o(enter_beyond)
      );
      lipp_delay #(.Width(3 * W), .Cycles(GlassAt - DomeAt)) i_n (
        .clk_i, .d_i({nx, ny, nz}), .q_o({glass_nx, glass_ny, glass_nz})
      );
      lipp_leave_flat #(.F(F), .CrossCells(CrossCells)) i_leave_flat (
        .clk_i, .nx_i(glass_nx), .ny_i(glass_ny), .nz_i(glass_nz),
        .dx_i(glass_dx), .dy_i(glass_dy), .zc_i(config_i.depth[Wf-1:0]),
        .index_i(config_i.index[W:0]), .index_square_i(config_i.index_square[Wf-1:0]),
        .x_o(out_x), .y_o(out_y), .dx_o(out_dx), .dy_o(out_dy), .dz_o(out_dz),
        .reflected_o(reflected), .beyond_o(flat_beyond)
      );
      assign out_z = config_i.exit_z[Wf-1:0];
      logic unused_dz;
      assign unused_dz = ^walk_dz[Walk];
    end else begin : gen_panel
      logic signed [Wz-1:0] dome_dz;
      logic signed [W-1:0] air_dx, air_dy, air_dz, air_dx_q, air_dy_q, air_dz_q;
      logic reflected_early, beyond_early, keep_q;
      logic signed [W-1:0] late_nx, late_ny, late_nz, glass_dx, glass_dy, glass_dz;
      lipp_delay #(.Width(Wz), .Cycles(DomeAt - LastAt)) i_dz (
        .clk_i, .d_i(walk_dz[Walk]), .q_o(dome_dz)
      );
      lipp_leave_dome #(.F(F), .CrossCells(CrossCells)) i_leave_dome (
        .clk_i, .nx_i(nx), .ny_i(ny), .nz_i(nz), .cos_i(walk_cos[Walk]), .s_i(walk_s[Walk]),
        .ex_i(dome_ex), .ey_i(dome_ey), .dz_i(dome_dz),
        .index_i(config_i.index[W:0]), .index_square_i(config_i.index_square[Wf-1:0]),
        .dx_o(air_dx), .dy_o(air_dy), .dz_o(air_dz), .reflected_o(reflected_early),
        .beyond_o(beyond_early)
      );
      lipp_delay #(.Width(3 * W), .Cycles(OutAt - DomeAt)) i_n (
        .clk_i, .d_i({nx, ny, nz}), .q_o({late_nx, late_ny, late_nz})
      );
      // The direction in the glass, rounded to near words.
      logic signed [W-1:0] round_dx_q, round_dy_q, round_dz_q;
      logic [Wz-1:0] round_dz;
      assign round_dz = (walk_dz[Walk] + Wz'((1 << (Wz - W)) >> 1)) >> (Wz - W);
      always_ff @(posedge clk_i) begin
        round_dx_q <= W'(($signed(walk_dx[Walk]) + Wt'(Wt - W)) >>> (Wt - W));
        round_dy_q <= W'(($signed(walk_dy[Walk]) + Wt'(Wt - W)) >>> (Wt - W));
        round_dz_q <= round_dz[W-1] ? {1'b0, {(W - 1){1'b1}}} : round_dz[W-1:0];  // 1 overflows
      end
      lipp_delay #(.Width(3 * W), .Cycles(OutAt - LastAt - 1)) i_glass (
        .clk_i, .d_i({round_dx_q, round_dy_q, round_dz_q}), .q_o({glass_dx, glass_dy, glass_dz})
      );
      assign out_x = Wf'(late_nx);
      assign out_y = Wf'(late_ny);
      assign out_z = Wf'(late_nz) - (Wf'(1) <<< (F + 1));
      // A totally reflected ray keeps its direction in the glass.
      always_ff @(posedge clk_i) begin
        keep_q <= reflected_early || missed_early;
        reflected <= reflected_early;
        leave_beyond <= beyond_early;
        {air_dx_q, air_dy_q, air_dz_q} <= {air_dx, air_dy, air_dz};
      end
      assign {out_dx, out_dy, out_dz} =
          keep_q ? {glass_dx, glass_dy, glass_dz} : {air_dx_q, air_dy_q, air_dz_q};
    end

    // ---- its status ----
    logic signed [IndexBits-1:0] own_i_late, own_j_late;
    if (Walk > 0) begin : gen_own_late
      lipp_delay #(
        .Width(2 * IndexBits), .Cycles(OutAt - OwnAt)
      ) i_own (
        .clk_i, .d_i({own_i, own_j}), .q_o({own_i_late, own_j_late})
      );
    end else begin : gen_aimed
      assign {own_i_late, own_j_late} = '0;
    end
    assign out_missed = missed_late || !inside_late;
    assign out_beyond = walk_beyond_late || dome_beyond_late || leave_beyond;
    assign out_reflected = reflected;
    assign out_crosstalk = Walk > 0 ? out_i != own_i_late || out_j != own_j_late : stray_late;
    logic unused_late;
    assign unused_late = stray_late ^ (^{own_i_late, own_j_late});
  end

  // ---- lenslets that the array has: the exit's ----
  logic exit_missing, own_missing_q;
  lipp_extent #(.Grid(Grid)) i_extent (
    .clk_i, .i_i(early_i), .j_i(early_j), .along_i(config_i.extent_i[IndexBits+1:0]),
    .across_i(config_i.extent_j[IndexBits:0]), .missing_o(exit_missing)
  );
  lipp_delay #(.Width(2 * IndexBits), .Cycles(Early)) i_out_match (
    .clk_i, .d_i({early_i, early_j}), .q_o({out_i, out_j})
  );

  // ---- exit ray, and its status ----
  logic signed [IndexBits-1:0] i_q, j_q;
  logic signed [Wf-1:0] x_q2, y_q2, z_q2;
  logic signed [W-1:0] dx_q2, dy_q2, dz_q2;
  logic missed_q, beyond_q2, reflected_q, blocked_q, crosstalk_q;
  always_ff @(posedge clk_i) begin
    own_missing_q <= own_missing_late;
    beyond_q2 <= out_beyond || beyond_late;
    {i_q, j_q, x_q2, y_q2, z_q2, dx_q2, dy_q2, dz_q2} <=
        {out_i, out_j, out_x, out_y, out_z, out_dx, out_dy, out_dz};
    {missed_q, reflected_q, blocked_q, crosstalk_q} <=
        {out_missed, out_reflected, out_dz[W-1], out_crosstalk};
    {i_o, j_o, x_o, y_o, z_o, dx_o, dy_o, dz_o} <=
        {i_q, j_q, x_q2, y_q2, z_q2, dx_q2, dy_q2, dz_q2};
    if (own_missing_q || exit_missing) status_o <= StatusBlocked;
    else if (missed_q || beyond_q2) status_o <= StatusMissed;
    else if (reflected_q) status_o <= StatusInternalReflection;
    else if (blocked_q || dz_q2 == '0) status_o <= StatusBlocked;
    else if (crosstalk_q) status_o <= StatusCrosstalk;
    else status_o <= StatusOk;
  end

endmodule

`default_nettype wire
