/// What place-and-route is given: the pipeline between registers that a few pins fill and read.
///
/// Every input of the pipeline comes from a shift register, every output goes into a folded one, so
/// that nothing is optimised away and no path to a pin counts.
module probe_top #(
  parameter int F = 23,
  parameter int Grid = optics_pkg::GridSquare,
  parameter int Model = optics_pkg::ModelExact,
  parameter bit Viewer = 1'b0,
  parameter bit Aims = 1'b0,
  parameter int Walk = 0
) (
  input  logic clk_i,
  input  logic bit_i,
  output logic bit_o
);
  import optics_pkg::*;

  localparam int W = F + 2;
  localparam int ConfigBits = $bits(optics_config_t);
  localparam int OutBits = 2 * IndexBits + 3 * (W + 2) + 3 * W + 3;

  logic [ConfigBits-1:0] config_q;
  logic [2*PixelBits+2*W-1:0] ray_q;
  logic [OutBits-1:0] out, out_q, fold_q;
  status_e status;
  always_ff @(posedge clk_i) begin
    config_q <= {config_q[ConfigBits-2:0], bit_i};
    ray_q <= {ray_q[2*PixelBits+2*W-2:0], config_q[ConfigBits-1]};
    out_q <= out;
    fold_q <= out_q ^ {fold_q[OutBits-2:0], 1'b0};
    bit_o <= fold_q[OutBits-1];
  end

  ray_pipeline #(
    .F(F), .Grid(Grid), .Model(Model), .Viewer(Viewer), .Aims(Aims), .Walk(Walk)
  ) i_pipeline (
    .clk_i, .config_i(config_q),
    .u_i(ray_q[2*W+PixelBits+:PixelBits]), .v_i(ray_q[2*W+:PixelBits]),
    .a_i(ray_q[W+:W]), .b_i(ray_q[0+:W]),
    .i_o(out[OutBits-1-:IndexBits]), .j_o(out[OutBits-IndexBits-1-:IndexBits]),
    .x_o(out[3+3*W+2*(W+2)+:W+2]), .y_o(out[3+3*W+(W+2)+:W+2]), .z_o(out[3+3*W+:W+2]),
    .dx_o(out[3+2*W+:W]), .dy_o(out[3+W+:W]), .dz_o(out[3+:W]),
    .status_o(status)
  );
  assign out[2:0] = status;

endmodule
