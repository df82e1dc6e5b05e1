// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes all steps of the ray trace from pixel to exit ray, one ray per clock without stalls.
///
/// A ray first passes pixel_to_lens -> start_ray. The next modules depend on the lens model:
///
///   pinhole, paraxial:               no further module; the slope gives the exit ray
///   exact, plano side to the panel:  enter_flat -> walk_domes -> exit_dome
///   exact, plano side to the viewer: walk_domes -> exit_flat.
///
/// The input pixel (u_i to the right, v_i upward) is measured from the panel's centre, with 4
/// fraction bits. The input aperture point (a_i, b_i) is measured from the centre of the pixel's
/// lenslet, in pitches and rows, with F fraction bits. With Build.aims = 0 the aperture point is
/// ignored, and all rays are chief rays.
///
/// The output ray's origin is measured from the centre of lenslet (i, j), in radii, with F + 1
/// fraction bits. The output ray's unit direction has F + 1 fraction bits. The axes are the
/// array's; +z is to the viewer.
///
/// The status is a `ray_status_e`. If the pixel's own lenslet or the exit lenslet does not exist,
/// the ray is blocked. Otherwise the status missed takes precedence over total internal reflection,
/// blocked and crosstalk, in this order. The origin of a missed ray is undefined. A ray is also
/// missed if any word of its computation overflows, which the flag `beyond` reports. All rays are
/// missed if a register contains a value that does not fit the word that the build uses. A ray that
/// leaves the dome downward is blocked; the intersections of such a ray with neighbouring domes are
/// not computed.
///
/// Build.walk is the number of further domes tried when the ray meets a dome outside that dome's
/// cell; a ray that needs more domes is missed. Build.converge is for displays for a near eye,
/// where a pixel belongs to the lenslet through which the eye sees the pixel. Build.shear is for
/// lattices whose rows are shifted in proportion to the height of the row. Logic that a model or an
/// orientation does not use is not generated. The latency is ray_latency(Build) clocks.
module lipp_ray_pipeline #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic                                         clk_i,
  input  lipp_optics_pkg::optics_config_t              config_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] u_i,
  input  logic signed [lipp_optics_pkg::PixelBits-1:0] v_i,
  input  logic signed [F+1:0]                          a_i,
  input  logic signed [F+1:0]                          b_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] i_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] j_o,
  output logic signed [F+3:0]                          x_o,
  output logic signed [F+3:0]                          y_o,
  output logic signed [F+3:0]                          z_o,
  output logic signed [F+1:0]                          dx_o,
  output logic signed [F+1:0]                          dy_o,
  output logic signed [F+1:0]                          dz_o,
  output lipp_optics_pkg::ray_status_e                 status_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wh = W + 1;
  localparam int Wf = W + 2;
  localparam int Grid = int'(Build.grid);
  localparam int Model = int'(Build.model);
  localparam int Walk = int'(Build.walk);
  localparam bit Viewer = Build.viewer;

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_ray_pipeline: Build.fraction_bits must be 14 to 23");
  end
  if (Model > ModelExact) begin : gen_illegal_model
    $fatal(1, "lipp_ray_pipeline: Build.model must be ModelPinhole, ModelParaxial or ModelExact");
  end
  if (Viewer && Model != ModelExact) begin : gen_illegal_viewer
    $fatal(1, "lipp_ray_pipeline: Build.viewer must be 0 except for ModelExact");
  end
  if (Build.aims && Model == ModelPinhole) begin : gen_illegal_aims
    $fatal(1, "lipp_ray_pipeline: Build.aims must be 0 for ModelPinhole, the chief ray");
  end
  if (Walk > 4
      || (Walk > 0 && (Model != ModelExact || !strays(Build)))) begin : gen_illegal_walk
    $fatal(1, "lipp_ray_pipeline: Build.walk must be 0, or up to 4 if exact rays leave the cell");
  end

  logic unfit;
  lipp_config_range #(.Build(Build)) i_config_range (.clk_i, .config_i, .unfit_o(unfit));
  // A build uses only some fields of config_i.
  logic unused_config;
  assign unused_config = ^config_i;

  // ---- find the lenslet at which the ray aims, and start the ray at the first face ----
  localparam int OwnAt = pixel_latency() + lenslet_latency(Grid);
  localparam int LensAt = lens_latency(F, Grid, Build.aims, Build.converge, Build.shear);
  localparam int SlopeAt = LensAt + slope_latency(F, Build.converge, Build.shear);
  localparam int UnitAt = SlopeAt + unit_latency(F);
  localparam int Wx = local_bits(F, Build.converge, Build.shear);
  localparam int Wa = local_bits(F, 1'b0, Build.shear);
  logic signed [IndexBits-1:0] own_i, own_j, lens_i, lens_j;
  logic signed [Wx-1:0] x, y;
  logic signed [Wa-1:0] a, b;
  logic stray, beyond, own_missing;
  lipp_pixel_to_lens #(.Build(Build)) i_pixel_to_lens (
    .clk_i, .config_i, .u_i, .v_i, .a_i, .b_i, .own_i_o(own_i), .own_j_o(own_j),
    .i_o(lens_i), .j_o(lens_j), .x_o(x), .y_o(y), .a_o(a), .b_o(b),
    .stray_o(stray), .beyond_o(beyond), .missing_o(own_missing)
  );
  logic signed [Wh-1:0] hx, hy;
  localparam int Wm = W + air_bits(Build);
  logic signed [Wm-1:0] ex, ey, ez;
  logic difference, flat_beyond, steep;
  lipp_start_ray #(.Build(Build)) i_start_ray (
    .clk_i, .config_i, .x_i(x), .y_i(y), .a_i(a), .b_i(b), .difference_o(difference),
    .hx_o(hx), .hy_o(hy), .flat_beyond_o(flat_beyond),
    .ex_o(ex), .ey_o(ey), .ez_o(ez), .steep_o(steep)
  );

  // ---- delay flags to the end of the pipeline ----
  localparam int OutAt = ray_latency(Build) - 2;
  logic stray_q, beyond_q, stray_after, beyond_after, stray_late, beyond_late, own_missing_late;
  always_ff @(posedge clk_i) {stray_q, beyond_q} <= {stray, beyond || unfit};
  lipp_delay #(.Width(2), .Cycles(extent_latency() - 1)) i_flags_match (
    .clk_i, .d_i({stray_q, beyond_q || difference}), .q_o({stray_after, beyond_after})
  );
  lipp_delay #(.Width(3), .Cycles(OutAt - LensAt - extent_latency())) i_flags (
    .clk_i, .d_i({stray_after, beyond_after, own_missing}),
    .q_o({stray_late, beyond_late, own_missing_late})
  );

  // ---- trace the ray through the lenslet ----
  localparam int Early = extent_latency() - 1;  // latency of lipp_extent minus 1
  logic signed [IndexBits-1:0] early_i, early_j, out_i, out_j;  // early: Early clocks before out
  logic signed [Wf-1:0] out_x, out_y, out_z;
  logic signed [W-1:0] out_dx, out_dy, out_dz;
  logic out_missed, out_beyond, out_reflected, out_crosstalk;

  if (Model != ModelExact) begin : gen_ideal
    lipp_delay #(.Width(2 * IndexBits), .Cycles(OutAt - LensAt - Early)) i_lens (
      .clk_i, .d_i({lens_i, lens_j}), .q_o({early_i, early_j})
    );
    logic signed [Wh-1:0] hx_late, hy_late;
    logic flat_beyond_late;
    lipp_delay #(.Width(2 * Wh + 1), .Cycles(unit_latency(F))) i_h (
      .clk_i, .d_i({hx, hy, flat_beyond}), .q_o({hx_late, hy_late, flat_beyond_late})
    );
    assign out_x = Wf'(hx_late) <<< 1;
    assign out_y = Wf'(hy_late) <<< 1;
    assign out_z = config_i.exit_z[Wf-1:0];
    assign {out_dx, out_dy, out_dz} = {ex, ey, ez};
    assign out_missed = 1'b0;
    assign out_beyond = flat_beyond_late || steep;
    assign out_reflected = 1'b0;
    assign out_crosstalk = stray_late && Model != ModelPinhole;
    logic unused_own;
    assign unused_own = ^{own_i, own_j};
  end else begin : gen_exact
    // ---- refract the ray into the glass at the flat face ----
    localparam int FirstAt = UnitAt + (Viewer ? 0 : enter_flat_latency(F));
    localparam int Wt = W + extra_bits(F);
    localparam int Wz = W + 3 * extra_bits(F);
    logic signed [Wt-1:0] first_dx, first_dy;
    logic signed [Wz-1:0] first_dz;
    logic first_beyond;
    if (Viewer) begin : gen_air
      assign first_dx = Wt'(ex) <<< (Wt - W);
      assign first_dy = Wt'(ey) <<< (Wt - W);
      assign first_dz = Wz'(ez) <<< (Wz - W);
      assign first_beyond = 1'b0;
    end else begin : gen_glass
      lipp_enter_flat #(.F(F), .CrossCells(Build.cross_cells)) i_enter_flat (
        .clk_i, .ex_i(ex), .ey_i(ey), .index_inverse_i(config_i.index_inverse[W-1:0]),
        .tx_o(first_dx), .ty_o(first_dy), .dz_o(first_dz), .beyond_o(first_beyond)
      );
      logic unused_ez;
      assign unused_ez = ^ez;
    end

    // ---- intersect the ray with the dome, or with further domes ----
    localparam int LastAt = FirstAt + Walk * walk_latency(Grid, F, Build.shear);
    localparam int DomeAt = LastAt + meet_dome_latency(F);
    localparam int InsideAt =
        DomeAt + (strays(Build) ? cell_step_latency(Grid, F, Build.shear) : 0);
    logic signed [IndexBits-1:0] first_i, first_j, last_i, last_j;
    logic signed [Wh-1:0] first_hx, first_hy;
    logic signed [Wt-1:0] dx, dy;
    logic signed [Wz-1:0] dz;
    logic signed [W-1:0] nx, ny, nz, cos;
    logic signed [Wf-1:0] s;
    logic flat_beyond_late, walk_beyond, missed, meet_beyond, in_cell;
    lipp_delay #(.Width(2 * Wh + 1), .Cycles(FirstAt - SlopeAt)) i_h (
      .clk_i, .d_i({hx, hy, flat_beyond}), .q_o({first_hx, first_hy, flat_beyond_late})
    );
    lipp_delay #(.Width(2 * IndexBits), .Cycles(FirstAt - LensAt)) i_lens (
      .clk_i, .d_i({lens_i, lens_j}), .q_o({first_i, first_j})
    );
    lipp_walk_domes #(.Build(Build)) i_walk_domes (
      .clk_i, .config_i, .i_i(first_i), .j_i(first_j), .hx_i(first_hx), .hy_i(first_hy),
      .dx_i(first_dx), .dy_i(first_dy), .dz_i(first_dz),
      .beyond_i(flat_beyond_late || first_beyond),
      .i_o(last_i), .j_o(last_j), .dx_o(dx), .dy_o(dy), .dz_o(dz), .beyond_o(walk_beyond),
      .nx_o(nx), .ny_o(ny), .nz_o(nz), .cos_o(cos), .s_o(s), .missed_o(missed),
      .meet_beyond_o(meet_beyond), .inside_o(in_cell)
    );

    // ---- refract the ray from the dome to the viewer ----
    logic signed [Wm-1:0] dome_ex, dome_ey;
    logic dome_steep, exit_beyond;
    lipp_delay #(.Width(2 * Wm + 1), .Cycles(DomeAt - UnitAt)) i_e (
      .clk_i, .d_i({ex, ey, steep}), .q_o({dome_ex, dome_ey, dome_steep})
    );
    if (Viewer) begin : gen_viewer
      lipp_exit_flat #(.F(F), .CrossCells(Build.cross_cells)) i_exit_flat (
        .clk_i, .config_i, .nx_i(nx), .ny_i(ny), .nz_i(nz), .cos_i(cos), .s_i(s),
        .ex_i(dome_ex), .ey_i(dome_ey),
        .x_o(out_x), .y_o(out_y), .z_o(out_z), .dx_o(out_dx), .dy_o(out_dy), .dz_o(out_dz),
        .reflected_o(out_reflected), .beyond_o(exit_beyond)
      );
      logic unused_d;
      assign unused_d = ^{dx, dy, dz};
    end else begin : gen_panel
      lipp_exit_dome #(.F(F), .CrossCells(Build.cross_cells)) i_exit_dome (
        .clk_i, .config_i, .nx_i(nx), .ny_i(ny), .nz_i(nz), .cos_i(cos), .s_i(s),
        .ex_i(dome_ex), .ey_i(dome_ey), .dx_i(dx), .dy_i(dy), .dz_i(dz), .missed_i(missed),
        .x_o(out_x), .y_o(out_y), .z_o(out_z), .dx_o(out_dx), .dy_o(out_dy), .dz_o(out_dz),
        .reflected_o(out_reflected), .beyond_o(exit_beyond)
      );
    end

    // ---- delay the flags of the ray's status ----
    logic inside_late, missed_late, dome_beyond_late, walk_beyond_early, walk_beyond_late;
    logic signed [IndexBits-1:0] own_i_late, own_j_late;
    lipp_delay #(.Width(1), .Cycles(OutAt - InsideAt)) i_inside (
      .clk_i, .d_i(in_cell), .q_o(inside_late)
    );
    // This register precedes the long delay, whose memory may lie far away on the chip.
    logic met_missed_q, met_beyond_q;
    always_ff @(posedge clk_i) {met_missed_q, met_beyond_q} <= {missed, meet_beyond || dome_steep};
    lipp_delay #(.Width(2), .Cycles(OutAt - DomeAt - 1)) i_missed (
      .clk_i, .d_i({met_missed_q, met_beyond_q}), .q_o({missed_late, dome_beyond_late})
    );
    lipp_delay #(.Width(2 * IndexBits + 1), .Cycles(OutAt - LastAt - Early)) i_lens_out (
      .clk_i, .d_i({last_i, last_j, walk_beyond}), .q_o({early_i, early_j, walk_beyond_early})
    );
    lipp_delay #(.Width(1), .Cycles(Early)) i_walk_beyond (
      .clk_i, .d_i(walk_beyond_early), .q_o(walk_beyond_late)
    );
    if (Walk > 0) begin : gen_own_late
      lipp_delay #(.Width(2 * IndexBits), .Cycles(OutAt - OwnAt)) i_own (
        .clk_i, .d_i({own_i, own_j}), .q_o({own_i_late, own_j_late})
      );
    end else begin : gen_aimed
      assign {own_i_late, own_j_late} = '0;
      logic unused_own;
      assign unused_own = ^{own_i, own_j};
    end
    assign out_missed = missed_late || !inside_late;
    assign out_beyond = walk_beyond_late || dome_beyond_late || exit_beyond;
    assign out_crosstalk = Walk > 0 ? out_i != own_i_late || out_j != own_j_late : stray_late;
    logic unused_late;
    assign unused_late = stray_late ^ (^{own_i_late, own_j_late});
  end

  // ---- check if the lenslet of the exit exists ----
  logic exit_missing, own_missing_q;
  lipp_extent #(.Grid(Grid)) i_extent (
    .clk_i, .i_i(early_i), .j_i(early_j), .along_i(config_i.extent_i[IndexBits+1:0]),
    .across_i(config_i.extent_j[IndexBits:0]), .missing_o(exit_missing)
  );
  lipp_delay #(.Width(2 * IndexBits), .Cycles(Early)) i_out_match (
    .clk_i, .d_i({early_i, early_j}), .q_o({out_i, out_j})
  );

  // ---- output the exit ray and its status ----
  logic signed [IndexBits-1:0] i_q, j_q;
  logic signed [Wf-1:0] x_q2, y_q2, z_q2;
  logic signed [W-1:0] dx_q2, dy_q2, dz_q2;
  logic missed_q, beyond_q2, reflected_q, blocked_q, crosstalk_q;
  logic [1:0] flat_q;  // bits 0, 1: lower and upper half of dz are 0
  always_ff @(posedge clk_i) begin
    own_missing_q <= own_missing_late;
    beyond_q2 <= out_beyond || beyond_late;
    {i_q, j_q, x_q2, y_q2, z_q2, dx_q2, dy_q2, dz_q2} <=
        {out_i, out_j, out_x, out_y, out_z, out_dx, out_dy, out_dz};
    {missed_q, reflected_q, blocked_q, crosstalk_q} <=
        {out_missed, out_reflected, out_dz[W-1], out_crosstalk};
    flat_q <= {out_dz[W-1:W/2] == '0, out_dz[W/2-1:0] == '0};
    {i_o, j_o, x_o, y_o, z_o, dx_o, dy_o, dz_o} <=
        {i_q, j_q, x_q2, y_q2, z_q2, dx_q2, dy_q2, dz_q2};
    if (own_missing_q || exit_missing) status_o <= StatusBlocked;
    else if (missed_q || beyond_q2) status_o <= StatusMissed;
    else if (reflected_q) status_o <= StatusInternalReflection;
    else if (blocked_q || &flat_q) status_o <= StatusBlocked;
    else if (crosstalk_q) status_o <= StatusCrosstalk;
    else status_o <= StatusOk;
  end

endmodule

`default_nettype wire
