// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// The top for place-and-route of `lipp_optics_block`, between the registers of `probe`.
module probe_block #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o
);
  import lipp_optics_pkg::*;

  localparam int In = 3 + 9 + 32 + 1 + 2 * PixelBits + 2 * (F + 2) + 3;
  localparam int Out = 1 + 32 + 1 + 1 + 1 + 2 * IndexBits + 3 * (F + 4) + 3 * (F + 2) + 3 + 2 + $bits(optics_config_t);

  logic rst_n;
  logic [In-1:0] in;
  logic [Out-1:0] out;
  probe #(.In(In), .Out(Out)) i_probe (
    .clk_i, .rst_ni, .bit_i, .bit_o, .rst_no(rst_n), .in_o(in), .out_i(out)
  );

  logic sel, enable, write, valid, first, last, exit_ready;
  logic [8:0] addr;
  logic [31:0] wdata;
  logic signed [PixelBits-1:0] u, v;
  logic signed [F+1:0] a, b;
  assign {sel, enable, write, addr, wdata, valid, u, v, a, b, first, last, exit_ready} = in;

  logic apb_ready, error, ready, exit_valid, exit_first, exit_last;
  logic [31:0] rdata;
  logic signed [IndexBits-1:0] i, j;
  logic signed [F+3:0] x, y, z;
  logic signed [F+1:0] dx, dy, dz;
  ray_status_e status;
  optics_config_t optics;
  assign out = {
    apb_ready, rdata, error, ready, exit_valid, i, j, x, y, z, dx, dy, dz, status, exit_first,
    exit_last, optics
  };
  lipp_optics_block #(.Build(Build)) i_block (
    .clk_i, .rst_ni(rst_n), .apb_sel_i(sel), .apb_enable_i(enable), .apb_write_i(write),
    .apb_addr_i(addr), .apb_wdata_i(wdata), .apb_ready_o(apb_ready), .apb_rdata_o(rdata),
    .apb_error_o(error), .ray_valid_i(valid), .ray_ready_o(ready), .ray_u_i(u), .ray_v_i(v),
    .ray_a_i(a), .ray_b_i(b), .ray_first_i(first), .ray_last_i(last), .exit_valid_o(exit_valid),
    .exit_ready_i(exit_ready), .exit_i_o(i), .exit_j_o(j), .exit_x_o(x), .exit_y_o(y),
    .exit_z_o(z), .exit_dx_o(dx), .exit_dy_o(dy), .exit_dz_o(dz), .exit_status_o(status),
    .exit_first_o(exit_first), .exit_last_o(exit_last), .optics_o(optics)
  );

endmodule

`default_nettype wire
