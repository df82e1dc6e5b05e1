// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Sends up to Bytes bytes of a reply from a register as a byte stream, the lowest byte first. The
/// first byte is valid one clock after load_i.
///
/// Input load_i loads the bytes bytes_i and their number count_i. Input load_i also loads last_i;
/// if last_i is 1, the bytes end the packet. Input load_i is ignored while busy_o is high.
module lipp_reply_writer #(
  parameter int Bytes = 4
) (
  input  logic                       clk_i,
  input  logic                       rst_ni,
  input  logic                       load_i,
  input  logic [8*Bytes-1:0]         bytes_i,
  input  logic [$clog2(Bytes+1)-1:0] count_i,  // number of bytes to send, 1 or more
  input  logic                       last_i,
  output logic                       busy_o,
  output logic                       valid_o,
  input  logic                       ready_i,
  output logic [7:0]                 data_o,
  output logic                       last_o
);

  logic [8*Bytes-1:0] bytes_q;
  logic [$clog2(Bytes+1)-1:0] remaining_q;
  logic last_q;
  assign valid_o = remaining_q != '0;
  assign busy_o = valid_o;
  assign data_o = bytes_q[7:0];
  assign last_o = last_q && remaining_q == 1;

  always_ff @(posedge clk_i) begin
    if (load_i && !busy_o) {last_q, bytes_q} <= {last_i, bytes_i};
    else if (valid_o && ready_i) bytes_q <= bytes_q >> 8;
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) remaining_q <= '0;
    else if (load_i && !busy_o) remaining_q <= count_i;
    else if (valid_o && ready_i) remaining_q <= remaining_q - 1'b1;
  end

endmodule

`default_nettype wire
