// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Geometry and timing of the SDRAM MT48LC16M16A2: 4 banks x 8192 rows x 512 columns of 16 bits.
package lipp_sdram_pkg;
  // Most modules use only some of these constants.
  /* verilator lint_off UNUSEDPARAM */

  localparam int WordBits = 16;
  localparam int BankBits = 2;
  localparam int RowBits = 13;
  localparam int ColumnBits = 9;
  localparam int RowWords = 1 << ColumnBits;

  /// A transaction reads or writes `count` words in one row: count <= RowWords - column.
  typedef struct packed {
    logic [RowBits-1:0] row;
    logic [BankBits-1:0] bank;
    logic [ColumnBits-1:0] column;
    logic [ColumnBits:0] count;
    logic last;  // 1: last transaction of its request
  } transaction_t;

  /// Minimum times from the SDRAM's data sheet. The field refresh_ms is a maximum time, in which
  /// `rows` refreshes must be done.
  typedef struct packed {
    logic [15:0] cas_clocks;  // CAS latency, 2 or 3 clocks
    logic [15:0] rcd_ns;      // minimum time from ACTIVE to READ or WRITE
    logic [15:0] rp_ns;       // minimum time from PRECHARGE to the bank's next command
    logic [15:0] ras_ns;      // minimum time from ACTIVE to PRECHARGE
    logic [15:0] rc_ns;       // minimum time from ACTIVE to ACTIVE of the same bank
    logic [15:0] rfc_ns;      // minimum time from AUTO REFRESH to the next command
    logic [15:0] wr_ns;       // minimum time from the last written word to PRECHARGE
    logic [15:0] mrd_clocks;  // minimum time from LOAD MODE REGISTER to the next command
    logic [15:0] power_up_us; // minimum time from a stable clock to the first command
    logic [15:0] refresh_ms;
    logic [15:0] rows;
  } timing_t;

  /// Speed grades of the MT48LC16M16A2 for up to 133, 143 and 167 MHz. The power-up time is 200 us
  /// instead of Micron's 100 us, because similar SDRAMs of some other manufacturers need 200 us.
  localparam timing_t Grade75 = '{3, 20, 20, 44, 66, 66, 15, 2, 200, 64, 8192};
  localparam timing_t Grade7E = '{3, 15, 15, 37, 60, 66, 14, 2, 200, 64, 8192};
  localparam timing_t Grade6A = '{3, 18, 18, 42, 60, 60, 12, 2, 200, 64, 8192};

  /// Return the minimum number of clocks that last at least `ns` nanoseconds.
  function automatic int clocks(logic [15:0] ns, int hz);
    return int'((longint'(ns) * longint'(hz) + 999_999_999) / 1_000_000_000);
  endfunction

  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
