// lipp_wishbone_to_apb in front of apb_memory.
module wishbone_bench (
  input  logic        clk_i,
  input  logic        rst_ni,
  input  logic [4:0]  clocks_i,
  input  logic        s_wb_cyc,
  input  logic        s_wb_stb,
  input  logic        s_wb_we,
  input  logic [8:2]  s_wb_adr,
  input  logic [31:0] s_wb_dat_w,
  input  logic [3:0]  s_wb_sel,
  output logic [31:0] s_wb_dat_r,
  output logic        s_wb_ack,
  output logic        s_wb_err
);
  logic psel, penable, pwrite, pready, pslverr;
  logic [2:0] pprot;
  logic [8:0] paddr;
  logic [3:0] pstrb;
  logic [31:0] pwdata, prdata;
  lipp_wishbone_to_apb i_adapter (
    .*, .m_apb_psel(psel), .m_apb_penable(penable), .m_apb_pwrite(pwrite), .m_apb_pprot(pprot),
    .m_apb_paddr(paddr), .m_apb_pwdata(pwdata), .m_apb_pstrb(pstrb), .m_apb_pready(pready),
    .m_apb_prdata(prdata), .m_apb_pslverr(pslverr)
  );
  apb_memory i_memory (.*);
endmodule
