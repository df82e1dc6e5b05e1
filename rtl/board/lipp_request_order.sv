// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Tells which requests were executed before: those that change the board are executed once, in the
/// order of their numbers (modulo 65536).
///
/// The last one executed is remembered with its status. It expires when the numbers are 32768
/// beyond its own, before newer ones would seem older; so numbers of all requests count. A request
/// is older by 1 to 32767. A new session, a HELLO with a new nonce, forgets the last one.
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
  input  logic                         executed_i,  // with answer_i: it was executed, with this status
  input  lipp_link_pkg::reply_status_e status_i
);
  import lipp_link_pkg::*;

  logic known_q;  // there is a last one
  request_e kind_q;
  logic [15:0] number_q, newest_q, newest, after;
  logic [31:0] nonce_q;
  assign after = number_i - number_q;
  assign repeated_o = known_q && kind_q == kind_i && after == '0;
  assign older_o = known_q && !repeated_o && (after == '0 || after > 16'h8000);
  assign newest = 16'(number_i - newest_q) <= 16'h8000 ? number_i : newest_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      known_q <= 1'b0;
      kind_q <= RequestHello;
      {number_q, newest_q, nonce_q} <= '0;
      status_o <= StatusOk;
    end else if (hello_i && nonce_i != nonce_q) begin
      known_q <= 1'b0;
      newest_q <= number_i;
      nonce_q <= nonce_i;
    end else if (answer_i) begin
      newest_q <= newest;
      if (executed_i) begin
        known_q <= 1'b1;
        {kind_q, number_q} <= {kind_i, number_i};
        status_o <= status_i;
      end else if (16'(newest - number_q) >= 16'h8000) begin
        known_q <= 1'b0;
      end
    end
  end

endmodule

`default_nettype wire
