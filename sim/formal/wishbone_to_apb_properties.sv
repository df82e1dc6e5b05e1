// SPDX-License-Identifier: Apache-2.0
/// Proves the assertions of wishbone_to_apb_checks for `lipp_wishbone_to_apb`, with any master,
/// which may abandon a cycle, and any completer. The invariants below make the proof inductive.
module wishbone_to_apb_properties (
  input logic        clk_i,
  input logic        rst_ni,
  input logic        s_wb_cyc,
  input logic        s_wb_stb,
  input logic        s_wb_we,
  input logic [3:2]  s_wb_adr,
  input logic [31:0] s_wb_dat_w,
  input logic [3:0]  s_wb_sel,
  input logic        m_apb_pready,
  input logic [31:0] m_apb_prdata,
  input logic        m_apb_pslverr
);

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  always @* if (!started_q) assume(!rst_ni);

  logic [31:0] s_wb_dat_r, m_apb_pwdata;
  logic s_wb_ack, s_wb_err, m_apb_psel, m_apb_penable, m_apb_pwrite;
  logic [2:0] m_apb_pprot;
  logic [3:0] m_apb_paddr, m_apb_pstrb;
  lipp_wishbone_to_apb #(.AddressBits(4)) i_adapter (
    .clk_i, .rst_ni, .s_wb_cyc, .s_wb_stb, .s_wb_we, .s_wb_adr, .s_wb_dat_w, .s_wb_sel, .s_wb_dat_r,
    .s_wb_ack, .s_wb_err, .m_apb_psel, .m_apb_penable, .m_apb_pwrite, .m_apb_pprot, .m_apb_paddr,
    .m_apb_pwdata, .m_apb_pstrb, .m_apb_pready, .m_apb_prdata, .m_apb_pslverr
  );
  lipp_wishbone_to_apb_checks #(.AddressBits(4)) i_checks (
    .clk_i, .rst_ni, .s_wb_cyc, .s_wb_stb, .s_wb_we, .s_wb_adr, .s_wb_dat_w, .s_wb_sel, .s_wb_dat_r,
    .s_wb_ack, .s_wb_err, .m_apb_psel, .m_apb_penable, .m_apb_pwrite, .m_apb_pprot, .m_apb_paddr,
    .m_apb_pwdata, .m_apb_pstrb, .m_apb_pready, .m_apb_prdata, .m_apb_pslverr
  );

  // These wires carry internal registers of the design: yosys flattens the hierarchy and connects
  // each wire to the register of the same name.
  (* hierconn *) wire \i_adapter.pending_q ;
  (* hierconn *) wire \i_checks.cycle_held_q ;
  reg [1:0] acks_q;
  reg gave_up_q;  // 1: an access completed after its master had abandoned the cycle
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {acks_q, gave_up_q} <= 0;
    else begin
      acks_q <= acks_q + (s_wb_ack && acks_q != 3);
      gave_up_q <= gave_up_q || (m_apb_penable && !\i_checks.cycle_held_q && s_wb_cyc && s_wb_stb);
    end
  end
  always @(posedge clk_i) begin
    if (rst_ni) begin
      inside_kept: assert(!m_apb_penable || \i_adapter.pending_q == \i_checks.cycle_held_q );
      inside_setup: assert(!m_apb_psel || m_apb_penable || \i_adapter.pending_q );
      inside_pulse: assert(!m_apb_psel || !(s_wb_ack || s_wb_err));
      cover_acks: cover(acks_q == 2 && s_wb_err);
      cover_given_up: cover(gave_up_q && s_wb_ack);
    end
  end

endmodule
