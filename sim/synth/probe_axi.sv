// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Top for a place-and-route trial of `lipp_optics_block` with AXI4-Lite and AXI4-Stream,
/// surrounded by the registers of `probe`.
module probe_axi #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o
);
  import lipp_optics_pkg::*;

  localparam int In = 2 * (9 + 3 + 1) + 32 + 4 + 1 + 2 + 128 + 3 + 1;
  localparam int Out = 5 + 2 + 2 + 32 + 1 + 256 + 3 + $bits(optics_config_t);

  logic rst_n;
  logic [In-1:0] in;
  logic [Out-1:0] out;
  probe #(.In(In), .Out(Out)) i_probe (
    .clk_i, .rst_ni, .bit_i, .bit_o, .rst_no(rst_n), .in_o(in), .out_i(out)
  );

  // ---- connect the register port through the AXI4-Lite bridge ----
  logic awvalid, awready, wvalid, wready, bvalid, bready, arvalid, arready, rvalid, rready;
  logic [8:0] awaddr, araddr;
  logic [2:0] awprot, arprot;
  logic [31:0] wdata, rdata;
  logic [3:0] wstrb;
  logic [1:0] bresp, rresp;
  logic psel, penable, pwrite, pready, pslverr;
  logic [2:0] pprot;
  logic [8:0] paddr;
  logic [31:0] pwdata, prdata;
  logic [3:0] pstrb;
  lipp_axil_to_apb i_registers (
    .clk_i, .rst_ni(rst_n), .s_axil_awvalid(awvalid), .s_axil_awready(awready),
    .s_axil_awaddr(awaddr), .s_axil_awprot(awprot), .s_axil_wvalid(wvalid),
    .s_axil_wready(wready), .s_axil_wdata(wdata), .s_axil_wstrb(wstrb), .s_axil_bvalid(bvalid),
    .s_axil_bready(bready), .s_axil_bresp(bresp), .s_axil_arvalid(arvalid),
    .s_axil_arready(arready), .s_axil_araddr(araddr), .s_axil_arprot(arprot),
    .s_axil_rvalid(rvalid), .s_axil_rready(rready), .s_axil_rdata(rdata), .s_axil_rresp(rresp),
    .m_apb_psel(psel), .m_apb_penable(penable), .m_apb_pwrite(pwrite), .m_apb_pprot(pprot),
    .m_apb_paddr(paddr), .m_apb_pwdata(pwdata), .m_apb_pstrb(pstrb), .m_apb_pready(pready),
    .m_apb_prdata(prdata), .m_apb_pslverr(pslverr)
  );

  // ---- connect the rays through AXI4-Stream ----
  logic valid, ready, first, last, exit_valid, exit_ready, exit_first, exit_last;
  logic signed [PixelBits-1:0] u, v;
  logic signed [F+1:0] a, b;
  logic signed [IndexBits-1:0] i, j;
  logic signed [F+3:0] x, y, z;
  logic signed [F+1:0] dx, dy, dz;
  ray_status_e status;
  optics_config_t optics;
  logic s_tvalid, s_tready, s_tlast, s_tuser, m_tvalid, m_tready, m_tlast, m_tuser;
  logic [127:0] s_tdata;
  logic [255:0] m_tdata;
  lipp_axis_to_rays #(.F(F)) i_in (
    .clk_i, .rst_ni(rst_n), .s_axis_tvalid(s_tvalid), .s_axis_tready(s_tready),
    .s_axis_tdata(s_tdata), .s_axis_tlast(s_tlast), .s_axis_tuser(s_tuser), .ray_valid_o(valid),
    .ray_ready_i(ready), .ray_u_o(u), .ray_v_o(v), .ray_a_o(a), .ray_b_o(b), .ray_first_o(first),
    .ray_last_o(last)
  );
  lipp_axis_from_rays #(.F(F)) i_out (
    .clk_i, .rst_ni(rst_n), .exit_valid_i(exit_valid), .exit_ready_o(exit_ready), .exit_i_i(i),
    .exit_j_i(j), .exit_x_i(x), .exit_y_i(y), .exit_z_i(z), .exit_dx_i(dx), .exit_dy_i(dy),
    .exit_dz_i(dz), .exit_status_i(status), .exit_first_i(exit_first), .exit_last_i(exit_last),
    .m_axis_tvalid(m_tvalid), .m_axis_tready(m_tready), .m_axis_tdata(m_tdata),
    .m_axis_tlast(m_tlast), .m_axis_tuser(m_tuser)
  );
  assign {
    awvalid, awaddr, awprot, wvalid, wdata, wstrb, bready, arvalid, araddr, arprot, rready,
    s_tvalid, s_tdata, s_tlast, s_tuser, m_tready
  } = in;
  assign out = {
    awready, wready, bvalid, arready, rvalid, bresp, rresp, rdata, s_tready, m_tvalid, m_tdata,
    m_tlast, m_tuser, optics
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
