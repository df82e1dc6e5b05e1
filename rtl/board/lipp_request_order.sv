// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Detects requests that were already executed. Each request that changes the board is executed
/// once, in the order of the request numbers, which count modulo 65536.
///
/// The module remembers the last executed request and its status. The module forgets the remembered
/// request when a request arrives whose number is 32768 above the remembered number, because the
/// next request numbers would count as older. A request is older than the remembered request if its
/// number is lower by 1 to 32767 (modulo 65536). A HELLO with a new nonce starts a new session and
/// clears the remembered request.
///
/// Outputs repeated_o and older_o are registers. Both outputs are valid one clock after kind_i and
/// number_i change. Inputs kind_i and number_i must be stable until answer_i, and for two clocks
/// before answer_i or hello_i.
module lipp_request_order (
  input  logic                         clk_i,
  input  logic                         rst_ni,
  input  lipp_link_pkg::request_e      kind_i,
  input  logic [15:0]                  number_i,
  output logic                         repeated_o,  // 1: request repeats the last executed one
  output logic                         older_o,  // 1: request is older than the last executed
  output lipp_link_pkg::reply_status_e status_o, // status of the last executed request

  // pulse: the request is a HELLO, and nonce_i is its nonce
  input  logic                         hello_i,
  input  logic [31:0]                  nonce_i,
  input  logic                         answer_i,  // pulse: the request is being answered
  // with answer_i, 1: the request was executed and returned status_i
  input  logic                         executed_i,
  input  lipp_link_pkg::reply_status_e status_i
);
  import lipp_link_pkg::*;

  logic newest_valid_q;           // 1: an executed request is remembered
  logic same, newer_q, passed_q;  // passed_q: a request was answered but not executed
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
