// The two stream adapters; the rays of each as one word, the first port lowest.
module axis_bench #(
  parameter int F = 23
) (
  input  logic                        clk_i,
  input  logic                        rst_ni,

  input  logic                        s_axis_tvalid,
  output logic                        s_axis_tready,
  input  logic [127:0]                s_axis_tdata,
  input  logic                        s_axis_tlast,
  input  logic                        s_axis_tuser,
  output logic                        ray_valid_o,
  input  logic                        ray_ready_i,
  output logic [2*18+2*(F+2)+1:0]     ray_o,  // u, v, a, b, first, last

  input  logic                        exit_valid_i,
  output logic                        exit_ready_o,
  input  logic [24+6*(F+2)+6+3+1:0]   exit_i,  // i, j, x, y, z, dx, dy, dz, status, first, last
  output logic                        m_axis_tvalid,
  input  logic                        m_axis_tready,
  output logic [255:0]                m_axis_tdata,
  output logic                        m_axis_tlast,
  output logic                        m_axis_tuser
);
  logic [17:0] u, v;
  logic [F+1:0] a, b, dx, dy, dz;
  logic [F+3:0] x, y, z;
  logic [11:0] i, j;
  logic [2:0] status;
  logic first, last, exit_first, exit_last;
  assign ray_o = {last, first, b, a, v, u};
  lipp_axis_to_rays #(.F(F)) i_in (
    .*, .ray_u_o(u), .ray_v_o(v), .ray_a_o(a), .ray_b_o(b), .ray_first_o(first), .ray_last_o(last)
  );
  assign {exit_last, exit_first, status, dz, dy, dx, z, y, x, j, i} = exit_i;
  lipp_axis_from_rays #(.F(F)) i_out (
    .*, .exit_i_i(i), .exit_j_i(j), .exit_x_i(x), .exit_y_i(y), .exit_z_i(z), .exit_dx_i(dx),
    .exit_dy_i(dy), .exit_dz_i(dz), .exit_status_i(lipp_optics_pkg::ray_status_e'(status)),
    .exit_first_i(exit_first), .exit_last_i(exit_last)
  );
endmodule
