// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Top for a place-and-route trial of `lipp_optics_block` with Wishbone, surrounded by the
/// registers of `probe`.
module probe_wishbone #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o
);
  import lipp_optics_pkg::*;

  localparam int In = 3 + 7 + 32 + 4 + 1 + 2 * PixelBits + 2 * (F + 2) + 3;
  localparam int Out = 32 + 2 + 2 + 2 * IndexBits + 3 * (F + 4) + 3 * (F + 2) + 3 + 2
      + $bits(optics_config_t);

  logic rst_n;
  logic [In-1:0] in;
  logic [Out-1:0] out;
  probe #(.In(In), .Out(Out)) i_probe (
    .clk_i, .rst_ni, .bit_i, .bit_o, .rst_no(rst_n), .in_o(in), .out_i(out)
  );

  // ---- connect the register port through the Wishbone bridge ----
  logic cyc, stb, we, ack, err;
  logic [8:2] adr;
  logic [31:0] dat_w, dat_r;
  logic [3:0] sel;
  logic psel, penable, pwrite, pready, pslverr;
  logic [2:0] pprot;
  logic [8:0] paddr;
  logic [31:0] pwdata, prdata;
  logic [3:0] pstrb;
  lipp_wishbone_to_apb i_registers (
    .clk_i, .rst_ni(rst_n), .s_wb_cyc(cyc), .s_wb_stb(stb), .s_wb_we(we), .s_wb_adr(adr),
    .s_wb_dat_w(dat_w), .s_wb_sel(sel), .s_wb_dat_r(dat_r), .s_wb_ack(ack), .s_wb_err(err),
    .m_apb_psel(psel), .m_apb_penable(penable), .m_apb_pwrite(pwrite), .m_apb_pprot(pprot),
    .m_apb_paddr(paddr), .m_apb_pwdata(pwdata), .m_apb_pstrb(pstrb), .m_apb_pready(pready),
    .m_apb_prdata(prdata), .m_apb_pslverr(pslverr)
  );

  // ---- connect the rays ----
  logic valid, ready, first, last, exit_valid, exit_ready, exit_first, exit_last;
  logic signed [PixelBits-1:0] u, v;
  logic signed [F+1:0] a, b;
  logic signed [IndexBits-1:0] i, j;
  logic signed [F+3:0] x, y, z;
  logic signed [F+1:0] dx, dy, dz;
  ray_status_e status;
  optics_config_t optics;
  assign {cyc, stb, we, adr, dat_w, sel, valid, u, v, a, b, first, last, exit_ready} = in;
  assign out = {
    dat_r, ack, err, ready, exit_valid, i, j, x, y, z, dx, dy, dz, status, exit_first, exit_last,
    optics
  };
  lipp_optics_block #(.Build(Build)) i_block (
    .clk_i, .rst_ni(rst_n), .s_apb_psel(psel), .s_apb_penable(penable), .s_apb_pwrite(pwrite),
    .s_apb_pprot(pprot), .s_apb_paddr(paddr), .s_apb_pwdata(pwdata), .s_apb_pstrb(pstrb),
    .s_apb_pready(pready), .s_apb_prdata(prdata), .s_apb_pslverr(pslverr), .ray_valid_i(valid),
    .ray_ready_o(ready), .ray_u_i(u), .ray_v_i(v), .ray_a_i(a), .ray_b_i(b), .ray_first_i(first),
    .ray_last_i(last), .exit_valid_o(exit_valid), .exit_ready_i(exit_ready), .exit_i_o(i),
    .exit_j_o(j), .exit_x_o(x), .exit_y_o(y), .exit_z_o(z), .exit_dx_o(dx), .exit_dy_o(dy),
    .exit_dz_o(dz), .exit_status_o(status), .exit_first_o(exit_first), .exit_last_o(exit_last),
    .optics_o(optics)
  );

endmodule

`default_nettype wire
