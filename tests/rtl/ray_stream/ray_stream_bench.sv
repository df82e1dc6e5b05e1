/// ray_stream with its words packed, first port highest, and the latency that it claims.
module ray_stream_bench #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic                                     clk_i,
  input  logic                                     rst_ni,
  input  logic [$bits(lipp_optics_pkg::optics_config_t)-1:0] config_i,
  input  logic                                     apply_i,
  output logic                                     busy_o,
  output logic                                     idle_o,
  input  logic                                     valid_i,
  output logic                                     ready_o,
  input  logic [2*lipp_optics_pkg::PixelBits+2*(F+2)-1:0] ray_i,
  output logic                                     valid_o,
  input  logic                                     ready_i,
  output logic [2*lipp_optics_pkg::IndexBits+3*(F+4)+3*(F+2)+2:0] exit_o,
  output int                                       latency_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  logic signed [PixelBits-1:0] u, v;
  logic signed [W-1:0] a, b, dx, dy, dz;
  logic signed [IndexBits-1:0] i, j;
  logic signed [W+1:0] x, y, z;
  ray_status_e status;
  assign {u, v, a, b} = ray_i;
  assign exit_o = {i, j, x, y, z, dx, dy, dz, status};
  assign latency_o = ray_latency(Build) + 5;
  lipp_ray_stream #(.Build(Build)) i_engine (
    .clk_i, .rst_ni, .config_i(config_i), .apply_i, .busy_o, .idle_o,
    .ray_valid_i(valid_i), .ray_ready_o(ready_o),
    .ray_u_i(u), .ray_v_i(v), .ray_a_i(a), .ray_b_i(b),
    .exit_valid_o(valid_o), .exit_ready_i(ready_i),
    .exit_i_o(i), .exit_j_o(j), .exit_x_o(x), .exit_y_o(y), .exit_z_o(z),
    .exit_dx_o(dx), .exit_dy_o(dy), .exit_dz_o(dz), .exit_status_o(status)
  );

endmodule
