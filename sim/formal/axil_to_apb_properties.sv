// SPDX-License-Identifier: Apache-2.0
/// Proves the assertions of axil_to_apb_checks for `lipp_axil_to_apb`, with any manager that keeps
/// its requests stable and with any completer. The invariants below make the proof inductive.
module axil_to_apb_properties (
  input logic        clk_i,
  input logic        rst_ni,
  input logic        s_axil_awvalid,
  input logic [3:0]  s_axil_awaddr,
  input logic [2:0]  s_axil_awprot,
  input logic        s_axil_wvalid,
  input logic [31:0] s_axil_wdata,
  input logic [3:0]  s_axil_wstrb,
  input logic        s_axil_bready,
  input logic        s_axil_arvalid,
  input logic [3:0]  s_axil_araddr,
  input logic [2:0]  s_axil_arprot,
  input logic        s_axil_rready,
  input logic        m_apb_pready,
  input logic [31:0] m_apb_prdata,
  input logic        m_apb_pslverr
);

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  always @* if (!started_q) assume(!rst_ni);

  logic s_axil_awready, s_axil_wready, s_axil_arready, s_axil_bvalid, s_axil_rvalid;
  logic [1:0] s_axil_bresp, s_axil_rresp;
  logic [31:0] s_axil_rdata, m_apb_pwdata;
  logic m_apb_psel, m_apb_penable, m_apb_pwrite;
  logic [2:0] m_apb_pprot;
  logic [3:0] m_apb_paddr, m_apb_pstrb;
  lipp_axil_to_apb #(.AddressBits(4)) i_adapter (
    .clk_i, .rst_ni, .s_axil_awvalid, .s_axil_awready, .s_axil_awaddr, .s_axil_awprot,
    .s_axil_wvalid, .s_axil_wready, .s_axil_wdata, .s_axil_wstrb, .s_axil_bvalid, .s_axil_bready,
    .s_axil_bresp, .s_axil_arvalid, .s_axil_arready, .s_axil_araddr, .s_axil_arprot,
    .s_axil_rvalid, .s_axil_rready, .s_axil_rdata, .s_axil_rresp, .m_apb_psel, .m_apb_penable,
    .m_apb_pwrite, .m_apb_pprot, .m_apb_paddr, .m_apb_pwdata, .m_apb_pstrb, .m_apb_pready,
    .m_apb_prdata, .m_apb_pslverr
  );
  lipp_axil_to_apb_checks #(.AddressBits(4), .AssumeManager(1'b1)) i_checks (
    .clk_i, .rst_ni, .s_axil_awvalid, .s_axil_awready, .s_axil_awaddr, .s_axil_awprot,
    .s_axil_wvalid, .s_axil_wready, .s_axil_wdata, .s_axil_wstrb, .s_axil_bvalid, .s_axil_bready,
    .s_axil_bresp, .s_axil_arvalid, .s_axil_arready, .s_axil_araddr, .s_axil_arprot,
    .s_axil_rvalid, .s_axil_rready, .s_axil_rdata, .s_axil_rresp, .m_apb_psel, .m_apb_penable,
    .m_apb_pwrite, .m_apb_pprot, .m_apb_paddr, .m_apb_pwdata, .m_apb_pstrb, .m_apb_pready,
    .m_apb_prdata, .m_apb_pslverr
  );

  // These wires carry internal registers of the design: yosys flattens the hierarchy and connects
  // each wire to the register of the same name.
  (* hierconn *) wire \i_adapter.aw_q ;
  (* hierconn *) wire \i_adapter.w_q ;
  (* hierconn *) wire \i_adapter.ar_q ;
  (* hierconn *) wire [3:2] \i_adapter.awaddr_q ;
  (* hierconn *) wire [2:0] \i_adapter.awprot_q ;
  (* hierconn *) wire [31:0] \i_adapter.wdata_q ;
  (* hierconn *) wire [3:0] \i_adapter.wstrb_q ;
  (* hierconn *) wire [3:2] \i_adapter.araddr_q ;
  (* hierconn *) wire [2:0] \i_adapter.arprot_q ;
  (* hierconn *) wire \i_checks.aw_q ;
  (* hierconn *) wire \i_checks.w_q ;
  (* hierconn *) wire \i_checks.ar_q ;
  (* hierconn *) wire [6:0] \i_checks.aw_word_q ;
  (* hierconn *) wire [35:0] \i_checks.w_word_q ;
  (* hierconn *) wire [6:0] \i_checks.ar_word_q ;
  wire write_begins = m_apb_psel && !m_apb_penable && m_apb_pwrite;
  wire read_begins = m_apb_psel && !m_apb_penable && !m_apb_pwrite;

  always @(posedge clk_i) begin
    if (rst_ni) begin
      inside_places: assert({\i_checks.aw_q , \i_checks.w_q , \i_checks.ar_q }
          == {\i_adapter.aw_q || write_begins, \i_adapter.w_q || write_begins,
              \i_adapter.ar_q || read_begins});
      inside_open: assert(!(\i_adapter.aw_q && s_axil_awready) && !(\i_adapter.w_q && s_axil_wready)
          && !(\i_adapter.ar_q && s_axil_arready));
      inside_words: assert((!\i_adapter.aw_q
          || {\i_adapter.awprot_q , \i_adapter.awaddr_q } == \i_checks.aw_word_q [6:2])
          && (!\i_adapter.w_q || {\i_adapter.wstrb_q , \i_adapter.wdata_q } == \i_checks.w_word_q )
          && (!\i_adapter.ar_q
          || {\i_adapter.arprot_q , \i_adapter.araddr_q } == \i_checks.ar_word_q [6:2]));
      inside_room: assert(!m_apb_psel || !(m_apb_pwrite ? s_axil_bvalid : s_axil_rvalid));
    end
  end

  // ---- cover statements: events that the proof must reach ----
  reg [1:0] writes_q, reads_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {writes_q, reads_q} <= 0;
    else begin
      writes_q <= writes_q + (s_axil_bvalid && s_axil_bready && writes_q != 3);
      reads_q <= reads_q + (s_axil_rvalid && s_axil_rready && reads_q != 3);
    end
  end
  always @(posedge clk_i) begin
    if (rst_ni) begin
      cover_both: cover(s_axil_bvalid && s_axil_rvalid && writes_q == 2 && reads_q == 2);
      cover_errors: cover(s_axil_bvalid && s_axil_bresp == 2 && s_axil_rvalid && s_axil_rresp == 2);
      cover_full: cover(\i_adapter.aw_q && \i_adapter.w_q && \i_adapter.ar_q && s_axil_bvalid
          && s_axil_rvalid);
    end
  end

endmodule
