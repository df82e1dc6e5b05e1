// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 5 of the ray trace: intersects the ray with the dome of the lenslet at which it aims, or
/// with the domes of neighbouring lenslets. The modules in order are, with those that only some
/// builds contain in parentheses:
///
///   meet_dome -> (cell_step -> move_lenslet -> meet_dome) x walk -> (cell_step).
///
/// If a ray meets a dome's sphere outside that dome's cell, the module tries the dome of the cell
/// that contains the intersection, up to `walk` times. The number formats are those of
/// `lipp_meet_dome`.
///
/// The outputs i_o and j_o (the lenslet of the last dome), the direction d and beyond_o (an
/// overflow at any dome) have a latency of walk x walk_latency(Grid, F, Shear) clocks. The results
/// of the last dome, n, cos_o, s_o, missed_o and meet_beyond_o, are valid meet_dome_latency(F)
/// clocks later. Output inside_o reports that the intersection is in the cell of the last dome. In
/// builds whose rays can leave their cell, inside_o is valid cell_step_latency(Grid, F, Shear)
/// clocks after the results of the last dome; in other builds inside_o is always 1.
module lipp_walk_domes #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits),
  localparam int Wt = F + 2 + lipp_optics_pkg::extra_bits(F),
  localparam int Wz = F + 2 + 3 * lipp_optics_pkg::extra_bits(F)
) (
  input  logic                                         clk_i,
  input  lipp_optics_pkg::optics_config_t              config_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] i_i,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] j_i,
  input  logic signed [F+2:0]                          hx_i,
  input  logic signed [F+2:0]                          hy_i,
  input  logic signed [Wt-1:0]                         dx_i,
  input  logic signed [Wt-1:0]                         dy_i,
  input  logic signed [Wz-1:0]                         dz_i,
  input  logic                                         beyond_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] i_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0] j_o,
  output logic signed [Wt-1:0]                         dx_o,
  output logic signed [Wt-1:0]                         dy_o,
  output logic signed [Wz-1:0]                         dz_o,
  output logic                                         beyond_o,
  output logic signed [F+1:0]                          nx_o,
  output logic signed [F+1:0]                          ny_o,
  output logic signed [F+1:0]                          nz_o,
  output logic signed [F+1:0]                          cos_o,
  output logic signed [F+3:0]                          s_o,
  output logic                                         missed_o,
  output logic                                         meet_beyond_o,
  output logic                                         inside_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wh = W + 1;
  localparam int Wf = W + 2;
  localparam int Grid = int'(Build.grid);
  localparam int Walk = int'(Build.walk);
  localparam bit Shear = Build.shear;
  localparam bit CrossCells = Build.cross_cells;
  localparam int StepLatency = cell_step_latency(Grid, F, Shear);
  localparam int WalkLatency = walk_latency(Grid, F, Shear);
  localparam int MeetLatency = meet_dome_latency(F);
  // A build uses only some fields of config_i.
  logic unused_config;
  assign unused_config = ^config_i;

  logic [Walk:0][Wh-1:0] hx, hy;
  logic [Walk:0][Wt-1:0] dx, dy;
  logic [Walk:0][Wz-1:0] dz;
  logic [Walk:0][W-1:0] nx, ny, nz, cos;
  logic [Walk:0][IndexBits-1:0] i, j;
  logic [Walk:0][Wf-1:0] s;
  logic [Walk:0] missed, beyond, meet_beyond;  // beyond[k]: overflow before dome k
  assign {i[0], j[0], hx[0], hy[0]} = {i_i, j_i, hx_i, hy_i};
  assign {dx[0], dy[0], dz[0], beyond[0]} = {dx_i, dy_i, dz_i, beyond_i};

  for (genvar k = 0; k <= Walk; k++) begin : gen_walk
    lipp_meet_dome #(.F(F), .CrossCells(CrossCells), .Upward(!Build.viewer)) i_meet_dome (
      .clk_i, .hx_i(hx[k]), .hy_i(hy[k]), .dx_i(dx[k]), .dy_i(dy[k]), .dz_i(dz[k]),
      .zc_i(config_i.depth[Wf-1:0]), .oz_i(config_i.depth_rest[F+8:0]),
      .nx_o(nx[k]), .ny_o(ny[k]), .nz_o(nz[k]), .cos_o(cos[k]), .s_o(s[k]),
      .missed_o(missed[k]), .beyond_o(meet_beyond[k])
    );
    if (k < Walk) begin : gen_next
      logic signed [1:0] di, dj;
      logic signed [Wh-1:0] hx_late, hy_late;
      logic signed [IndexBits-1:0] i_late, j_late;
      logic met_beyond, beyond_before, moved_beyond, before_q;
      logic unused_inside;
      lipp_cell_step #(.F(F), .CrossCells(CrossCells), .Grid(Grid), .Shear(Shear)) i_cell_step (
        .clk_i, .nx_i(nx[k]), .ny_i(ny[k]), .half_i(config_i.cell_half[W-1:0]),
        .half_y_i(config_i.cell_half_y[W-1:0]), .rise_i(config_i.cell_rise[Wf-1:0]),
        .shear_i(config_i.shear_lean[W-1:0]),
        .di_o(di), .dj_o(dj), .inside_o(unused_inside)
      );
      lipp_delay #(.Width(2 * Wh), .Cycles(MeetLatency + StepLatency)) i_h_late (
        .clk_i, .d_i({hx[k], hy[k]}), .q_o({hx_late, hy_late})
      );
      lipp_move_lenslet #(.F(F), .Grid(Grid), .Shear(Shear)) i_move_lenslet (
        .clk_i, .hx_i(hx_late), .hy_i(hy_late), .di_i(di), .dj_i(dj),
        .cx_i(config_i.cell_pitch_x[W-1:0]), .cy_i(config_i.cell_pitch_y[W-1:0]),
        .rx_i(config_i.shear_row[W-1:0]),
        .hx_o(hx[k+1]), .hy_o(hy[k+1]), .beyond_o(moved_beyond)
      );
      lipp_delay #(.Width(2 * IndexBits + 1), .Cycles(MeetLatency + StepLatency)) i_lens_late (
        .clk_i, .d_i({i[k], j[k], beyond[k]}), .q_o({i_late, j_late, beyond_before})
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
        i[k+1] <= IndexBits'(i_q);
        j[k+1] <= IndexBits'(j_q);
        index_beyond_q <= before_q || i_q[IndexBits] != i_q[IndexBits-1]
            || j_q[IndexBits] != j_q[IndexBits-1];
      end
      assign beyond[k+1] = index_beyond_q || moved_beyond;
      lipp_delay #(.Width(2 * Wt + Wz), .Cycles(WalkLatency)) i_d (
        .clk_i, .d_i({dx[k], dy[k], dz[k]}), .q_o({dx[k+1], dy[k+1], dz[k+1]})
      );
      logic unused_walk;
      assign unused_walk = ^{nz[k], cos[k], s[k], missed[k]};
    end
  end
  assign {i_o, j_o, dx_o, dy_o, dz_o, beyond_o} =
      {i[Walk], j[Walk], dx[Walk], dy[Walk], dz[Walk], beyond[Walk]};
  assign {nx_o, ny_o, nz_o, cos_o, s_o, missed_o, meet_beyond_o} =
      {nx[Walk], ny[Walk], nz[Walk], cos[Walk], s[Walk], missed[Walk], meet_beyond[Walk]};

  if (strays(Build)) begin : gen_inside
    logic [1:0] unused_di, unused_dj;
    lipp_cell_step #(.F(F), .CrossCells(CrossCells), .Grid(Grid), .Shear(Shear)) i_cell_step (
      .clk_i, .nx_i(nx_o), .ny_i(ny_o), .half_i(config_i.cell_half[W-1:0]),
      .half_y_i(config_i.cell_half_y[W-1:0]), .rise_i(config_i.cell_rise[Wf-1:0]),
      .shear_i(config_i.shear_lean[W-1:0]),
      .di_o(unused_di), .dj_o(unused_dj), .inside_o
    );
  end else begin : gen_own
    // If a chief ray enters through the flat face, it stays in its lenslet, so no cell is tested.
    assign inside_o = 1'b1;
  end

endmodule

`default_nettype wire
