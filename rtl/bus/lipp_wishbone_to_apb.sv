// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Bridges Wishbone B4 classic to APB4: a master can access a completer such as optics_block.
///
/// The bridge is a slave with 32-bit data and 8-bit granularity. Each cycle becomes one APB4 access
/// to the word at {adr, 2'b00}. PSTRB equals SEL for a write and is 0 for a read, which returns the
/// whole word. PPROT is 0. An access with PSLVERR = 0 ends with ACK. An access with PSLVERR = 1
/// ends with ERR, and its data are meaningless. ACK and ERR are pulses of one clock. Every output
/// comes from a register; ACK and ERR are also gated by CYC and STB.
///
/// Let n >= 1 be the number of clocks of the APB4 access phase. The pulse of ACK or ERR comes n + 2
/// clocks after STB. A master can start a cycle every n + 3 clocks. A master that drops CYC or STB
/// before the pulse receives no pulse, although the APB4 access still completes. After dropping CYC
/// or STB early, a master must keep that signal low for one clock before its next cycle.
module lipp_wishbone_to_apb #(
  parameter int AddressBits = 9
) (
  input  logic                   clk_i,
  input  logic                   rst_ni,

  input  logic                   s_wb_cyc,
  input  logic                   s_wb_stb,
  input  logic                   s_wb_we,
  input  logic [AddressBits-1:2] s_wb_adr,   // word address: bits 2 and up of a byte address
  input  logic [31:0]            s_wb_dat_w, // write data (DAT_I of the slave in Wishbone B4)
  input  logic [3:0]             s_wb_sel,
  output logic [31:0]            s_wb_dat_r, // read data (DAT_O of the slave in Wishbone B4)
  output logic                   s_wb_ack,
  output logic                   s_wb_err,

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
    $fatal(1, "lipp_wishbone_to_apb: AddressBits must be 3 to 32");
  end

  // pending_q: the master still waits for the end of the APB4 access
  logic request, start, done, pending_q;
  assign request = s_wb_cyc && s_wb_stb;
  assign start = request && !m_apb_psel && !s_wb_ack && !s_wb_err;
  // The gate suppresses the pulse for a master that drops CYC or STB in the clock of the pulse.
  logic ack_q, err_q;
  assign {s_wb_ack, s_wb_err} = {2{request}} & {ack_q, err_q};
  assign done = m_apb_penable && m_apb_pready;
  assign m_apb_pprot = '0;

  always_ff @(posedge clk_i) begin
    if (start) begin
      m_apb_pwrite <= s_wb_we;
      m_apb_paddr <= {s_wb_adr, 2'b00};
      m_apb_pwdata <= s_wb_dat_w;
      m_apb_pstrb <= s_wb_we ? s_wb_sel : '0;
    end
    if (done) s_wb_dat_r <= m_apb_prdata;
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {m_apb_psel, m_apb_penable, pending_q, ack_q, err_q} <= '0;
    end else begin
      m_apb_psel <= start || (m_apb_psel && !done);
      m_apb_penable <= m_apb_psel && !done;
      pending_q <= start || (pending_q && request);
      ack_q <= done && pending_q && request && !m_apb_pslverr;
      err_q <= done && pending_q && request && m_apb_pslverr;
    end
  end

endmodule

`default_nettype wire
