// SPDX-License-Identifier: Apache-2.0
/// Checks the transfers at the ports of `lipp_wishbone_to_apb`; a master may abandon a cycle.
module lipp_wishbone_to_apb_checks #(
  parameter int AddressBits = 9
) (
  input logic                   clk_i,
  input logic                   rst_ni,
  input logic                   s_wb_cyc,
  input logic                   s_wb_stb,
  input logic                   s_wb_we,
  input logic [AddressBits-1:2] s_wb_adr,
  input logic [31:0]            s_wb_dat_w,
  input logic [3:0]             s_wb_sel,
  input logic [31:0]            s_wb_dat_r,
  input logic                   s_wb_ack,
  input logic                   s_wb_err,
  input logic                   m_apb_psel,
  input logic                   m_apb_penable,
  input logic                   m_apb_pwrite,
  input logic [2:0]             m_apb_pprot,
  input logic [AddressBits-1:0] m_apb_paddr,
  input logic [31:0]            m_apb_pwdata,
  input logic [3:0]             m_apb_pstrb,
  input logic                   m_apb_pready,
  input logic [31:0]            m_apb_prdata,
  input logic                   m_apb_pslverr
);

`ifdef FORMAL
  wire checked = rst_ni;
`else
  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;
`endif

  localparam int A = AddressBits;
  wire request = s_wb_cyc && s_wb_stb;
  wire pulse = s_wb_ack || s_wb_err;
  wire setup = m_apb_psel && !m_apb_penable;
  wire done = m_apb_psel && m_apb_penable && m_apb_pready;
  wire [A+39:0] access = {m_apb_pwrite, m_apb_pprot, m_apb_paddr, m_apb_pwdata & {32{m_apb_pwrite}},
      m_apb_pstrb};

  reg past_valid_q;    // 1: the registers below hold values of the previous clock
  reg cycle_held_q;    // 1: the master has held the cycle since the access began
  reg request_q, pulse_q, idle_q, wait_q, done_q, error_q;
  reg [31:0] word_q;
  reg [A+39:0] access_q;
  reg [A+34:0] request_word_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {past_valid_q, cycle_held_q} <= 0;
    else begin
      past_valid_q <= 1;
      cycle_held_q <= setup ? request : cycle_held_q && request;
    end
  end
  always @(posedge clk_i) begin
    {request_q, pulse_q, idle_q, wait_q} <= {request, pulse, !m_apb_psel, m_apb_psel && !done};
    {done_q, error_q, word_q, access_q} <= {done && cycle_held_q && request, m_apb_pslverr,
        m_apb_prdata, access};
    request_word_q <= {s_wb_we, s_wb_adr, s_wb_dat_w, s_wb_sel};
  end

  always @(posedge clk_i) begin
    if (checked && past_valid_q) begin
      // An APB access begins exactly when a Wishbone cycle is pending, and belongs to that cycle.
      begins: assert(setup == (idle_q && request_q && !pulse_q));
      own_access: assert(!setup || access == {
          request_word_q[A+34], 3'b000, request_word_q[A+33:36], 2'b00,
              request_word_q[35:4] & {32{request_word_q[A+34]}},
          request_word_q[3:0] & {4{request_word_q[A+34]}}});
      // Each access is answered by ACK or ERR once, in the clock after its end, unless the master
      // has abandoned the cycle.
      answered: assert(pulse == (done_q && request) && !(s_wb_ack && s_wb_err));
      answer: assert(!pulse || (s_wb_err == error_q && (error_q || s_wb_dat_r == word_q)));
      one_clock: assert(!(pulse && pulse_q));
      // APB4: a setup phase of one clock, then the access phase until PREADY, with stable signals.
      apb_enable: assert(!m_apb_penable || (m_apb_psel && !idle_q));
      apb_access: assert(!wait_q || (m_apb_psel && m_apb_penable && access == access_q));
    end
  end

endmodule

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_wishbone_to_apb lipp_wishbone_to_apb_checks #(.AddressBits(AddressBits)) i_checks (.*);
`endif
