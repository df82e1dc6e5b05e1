// SPDX-License-Identifier: Apache-2.0
/// Checks the handshakes and transfers of `lipp_axil_to_apb` at its ports, and that the AXI manager
/// keeps each request stable until the bridge accepts the request.
module lipp_axil_to_apb_checks #(
  parameter int AddressBits = 9,
  parameter bit AssumeManager = 1'b0  // 1: assume, not assert, the manager's rules
) (
  input logic                   clk_i,
  input logic                   rst_ni,
  input logic                   s_axil_awvalid,
  input logic                   s_axil_awready,
  input logic [AddressBits-1:0] s_axil_awaddr,
  input logic [2:0]             s_axil_awprot,
  input logic                   s_axil_wvalid,
  input logic                   s_axil_wready,
  input logic [31:0]            s_axil_wdata,
  input logic [3:0]             s_axil_wstrb,
  input logic                   s_axil_bvalid,
  input logic                   s_axil_bready,
  input logic [1:0]             s_axil_bresp,
  input logic                   s_axil_arvalid,
  input logic                   s_axil_arready,
  input logic [AddressBits-1:0] s_axil_araddr,
  input logic [2:0]             s_axil_arprot,
  input logic                   s_axil_rvalid,
  input logic                   s_axil_rready,
  input logic [31:0]            s_axil_rdata,
  input logic [1:0]             s_axil_rresp,
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
  wire setup = m_apb_psel && !m_apb_penable;
  wire done = m_apb_psel && m_apb_penable && m_apb_pready;
  wire [A+39:0] access = {m_apb_pwrite, m_apb_pprot, m_apb_paddr, m_apb_pwdata & {32{m_apb_pwrite}},
      m_apb_pstrb};
  wire b_take = s_axil_bvalid && s_axil_bready;
  wire r_take = s_axil_rvalid && s_axil_rready;

  reg aw_q, w_q, ar_q;        // 1: address (aw, ar) or data (w) waits for an APB access
  wire aw_waits = aw_q && !(setup && m_apb_pwrite);
  wire w_waits = w_q && !(setup && m_apb_pwrite);
  wire ar_waits = ar_q && !(setup && !m_apb_pwrite);
  reg b_due_q, r_due_q;       // 1: a write (b) or read (r) response is pending
  reg b_error_q, r_error_q;
  reg [A+2:0] aw_word_q, ar_word_q;  // last accepted write address, write data, read address
  reg [35:0] w_word_q;
  reg [31:0] r_word_q;
  reg past_valid_q;                // 1: the registers below hold values of the previous clock
  reg idle_q, wait_q, may_write_q, may_read_q, last_write_q;
  reg [A+39:0] access_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {aw_q, w_q, ar_q, b_due_q, r_due_q, past_valid_q} <= 0;
    end else begin
      aw_q <= (s_axil_awvalid && s_axil_awready) || aw_waits;
      w_q <= (s_axil_wvalid && s_axil_wready) || w_waits;
      ar_q <= (s_axil_arvalid && s_axil_arready) || ar_waits;
      b_due_q <= (done && m_apb_pwrite) || (b_due_q && !b_take);
      r_due_q <= (done && !m_apb_pwrite) || (r_due_q && !r_take);
      past_valid_q <= 1;
    end
  end
  // 1: a transfer was offered in the previous clock, but not accepted
  reg aw_held_q, w_held_q, ar_held_q, b_held_q, r_held_q;
  reg [A+2:0] aw_was_q, ar_was_q;
  reg [35:0] w_was_q;
  reg [1:0] b_was_q;
  reg [33:0] r_was_q;
  always @(posedge clk_i) begin
    if (s_axil_awvalid && s_axil_awready) aw_word_q <= {s_axil_awprot, s_axil_awaddr};
    if (s_axil_wvalid && s_axil_wready) w_word_q <= {s_axil_wstrb, s_axil_wdata};
    if (s_axil_arvalid && s_axil_arready) ar_word_q <= {s_axil_arprot, s_axil_araddr};
    if (done && m_apb_pwrite) b_error_q <= m_apb_pslverr;
    if (done && !m_apb_pwrite) {r_error_q, r_word_q} <= {m_apb_pslverr, m_apb_prdata};
    {aw_held_q, aw_was_q} <= {s_axil_awvalid && !s_axil_awready, s_axil_awprot, s_axil_awaddr};
    {w_held_q, w_was_q} <= {s_axil_wvalid && !s_axil_wready, s_axil_wstrb, s_axil_wdata};
    {ar_held_q, ar_was_q} <= {s_axil_arvalid && !s_axil_arready, s_axil_arprot, s_axil_araddr};
    {b_held_q, b_was_q} <= {s_axil_bvalid && !s_axil_bready, s_axil_bresp};
    {r_held_q, r_was_q} <= {s_axil_rvalid && !s_axil_rready, s_axil_rresp, s_axil_rdata};
    access_q <= access;
    idle_q <= !m_apb_psel || done;
    wait_q <= m_apb_psel && !done;
    // 1: an APB access could begin after this clock, because all parts of its request have arrived
    // and the register of its response is free.
    may_write_q <= aw_waits && w_waits && !s_axil_bvalid && !(done && m_apb_pwrite);
    may_read_q <= ar_waits && !s_axil_rvalid && !(done && !m_apb_pwrite);
    last_write_q <= m_apb_pwrite;
  end

  // ---- rules for the bridge ----
  always @(posedge clk_i) begin
    if (checked) begin
      // Each APB access belongs to a request, and each request gets exactly one response.
      write_asked: assert(!(setup && m_apb_pwrite) || (aw_q && w_q));
      read_asked: assert(!(setup && !m_apb_pwrite) || ar_q);
      write_access: assert(!(setup && m_apb_pwrite)
          || {m_apb_pprot, m_apb_paddr, m_apb_pstrb, m_apb_pwdata}
          == {aw_word_q[A+2:2], 2'b00, w_word_q});
      read_access: assert(!(setup && !m_apb_pwrite)
          || {m_apb_pprot, m_apb_paddr, m_apb_pstrb} == {ar_word_q[A+2:2], 2'b00, 4'h0});
      write_answered: assert(s_axil_bvalid == b_due_q);
      read_answered: assert(s_axil_rvalid == r_due_q);
      write_answer: assert(!b_due_q || s_axil_bresp == {b_error_q, 1'b0});
      read_answer: assert(!r_due_q
          || (s_axil_rresp == {r_error_q, 1'b0} && (r_error_q || s_axil_rdata == r_word_q)));
      answer_has_room: assert(!(done && (m_apb_pwrite ? b_due_q : r_due_q)));
      // The bridge accepts an address or data exactly while none of the same channel is waiting.
      places: assert(!past_valid_q || {s_axil_awready, s_axil_wready, s_axil_arready}
          == {!aw_waits, !w_waits, !ar_waits});
      apb_enable: assert(!m_apb_penable || m_apb_psel);
      if (past_valid_q) begin
        // A response is stable until the manager accepts the response.
        b_stable: assert(!b_held_q || (s_axil_bvalid && s_axil_bresp == b_was_q));
        r_stable: assert(!r_held_q || (s_axil_rvalid && {s_axil_rresp, s_axil_rdata} == r_was_q));
        // APB4: a setup phase of one clock, then an access phase until PREADY; signals are stable.
        apb_setup: assert(!m_apb_penable || !idle_q);
        apb_access: assert(!wait_q || (m_apb_psel && m_apb_penable && access == access_q));
        // If the bus is idle, a pending access begins at once. If a write and a read are pending,
        // the kind that did not run last begins.
        begins: assert(!(idle_q && (may_write_q || may_read_q)) || setup);
        turns: assert(!(idle_q && may_write_q && may_read_q) || m_apb_pwrite != last_write_q);
      end
    end
  end

  // ---- rules for the manager ----
  wire manager_ok = !past_valid_q
      || ((!aw_held_q || (s_axil_awvalid && {s_axil_awprot, s_axil_awaddr} == aw_was_q))
      && (!w_held_q || (s_axil_wvalid && {s_axil_wstrb, s_axil_wdata} == w_was_q))
      && (!ar_held_q || (s_axil_arvalid && {s_axil_arprot, s_axil_araddr} == ar_was_q)));
  if (AssumeManager) begin : gen_assume_manager
    always @(posedge clk_i) if (checked) assume(manager_ok);
  end else begin : gen_manager
    always @(posedge clk_i) if (checked) manager: assert(manager_ok);
  end

endmodule

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_axil_to_apb lipp_axil_to_apb_checks #(.AddressBits(AddressBits)) i_checks (.*);
`endif
