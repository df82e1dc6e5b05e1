// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Tells which requests were executed before: those that change the board are executed once, in the
/// order of their numbers (modulo 65536).
///
/// The last one executed is remembered with its status. It expires when the numbers are 32768
/// beyond its own, before newer ones would seem older; so numbers of all requests count. A request
/// is older by 1 to 32767. A new session, a HELLO with a new nonce, forgets the last one.
///
/// repeated_o and older_o are registers: they tell of kind_i and number_i one clock after these
/// came. kind_i and number_i hold until the answer, and for two clocks before it or before hello_i.
module lipp_request_order (
  input  logic                         clk_i,
  input  logic                         rst_ni,
  input  lipp_link_pkg::request_e      kind_i,
  input  logic [15:0]                  number_i,
  output logic                         repeated_o,  // the last one executed, again
  output logic                         older_o,  // than that one
  output lipp_link_pkg::reply_status_e status_o,  // of that one

  input  logic                         hello_i,  // a session may begin
  input  logic [31:0]                  nonce_i,
  input  logic                         answer_i,  // the request is answered
  // with answer_i: it was executed, with this status
  input  logic                         executed_i,
  input  lipp_link_pkg::reply_status_e status_i
);
  import lipp_link_pkg::*;

  logic newest_valid_q;                  // there is a last one
  logic same, newer_q, passed_q;  // passed: a request was answered that was not executed
  request_e kind_q;
  logic [15:0] number_q, newest_q, after;
  logic [31:0] nonce_q;
  assign same = kind_q == kind_i && number_q == number_i;
  assign after = number_i - number_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {newest_valid_q, repeated_o, older_o, newer_q, passed_q} <= '0;
      kind_q <= RequestHello;
      {number_q, newest_q, nonce_q} <= '0;
      status_o <= StatusOk;
    end else begin
      repeated_o <= newest_valid_q && same;
      older_o <= newest_valid_q && !same && (after == '0 || after > 16'h8000);
      newer_q <= 16'(number_i - newest_q) <= 16'h8000;
      passed_q <= answer_i && !executed_i;
      if (passed_q && 16'(newest_q - number_q) >= 16'h8000) newest_valid_q <= 1'b0;
      if (hello_i && nonce_i != nonce_q) begin
        newest_valid_q <= 1'b0;
        newest_q <= number_i;
        nonce_q <= nonce_i;
      end else if (answer_i) begin
        if (newer_q) newest_q <= number_i;
        if (executed_i) begin
          newest_valid_q <= 1'b1;
          {kind_q, number_q} <= {kind_i, number_i};
          status_o <= status_i;
        end
      end
    end
  end

endmodule

`default_nettype wire
