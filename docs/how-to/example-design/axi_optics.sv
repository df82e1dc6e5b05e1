// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Lippmann's optics block in an AXI system: its registers are an AXI4-Lite subordinate, and its
/// rays come and go on AXI4-Stream.
///
///   s_axil -> lipp_axil_to_apb --> APB4 --> +-------------------+
///                                           | lipp_optics_block |
///   s_axis -> lipp_axis_to_rays -> rays --> +-------------------+ -> lipp_axis_from_rays -> m_axis
///
/// The subordinate has the 512 bytes of docs/generated/registers.md. The headers of the two stream
/// adapters define the bits of tdata. While the register field `source` is `stream`, the block
/// traces the rays of s_axis; while it is `raster`, the block makes the rays, and s_axis waits.
///
/// For Wishbone, replace lipp_axil_to_apb by lipp_wishbone_to_apb.
module axi_optics #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare
) (
  input  logic         clk_i,           // clock of all three buses
  input  logic         rst_ni,          // reset of all three buses, released synchronously

  input  logic         s_axil_awvalid,
  output logic         s_axil_awready,
  input  logic [8:0]   s_axil_awaddr,   // bytes
  input  logic [2:0]   s_axil_awprot,
  input  logic         s_axil_wvalid,
  output logic         s_axil_wready,
  input  logic [31:0]  s_axil_wdata,
  input  logic [3:0]   s_axil_wstrb,
  output logic         s_axil_bvalid,
  input  logic         s_axil_bready,
  output logic [1:0]   s_axil_bresp,    // SLVERR: no such register, or access not possible
  input  logic         s_axil_arvalid,
  output logic         s_axil_arready,
  input  logic [8:0]   s_axil_araddr,   // bytes
  input  logic [2:0]   s_axil_arprot,
  output logic         s_axil_rvalid,
  input  logic         s_axil_rready,
  output logic [31:0]  s_axil_rdata,
  output logic [1:0]   s_axil_rresp,

  input  logic         s_axis_tvalid,
  output logic         s_axis_tready,
  input  logic [127:0] s_axis_tdata,    // one ray: u, v, a, b
  input  logic         s_axis_tlast,    // 1: the last ray of a frame
  input  logic         s_axis_tuser,    // 1: the first ray of a frame

  output logic         m_axis_tvalid,
  input  logic         m_axis_tready,
  output logic [255:0] m_axis_tdata,    // one exit ray: lenslet, status, origin, direction
  output logic         m_axis_tlast,    // 1: the last exit ray of a frame
  output logic         m_axis_tuser     // 1: the first exit ray of a frame
);
  import lipp_optics_pkg::*;

  localparam int F = int'(Build.fraction_bits);

  // ---- registers ----
  logic psel, penable, pwrite, pready, pslverr;
  logic [2:0] pprot;
  logic [8:0] paddr;
  logic [31:0] pwdata, prdata;
  logic [3:0] pstrb;
  lipp_axil_to_apb #(.AddressBits(9)) i_registers (
    .clk_i, .rst_ni,
    .s_axil_awvalid, .s_axil_awready, .s_axil_awaddr, .s_axil_awprot,
    .s_axil_wvalid, .s_axil_wready, .s_axil_wdata, .s_axil_wstrb,
    .s_axil_bvalid, .s_axil_bready, .s_axil_bresp,
    .s_axil_arvalid, .s_axil_arready, .s_axil_araddr, .s_axil_arprot,
    .s_axil_rvalid, .s_axil_rready, .s_axil_rdata, .s_axil_rresp,
    .m_apb_psel(psel), .m_apb_penable(penable), .m_apb_pwrite(pwrite), .m_apb_pprot(pprot),
    .m_apb_paddr(paddr), .m_apb_pwdata(pwdata), .m_apb_pstrb(pstrb), .m_apb_pready(pready),
    .m_apb_prdata(prdata), .m_apb_pslverr(pslverr)
  );

  // ---- rays ----
  logic ray_valid, ray_ready, ray_first, ray_last;
  logic signed [PixelBits-1:0] ray_u, ray_v;
  logic signed [F+1:0] ray_a, ray_b;
  lipp_axis_to_rays #(.F(F)) i_rays (
    .clk_i, .rst_ni,
    .s_axis_tvalid, .s_axis_tready, .s_axis_tdata, .s_axis_tlast, .s_axis_tuser,
    .ray_valid_o(ray_valid), .ray_ready_i(ray_ready), .ray_u_o(ray_u), .ray_v_o(ray_v),
    .ray_a_o(ray_a), .ray_b_o(ray_b), .ray_first_o(ray_first), .ray_last_o(ray_last)
  );

  // ---- optics ----
  logic exit_valid, exit_ready, exit_first, exit_last;
  logic signed [IndexBits-1:0] exit_i, exit_j;
  logic signed [F+3:0] exit_x, exit_y, exit_z;
  logic signed [F+1:0] exit_dx, exit_dy, exit_dz;
  ray_status_e exit_status;
  optics_config_t unused_optics;
  lipp_optics_block #(.Build(Build)) i_optics (
    .clk_i, .rst_ni,
    .s_apb_psel(psel), .s_apb_penable(penable), .s_apb_pwrite(pwrite), .s_apb_pprot(pprot),
    .s_apb_paddr(paddr), .s_apb_pwdata(pwdata), .s_apb_pstrb(pstrb), .s_apb_pready(pready),
    .s_apb_prdata(prdata), .s_apb_pslverr(pslverr),
    .ray_valid_i(ray_valid), .ray_ready_o(ray_ready), .ray_u_i(ray_u), .ray_v_i(ray_v),
    .ray_a_i(ray_a), .ray_b_i(ray_b), .ray_first_i(ray_first), .ray_last_i(ray_last),
    .exit_valid_o(exit_valid), .exit_ready_i(exit_ready), .exit_i_o(exit_i), .exit_j_o(exit_j),
    .exit_x_o(exit_x), .exit_y_o(exit_y), .exit_z_o(exit_z), .exit_dx_o(exit_dx),
    .exit_dy_o(exit_dy), .exit_dz_o(exit_dz), .exit_status_o(exit_status),
    .exit_first_o(exit_first), .exit_last_o(exit_last), .optics_o(unused_optics)
  );

  // ---- exit rays ----
  lipp_axis_from_rays #(.F(F)) i_exits (
    .clk_i, .rst_ni,
    .exit_valid_i(exit_valid), .exit_ready_o(exit_ready), .exit_i_i(exit_i), .exit_j_i(exit_j),
    .exit_x_i(exit_x), .exit_y_i(exit_y), .exit_z_i(exit_z), .exit_dx_i(exit_dx),
    .exit_dy_i(exit_dy), .exit_dz_i(exit_dz), .exit_status_i(exit_status),
    .exit_first_i(exit_first), .exit_last_i(exit_last),
    .m_axis_tvalid, .m_axis_tready, .m_axis_tdata, .m_axis_tlast, .m_axis_tuser
  );

endmodule

`default_nettype wire
