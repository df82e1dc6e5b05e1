// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Bridges AXI4-Lite to APB4: an AXI manager can access an APB4 completer such as optics_block.
///
/// Each request becomes one APB4 access to the word at {address[AddressBits-1:2], 2'b00}. The two
/// lowest address bits are ignored. Data words have 32 bits. PSTRB equals WSTRB for a write and is
/// 0 for a read. PPROT equals AWPROT for a write and ARPROT for a read. RDATA equals PRDATA, and
/// has no meaning with the response SLVERR.
///
/// A write needs its address and its data, which may arrive in any order. If a write and a read are
/// pending together, they are served alternately. Every output is a register.
///
/// Let n >= 1 be the number of clocks of the APB4 access phase. The response is valid n + 3 clocks
/// after the request. The bridge accepts a request of one kind, write or read, every n + 2 clocks.
/// With pending writes and reads, the bridge accepts a request every n + 1 clocks.
///
/// The AXI response depends on the APB4 error signal:
///
///   With PSLVERR = 0 the response is OKAY.
///   With PSLVERR = 1 the response is SLVERR.
module lipp_axil_to_apb #(
  parameter int AddressBits = 9
) (
  input  logic                   clk_i,
  input  logic                   rst_ni,

  input  logic                   s_axil_awvalid,
  output logic                   s_axil_awready,
  input  logic [AddressBits-1:0] s_axil_awaddr,  // byte address of a write request
  input  logic [2:0]             s_axil_awprot,
  input  logic                   s_axil_wvalid,
  output logic                   s_axil_wready,
  input  logic [31:0]            s_axil_wdata,
  input  logic [3:0]             s_axil_wstrb,
  output logic                   s_axil_bvalid,
  input  logic                   s_axil_bready,
  output logic [1:0]             s_axil_bresp,
  input  logic                   s_axil_arvalid,
  output logic                   s_axil_arready,
  input  logic [AddressBits-1:0] s_axil_araddr,  // byte address of a read request
  input  logic [2:0]             s_axil_arprot,
  output logic                   s_axil_rvalid,
  input  logic                   s_axil_rready,
  output logic [31:0]            s_axil_rdata,
  output logic [1:0]             s_axil_rresp,

  output logic                   m_apb_psel,
  output logic                   m_apb_penable,
  output logic                   m_apb_pwrite,
  output logic [2:0]             m_apb_pprot,
  output logic [AddressBits-1:0] m_apb_paddr,
  output logic [31:0]            m_apb_pwdata,
  output logic [3:0]             m_apb_pstrb,
  input  logic                   m_apb_pready,
  input  logic [31:0]            m_apb_prdata,
  input  logic                   m_apb_pslverr
);

  if (AddressBits < 3 || AddressBits > 32) begin : gen_illegal
    $fatal(1, "lipp_axil_to_apb: AddressBits must be 3 to 32");
  end

  // ---- registers for write address (aw), write data (w) and read address (ar) ----
  logic aw_d, aw_q, w_d, w_q, ar_d, ar_q;  // 1: the register is full
  logic [AddressBits-1:2] awaddr_q, araddr_q;
  logic [2:0] awprot_q, arprot_q;
  logic [31:0] wdata_q;
  logic [3:0] wstrb_q;
  logic start_write, start_read;
  assign aw_d = (aw_q || (s_axil_awvalid && s_axil_awready)) && !start_write;
  assign w_d = (w_q || (s_axil_wvalid && s_axil_wready)) && !start_write;
  assign ar_d = (ar_q || (s_axil_arvalid && s_axil_arready)) && !start_read;

  // ---- start an APB4 access when the register of its response is free ----
  logic done, free, write_may, read_may;
  assign done = m_apb_penable && m_apb_pready;
  assign free = !m_apb_psel || done;
  assign write_may = aw_q && w_q && !(done && m_apb_pwrite) && (!s_axil_bvalid || s_axil_bready);
  assign read_may = ar_q && !(done && !m_apb_pwrite) && (!s_axil_rvalid || s_axil_rready);
  assign start_write = free && write_may && !(read_may && m_apb_pwrite);
  assign start_read = free && read_may && !(write_may && !m_apb_pwrite);

  always_ff @(posedge clk_i) begin
    if (s_axil_awready) {awaddr_q, awprot_q} <= {s_axil_awaddr[AddressBits-1:2], s_axil_awprot};
    if (s_axil_wready) {wdata_q, wstrb_q} <= {s_axil_wdata, s_axil_wstrb};
    if (s_axil_arready) {araddr_q, arprot_q} <= {s_axil_araddr[AddressBits-1:2], s_axil_arprot};
    if (start_write) m_apb_pwdata <= wdata_q;
    if (start_write || start_read) begin
      m_apb_paddr <= {start_write ? awaddr_q : araddr_q, 2'b00};
      m_apb_pprot <= start_write ? awprot_q : arprot_q;
      m_apb_pstrb <= start_write ? wstrb_q : '0;
    end
    if (done && m_apb_pwrite) s_axil_bresp <= {m_apb_pslverr, 1'b0};
    if (done && !m_apb_pwrite) begin
      s_axil_rresp <= {m_apb_pslverr, 1'b0};
      s_axil_rdata <= m_apb_prdata;
    end
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {s_axil_awready, s_axil_wready, s_axil_arready, aw_q, w_q, ar_q} <= '0;
      {m_apb_psel, m_apb_penable, m_apb_pwrite, s_axil_bvalid, s_axil_rvalid} <= '0;
    end else begin
      {s_axil_awready, s_axil_wready, s_axil_arready} <= {!aw_d, !w_d, !ar_d};
      {aw_q, w_q, ar_q} <= {aw_d, w_d, ar_d};
      m_apb_psel <= start_write || start_read || (m_apb_psel && !done);
      m_apb_penable <= m_apb_psel && !done;
      if (start_write || start_read) m_apb_pwrite <= start_write;
      s_axil_bvalid <= (done && m_apb_pwrite) || (s_axil_bvalid && !s_axil_bready);
      s_axil_rvalid <= (done && !m_apb_pwrite) || (s_axil_rvalid && !s_axil_rready);
    end
  end

  logic unused_address;
  assign unused_address = ^{s_axil_awaddr[1:0], s_axil_araddr[1:0]};

endmodule

`default_nettype wire
