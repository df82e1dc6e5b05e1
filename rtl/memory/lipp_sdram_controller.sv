// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reads and writes words in one row of an SDR SDRAM, refreshes the SDRAM, and initialises it.
///
/// A transaction has a valid/ready handshake (valid_i, ready_o). The controller opens the
/// transaction's row, reads or writes one column per clock, and closes the row:
///
///   ACTIVE, tRCD, count x (READ or WRITE), tWR after a write, PRECHARGE, tRP.
///
/// Reading n words therefore takes max(tRCD + n, tRAS) + tRP clocks. Writing n words takes max(tRCD
/// + n + tWR - 1, tRAS) + tRP clocks. The minimum times of the data sheet are rounded up to whole
/// clocks. A transaction is accepted two clocks before its ACTIVE command, so that the arbiter can
/// select the client as late as possible.
///
/// All words to write must be available: write_word_i is taken in each clock in which write_take_o
/// is high. Read words cannot be delayed: each word is valid in the clock in which read_valid_o is
/// high, in the order of the transactions, with the tag_i of its transaction. Parameter PadClocks
/// is the number of registers between this module's ports and the SDRAM's pins, both directions
/// together. Input dq_i is captured cas_clocks + PadClocks + 1 clocks after READ is at the ports.
///
/// After reset the controller waits for power_up_us without a command, and then sends PRECHARGE
/// ALL, eight AUTO REFRESH, and LOAD MODE REGISTER. No manufacturer of such SDRAMs requires more.
/// After this initialisation, a pending AUTO REFRESH is executed before the next transaction.
module lipp_sdram_controller
  import lipp_sdram_pkg::*;
#(
  parameter int ClockHz = 125_000_000,
  parameter timing_t Timing = Grade75,
  parameter int PadClocks = 0
) (
  input  logic                clk_i,
  input  logic                rst_ni,

  input  logic                valid_i,
  output logic                ready_o,
  input  logic                write_i,
  input  logic                tag_i,
  input  transaction_t        transaction_i,
  output logic                write_take_o,
  input  logic [WordBits-1:0] write_word_i,
  output logic                read_valid_o,
  output logic                read_tag_o,
  output logic [WordBits-1:0] read_word_o,

  output logic                cke_o,
  output logic                cs_no,
  output logic                ras_no,
  output logic                cas_no,
  output logic                we_no,
  output logic [BankBits-1:0] ba_o,
  output logic [RowBits-1:0]  a_o,
  output logic [1:0]          dqm_o,
  output logic [WordBits-1:0] dq_o,
  output logic                dq_oe_o,
  input  logic [WordBits-1:0] dq_i
);

  localparam int RcdOnly = clocks(Timing.rcd_ns, ClockHz);
  localparam int Rcd = RcdOnly > 2 ? RcdOnly : 2;
  localparam int Ras = clocks(Timing.ras_ns, ClockHz);
  localparam int Rc = clocks(Timing.rc_ns, ClockHz);
  localparam int Rfc = clocks(Timing.rfc_ns, ClockHz);
  localparam int Wr = clocks(Timing.wr_ns, ClockHz);
  localparam int Mrd = int'(Timing.mrd_clocks);
  // Rp is the number of clocks from PRECHARGE to the next command. Rp also satisfies tRC, since a
  // row is open for tRAS or longer. The sum Rp + Rcd is at least 4, so that the SDRAM has released
  // its data pins before the controller writes a word.
  localparam int RpOnly = clocks(Timing.rp_ns, ClockHz);
  localparam int RpOrRc = RpOnly > Rc - Ras ? RpOnly : Rc - Ras;
  localparam int Rp = RpOrRc > 2 ? RpOrRc : 2;
  localparam int PowerUp = int'(longint'(Timing.power_up_us) * longint'(ClockHz) / 1_000_000) + 1;
  // Maximum number of clocks that a pending refresh waits for the end of a transaction. Each
  // refresh is requested Longest clocks before it is due.
  localparam int Longest = Rcd + RowWords + Wr + Rp + Rfc + 8;
  localparam int Interval = int'(
      (longint'(Timing.refresh_ms) * longint'(ClockHz) / 1000 - longint'(Longest))
      / longint'(Timing.rows));
  // Number of clocks from state Column of a read until the column's word is in read_word_o.
  localparam int ReadClocks = int'(Timing.cas_clocks) + 2 + PadClocks;

  localparam int TimerBits = $clog2((PowerUp > Interval ? PowerUp : Interval) + 1);
  localparam int PauseBits = Rfc + Rp + Rcd + Mrd;
  localparam int HoldBits = Ras + Wr;

  /// Return a mask with `number` ones. The controller shifts the mask right to count down.
  function automatic logic [PauseBits-1:0] ones(int number);
    return PauseBits'((64'd1 << number) - 64'd1);
  endfunction

  if (Timing.cas_clocks < 2 || Timing.cas_clocks > 3 || Mrd < 2 || Mrd > 8) begin : gen_clocks
    $fatal(1, "lipp_sdram_controller: cas_clocks must be 2 or 3, and mrd_clocks 2 to 8");
  end
  if (PadClocks < 0) begin : gen_pads
    $fatal(1, "lipp_sdram_controller: PadClocks must be 0 or more");
  end
  // The counters allow three refreshes after the longest transaction, and a tRFC of 30 clocks.
  if (Interval < Longest / 2 || Rfc > 30) begin : gen_clock
    $fatal(1, "lipp_sdram_controller: ClockHz must be about 35 MHz to 400 MHz");
  end
  // ---- count pending refreshes and the steps of the initialisation ----
  typedef enum logic [1:0] {PowerUpStep, RefreshStep, ModeStep, ReadyStep} step_e;
  typedef enum logic [2:0] {Idle, Activate, Column, Close, Refresh, Mode, Pause} state_e;
  step_e step_q, step_d;
  logic [2:0] more_q, more_d;   // initialisation refreshes left after the current one
  state_e state_q, state_d, after_q, after_d;
  logic [TimerBits-1:0] timer_q;
  logic tick_q, refresh_due_q, open_q;  // open_q: a transaction may be accepted
  logic [1:0] late_q;                   // number of pending refreshes, 0 to 3
  logic [1:0] late_d;
  assign late_d = late_q + 2'(tick_q && late_q != 2'd3) - 2'(state_q == Refresh && refresh_due_q);

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      timer_q <= TimerBits'(PowerUp);
      {tick_q, refresh_due_q, open_q} <= '0;
      late_q <= '0;
    end else begin
      timer_q <= tick_q ? TimerBits'(Interval - 1) : timer_q - 1'b1;
      tick_q <= timer_q == TimerBits'(1);
      late_q <= late_d;
      refresh_due_q <= late_d != '0;
      open_q <= late_d == '0 && step_q == ReadyStep;
    end
  end

  // ---- state machine: the command of each state is at the pins in the next clock ----
  transaction_t at_q;
  logic write_q, tag_q, last_q, settled;
  logic [PauseBits-1:0] pause_q, pause_d;
  logic [HoldBits-1:0] hold_q;  // number of ones: clocks until the row may close
  assign ready_o = state_q == Idle && open_q;
  assign settled = !hold_q[0];

  always_comb begin
    state_d = state_q;
    step_d = step_q;
    more_d = more_q;
    after_d = after_q;
    pause_d = pause_q >> 1;
    unique case (state_q)
      Idle: begin
        unique case (step_q)
          PowerUpStep: if (tick_q) {state_d, step_d} = {Close, RefreshStep};
          RefreshStep: begin
            state_d = Refresh;
            more_d = more_q - 1'b1;
            if (more_q == '0) step_d = ModeStep;
          end
          ModeStep: {state_d, step_d} = {Mode, ReadyStep};
          default: if (refresh_due_q) state_d = Refresh;
              else if (valid_i && open_q) state_d = Activate;
        endcase
      end
      Activate: begin
        pause_d = ones(Rcd - 2);
        after_d = Column;
        state_d = Pause;
      end
      Column: if (last_q) state_d = Close;
      Close: if (settled) begin
        pause_d = ones(Rp - 3);
        after_d = Idle;
        state_d = Rp > 2 ? Pause : Idle;
      end
      Refresh: begin
        pause_d = ones(Rfc - 3);
        after_d = Idle;
        state_d = Rfc > 2 ? Pause : Idle;
      end
      Mode: begin
        pause_d = ones(Mrd - 3);
        after_d = Idle;
        state_d = Mrd > 2 ? Pause : Idle;
      end
      default: if (!pause_q[0]) state_d = after_q;
    endcase
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Idle;
      after_q <= Idle;
      step_q <= PowerUpStep;
      more_q <= '1;
      pause_q <= '0;
      hold_q <= '0;
      write_take_o <= 1'b0;
    end else begin
      state_q <= state_d;
      after_q <= after_d;
      step_q <= step_d;
      more_q <= more_d;
      pause_q <= pause_d;
      hold_q <= hold_q >> 1 | (state_q == Activate ? HoldBits'(ones(Ras - 1)) : '0)
          | (write_take_o ? HoldBits'(ones(Wr - 1)) : '0);
      write_take_o <= state_d == Column && write_q;
    end
  end

  logic [ColumnBits:0] remaining_q;
  always_ff @(posedge clk_i) begin
    if (ready_o) begin
      at_q <= transaction_i;
      write_q <= write_i;
      tag_q <= tag_i;
      remaining_q <= transaction_i.count;
    end else if (state_q == Activate) begin
      last_q <= remaining_q == (ColumnBits + 1)'(1);
    end else if (state_q == Column) begin
      at_q.column <= at_q.column + 1'b1;
      remaining_q <= remaining_q - 1'b1;
      last_q <= remaining_q == (ColumnBits + 1)'(2);
    end
  end
  logic unused_at;
  assign unused_at = ^{at_q.count, at_q.last};

  // ---- register the outputs to the SDRAM's pins ----
  assign cs_no = 1'b0;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      cke_o <= 1'b0;
      {ras_no, cas_no, we_no} <= '1;
      dqm_o <= '1;
      dq_oe_o <= 1'b0;
    end else begin
      cke_o <= 1'b1;
      ras_no <= !(state_q == Activate || (state_q == Close && settled) || state_q == Refresh
          || state_q == Mode);
      cas_no <= !(state_q == Column || state_q == Refresh || state_q == Mode);
      we_no <= !(write_take_o || (state_q == Close && settled) || state_q == Mode);
      if (step_q == ReadyStep) dqm_o <= '0;
      dq_oe_o <= write_take_o;
    end
  end
  always_ff @(posedge clk_i) begin
    ba_o <= state_q == Mode ? '0 : at_q.bank;
    // Bit A10 is high for PRECHARGE ALL. In the mode register, the code of burst length 1 is zero.
    if (state_q == Column) a_o <= RowBits'(at_q.column);
    else if (state_q == Close) a_o <= RowBits'(1 << 10);
    else if (state_q == Mode) a_o <= RowBits'(Timing.cas_clocks << 4);
    else a_o <= at_q.row;
    dq_o <= write_word_i;
  end

  // ---- mark the words read with the tag of their transaction ----
  logic [ReadClocks-1:0] valid_q, word_tag_q;
  assign read_valid_o = valid_q[ReadClocks-1];
  assign read_tag_o = word_tag_q[ReadClocks-1];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) valid_q <= '0;
    else valid_q <= {valid_q[ReadClocks-2:0], state_q == Column && !write_q};
  end
  always_ff @(posedge clk_i) begin
    word_tag_q <= {word_tag_q[ReadClocks-2:0], tag_q};
    read_word_o <= dq_i;
  end

endmodule

`default_nettype wire
