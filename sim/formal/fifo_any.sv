// SPDX-License-Identifier: Apache-2.0
/// `lipp_fifo` for proofs of what is around it: its outputs are free. fifo_checks, with AssumeFifo,
/// holds them to the contract that the proof `lipp_fifo` proves.
module lipp_fifo #(
  parameter int Width = 36,
  parameter int AddressBits = 9
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             write_i,
  input  logic [Width-1:0] data_i,
  output logic             valid_o,
  input  logic             ready_i,
  output logic [Width-1:0] data_o
);

  (* anyseq *) reg valid;
  (* anyseq *) reg [Width-1:0] data;
  assign valid_o = valid;
  assign data_o = data;

endmodule
