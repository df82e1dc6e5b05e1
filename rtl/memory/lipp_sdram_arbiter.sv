// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Selects which client's transaction the SDRAM executes next. Client `show` has the highest
/// priority, then client `write`, then client `read`.
///
/// After a transaction of `show`, a waiting client `write` has priority over the next transaction
/// of `show`. Therefore client `show` waits for at most one transaction of another client. After
/// the current transaction, client `write` waits for at most one transaction of `show`. The client
/// `read` is served only when no other client is waiting. The selection is combinational, and may
/// change until the clock in which ready_i is high.
module lipp_sdram_arbiter
  import lipp_sdram_pkg::*;
(
  input  logic         clk_i,
  input  logic         rst_ni,

  input  logic         show_valid_i,
  output logic         show_ready_o,
  input  transaction_t show_i,
  input  logic         write_valid_i,
  output logic         write_ready_o,
  input  transaction_t write_i,
  input  logic         read_valid_i,
  output logic         read_ready_o,
  input  transaction_t read_i,

  output logic         valid_o,
  input  logic         ready_i,
  output transaction_t transaction_o,
  output logic         write_o,  // 1: client write is selected
  output logic         show_o    // 1: client show is selected
);

  logic show_served_q;  // 1: the last transaction belonged to client show
  assign show_o = show_valid_i && !(show_served_q && write_valid_i);
  assign write_o = write_valid_i && !show_o;
  assign valid_o = show_valid_i || write_valid_i || read_valid_i;
  assign transaction_o = show_o ? show_i : write_o ? write_i : read_i;

  assign show_ready_o = ready_i && show_o;
  assign write_ready_o = ready_i && write_o;
  assign read_ready_o = ready_i && !show_o && !write_o;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) show_served_q <= 1'b0;
    else if (valid_o && ready_i) show_served_q <= show_o;
  end

endmodule

`default_nettype wire
