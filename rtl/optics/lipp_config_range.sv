// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Checks the optics registers: reports that a register of 32 bits contains a value that needs more
/// bits than the build uses.
///
/// If unfit_o is high, the pipeline marks every ray as missed. The latency is 3 clocks. Optics
/// change only while the pipeline is empty, and the latency of the pipeline is longer than 3
/// clocks, so the report is in time for the first ray.
module lipp_config_range #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare
) (
  input  logic                            clk_i,
  input  lipp_optics_pkg::optics_config_t config_i,
  output logic                            unfit_o
);
  import lipp_optics_pkg::*;

  localparam int F = int'(Build.fraction_bits);
  localparam int W = F + 2;
  localparam int Wm = W + air_bits(Build);
  localparam int Wf = W + 2;
  localparam int Model = int'(Build.model);
  localparam bit Aims = Build.aims;
  localparam bit Converge = Build.converge;
  localparam bit Shear = Build.shear;
  localparam bit Viewer = Build.viewer;
  localparam bit Walks = Build.walk > 0;
  localparam bit Exact = Model == ModelExact;
  localparam bit SlopeAims = slope_aims(Build);
  localparam bit Cells = Exact && strays(Build);
  localparam int Grid = int'(Build.grid);

  // A second register stage shortens the wires from configuration registers far apart on the chip.
  logic [27:0] unfit_d, unfit_q, unfit_q2;
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
    Walks && beyond_bits(config_i.cell_pitch_x, W), Walks && beyond_bits(config_i.cell_pitch_y, W),
    Walks && Shear && beyond_bits(config_i.shear_row, W),
    Converge && beyond_bits(config_i.converge_share, F + 9),
    Converge && beyond_bits(config_i.converge_x, F + 9),
    Converge && beyond_bits(config_i.converge_y, F + 9),
    Shear && beyond_bits(config_i.shear_x, Wf),
    beyond_bits(config_i.extent_i, IndexBits + 2), beyond_bits(config_i.extent_j, IndexBits + 1)
  };
  always_ff @(posedge clk_i) begin
    unfit_q <= unfit_d;
    unfit_q2 <= unfit_q;
    unfit_o <= |unfit_q2;
  end
  // A build uses only some fields of config_i.
  logic unused_config;
  assign unused_config = ^config_i;

endmodule

`default_nettype wire
