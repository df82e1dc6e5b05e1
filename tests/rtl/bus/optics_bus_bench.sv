// optics_block in a system: its registers behind AXI4-Lite, or behind Wishbone where wishbone_i is 1;
// its rays behind AXI4-Stream.
module optics_bus_bench #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic         clk_i,
  input  logic         rst_ni,
  input  logic         wishbone_i,

  input  logic         s_axil_awvalid,
  output logic         s_axil_awready,
  input  logic [8:0]   s_axil_awaddr,
  input  logic [2:0]   s_axil_awprot,
  input  logic         s_axil_wvalid,
  output logic         s_axil_wready,
  input  logic [31:0]  s_axil_wdata,
  input  logic [3:0]   s_axil_wstrb,
  output logic         s_axil_bvalid,
  input  logic         s_axil_bready,
  output logic [1:0]   s_axil_bresp,
  input  logic         s_axil_arvalid,
  output logic         s_axil_arready,
  input  logic [8:0]   s_axil_araddr,
  input  logic [2:0]   s_axil_arprot,
  output logic         s_axil_rvalid,
  input  logic         s_axil_rready,
  output logic [31:0]  s_axil_rdata,
  output logic [1:0]   s_axil_rresp,

  input  logic         s_wb_cyc,
  input  logic         s_wb_stb,
  input  logic         s_wb_we,
  input  logic [8:2]   s_wb_adr,
  input  logic [31:0]  s_wb_dat_w,
  input  logic [3:0]   s_wb_sel,
  output logic [31:0]  s_wb_dat_r,
  output logic         s_wb_ack,
  output logic         s_wb_err,

  input  logic         s_axis_tvalid,
  output logic         s_axis_tready,
  input  logic [127:0] s_axis_tdata,
  input  logic         s_axis_tlast,
  input  logic         s_axis_tuser,
  output logic         m_axis_tvalid,
  input  logic         m_axis_tready,
  output logic [255:0] m_axis_tdata,
  output logic         m_axis_tlast,
  output logic         m_axis_tuser
);
  typedef struct packed {
    logic        psel, penable, pwrite;
    logic [2:0]  pprot;
    logic [8:0]  paddr;
    logic [31:0] pwdata;
    logic [3:0]  pstrb;
  } apb_t;
  apb_t lite, wish, apb;
  logic pready, pslverr;
  logic [31:0] prdata;
  assign apb = wishbone_i ? wish : lite;
  lipp_axil_to_apb i_lite (
    .*, .m_apb_psel(lite.psel), .m_apb_penable(lite.penable), .m_apb_pwrite(lite.pwrite),
    .m_apb_pprot(lite.pprot), .m_apb_paddr(lite.paddr), .m_apb_pwdata(lite.pwdata),
    .m_apb_pstrb(lite.pstrb), .m_apb_pready(pready && !wishbone_i), .m_apb_prdata(prdata),
    .m_apb_pslverr(pslverr)
  );
  lipp_wishbone_to_apb i_wish (
    .*, .m_apb_psel(wish.psel), .m_apb_penable(wish.penable), .m_apb_pwrite(wish.pwrite),
    .m_apb_pprot(wish.pprot), .m_apb_paddr(wish.paddr), .m_apb_pwdata(wish.pwdata),
    .m_apb_pstrb(wish.pstrb), .m_apb_pready(pready && wishbone_i), .m_apb_prdata(prdata),
    .m_apb_pslverr(pslverr)
  );

  logic ray_valid, ray_ready, ray_first, ray_last, exit_valid, exit_ready, exit_first, exit_last;
  logic signed [17:0] u, v;
  logic signed [F+1:0] a, b, dx, dy, dz;
  logic signed [F+3:0] x, y, z;
  logic signed [11:0] i, j;
  lipp_optics_pkg::ray_status_e status;
  lipp_optics_pkg::optics_config_t unused_optics;
  lipp_axis_to_rays #(.F(F)) i_in (
    .*, .ray_valid_o(ray_valid), .ray_ready_i(ray_ready), .ray_u_o(u), .ray_v_o(v), .ray_a_o(a),
    .ray_b_o(b), .ray_first_o(ray_first), .ray_last_o(ray_last)
  );
  lipp_optics_block #(.Build(Build)) i_optics (
    .clk_i, .rst_ni, .s_apb_psel(apb.psel), .s_apb_penable(apb.penable), .s_apb_pwrite(apb.pwrite),
    .s_apb_pprot(apb.pprot), .s_apb_paddr(apb.paddr), .s_apb_pwdata(apb.pwdata),
    .s_apb_pstrb(apb.pstrb), .s_apb_pready(pready), .s_apb_prdata(prdata), .s_apb_pslverr(pslverr),
    .ray_valid_i(ray_valid), .ray_ready_o(ray_ready), .ray_u_i(u), .ray_v_i(v), .ray_a_i(a),
    .ray_b_i(b), .ray_first_i(ray_first), .ray_last_i(ray_last),
    .exit_valid_o(exit_valid), .exit_ready_i(exit_ready), .exit_i_o(i), .exit_j_o(j),
    .exit_x_o(x), .exit_y_o(y), .exit_z_o(z), .exit_dx_o(dx), .exit_dy_o(dy), .exit_dz_o(dz),
    .exit_status_o(status), .exit_first_o(exit_first), .exit_last_o(exit_last),
    .optics_o(unused_optics)
  );
  lipp_axis_from_rays #(.F(F)) i_out (
    .*, .exit_valid_i(exit_valid), .exit_ready_o(exit_ready), .exit_i_i(i), .exit_j_i(j),
    .exit_x_i(x), .exit_y_i(y), .exit_z_i(z), .exit_dx_i(dx), .exit_dy_i(dy), .exit_dz_i(dz),
    .exit_status_i(status), .exit_first_i(exit_first), .exit_last_i(exit_last)
  );
endmodule
