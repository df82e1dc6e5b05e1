// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Shape and timing of the SDRAM: 4 banks x 8192 rows x 512 columns of 16 bits (MT48LC16M16A2).
package lipp_sdram_pkg;
  // Most modules use only some of these.
  /* verilator lint_off UNUSEDPARAM */

  localparam int WordBits = 16;
  localparam int BankBits = 2;
  localparam int RowBits = 13;
  localparam int ColumnBits = 9;
  localparam int RowWords = 1 << ColumnBits;

  /// Words in a row: count of them from a column on, count <= RowWords - column.
  typedef struct packed {
    logic [RowBits-1:0] row;
    logic [BankBits-1:0] bank;
    logic [ColumnBits-1:0] column;
    logic [ColumnBits:0] count;
    logic last;  // of its request
  } transaction_t;

  /// The data sheet's least times, but for the refresh: `rows` of them in refresh_ms at most.
  typedef struct packed {
    logic [15:0] cas_clocks;  // CAS latency: 2 or 3
    logic [15:0] rcd_ns;      // ACTIVE to READ or WRITE
    logic [15:0] rp_ns;       // PRECHARGE to the bank's next command
    logic [15:0] ras_ns;      // ACTIVE to PRECHARGE
    logic [15:0] rc_ns;       // ACTIVE to ACTIVE of a bank
    logic [15:0] rfc_ns;      // AUTO REFRESH to the next command
    logic [15:0] wr_ns;       // last word written to PRECHARGE
    logic [15:0] mrd_clocks;  // LOAD MODE REGISTER to the next command
    logic [15:0] power_up_us; // stable clock to the first command
    logic [15:0] refresh_ms;
    logic [15:0] rows;
  } timing_t;

  /// Speed grades of the MT48LC16M16A2: to 133, 143 and 167 MHz. Some makers' chips of this class
  /// need 200 us at power-up for Micron's 100.
  localparam timing_t Grade75 = '{3, 20, 20, 44, 66, 66, 15, 2, 200, 64, 8192};
  localparam timing_t Grade7E = '{3, 15, 15, 37, 60, 66, 14, 2, 200, 64, 8192};
  localparam timing_t Grade6A = '{3, 18, 18, 42, 60, 60, 12, 2, 200, 64, 8192};

  /// Clocks that last at least so long.
  function automatic int clocks(logic [15:0] ns, int hz);
    return int'((longint'(ns) * longint'(hz) + 999_999_999) / 1_000_000_000);
  endfunction

  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
