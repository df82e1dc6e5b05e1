// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Executes PRESENT requests: swaps the frame buffers if the back buffer has the requested CRC-32.
///
/// Input start_i requests a frame by its epoch and its CRC-32. If the epoch equals the board's
/// epoch, the CRC-32 of the back buffer is computed and compared with the requested CRC-32. If the
/// two CRCs are equal, the buffers are swapped at the next vertical sync and the epoch is
/// incremented. A request for the frame that is already shown succeeds without a swap, because the
/// host repeats a request whose reply was lost. Output done_o is a pulse, and status_o is valid in
/// the same clock.
module lipp_presenter (
  input  logic              clk_i,
  input  logic              rst_ni,

  input  logic                         start_i,
  input  logic [15:0]                  epoch_i,
  input  logic [31:0]                  crc_i,
  output logic                         done_o,
  output lipp_link_pkg::reply_status_e status_o,

  output logic [15:0]       epoch_o,
  // CRC-32 of the last frame shown, valid from one clock after swapped_i
  output logic [31:0]       shown_crc_o,
  output logic              failed_o,        // pulse: the back buffer's CRC-32 is wrong

  output logic              check_start_o,   // pulse: starts lipp_frame_check
  input  logic              check_done_i,
  input  logic [31:0]       check_crc_i,
  output logic              swap_o,          // asks scan_out to swap buffers; high until swapped_i
  input  logic              swapped_i
);
  import lipp_link_pkg::*;

  logic [15:0] epoch_q;
  logic [31:0] crc_q, shown_crc_q;
  logic any_shown_q;
  logic is_current, repeated, equal;
  assign epoch_o = epoch_q;
  assign shown_crc_o = shown_crc_q;
  assign is_current = epoch_i == epoch_q;
  assign repeated = any_shown_q && epoch_i == epoch_q - 1'b1 && crc_i == shown_crc_q;
  assign equal = check_crc_i == crc_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      epoch_q <= '0;
      crc_q <= '0;
      shown_crc_q <= '0;
      any_shown_q <= 1'b0;
      {done_o, failed_o, check_start_o, swap_o} <= '0;
      status_o <= StatusOk;
    end else begin
      check_start_o <= start_i && is_current;
      done_o <= (start_i && !is_current) || (check_done_i && !equal) || (swap_o && swapped_i);
      failed_o <= check_done_i && !equal;
      if (start_i) begin
        crc_q <= crc_i;
        status_o <= is_current || repeated ? StatusOk : StatusStale;
      end else if (check_done_i && !equal) begin
        status_o <= StatusFrameCrc;
      end
      swap_o <= (check_done_i && equal) || (swap_o && !swapped_i);
      if (swap_o && swapped_i) begin
        epoch_q <= epoch_q + 1'b1;
        shown_crc_q <= crc_q;
        any_shown_q <= 1'b1;
      end
    end
  end

endmodule

`default_nettype wire
