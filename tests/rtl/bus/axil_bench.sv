// lipp_axil_to_apb in front of apb_memory.
module axil_bench (
  input  logic        clk_i,
  input  logic        rst_ni,
  input  logic [4:0]  clocks_i,
  input  logic        s_axil_awvalid,
  output logic        s_axil_awready,
  input  logic [8:0]  s_axil_awaddr,
  input  logic [2:0]  s_axil_awprot,
  input  logic        s_axil_wvalid,
  output logic        s_axil_wready,
  input  logic [31:0] s_axil_wdata,
  input  logic [3:0]  s_axil_wstrb,
  output logic        s_axil_bvalid,
  input  logic        s_axil_bready,
  output logic [1:0]  s_axil_bresp,
  input  logic        s_axil_arvalid,
  output logic        s_axil_arready,
  input  logic [8:0]  s_axil_araddr,
  input  logic [2:0]  s_axil_arprot,
  output logic        s_axil_rvalid,
  input  logic        s_axil_rready,
  output logic [31:0] s_axil_rdata,
  output logic [1:0]  s_axil_rresp
);
  logic psel, penable, pwrite, pready, pslverr;
  logic [2:0] pprot;
  logic [8:0] paddr;
  logic [3:0] pstrb;
  logic [31:0] pwdata, prdata;
  lipp_axil_to_apb i_adapter (
    .*, .m_apb_psel(psel), .m_apb_penable(penable), .m_apb_pwrite(pwrite), .m_apb_pprot(pprot),
    .m_apb_paddr(paddr), .m_apb_pwdata(pwdata), .m_apb_pstrb(pstrb), .m_apb_pready(pready),
    .m_apb_prdata(prdata), .m_apb_pslverr(pslverr)
  );
  apb_memory i_memory (.*);
endmodule
