// SPDX-License-Identifier: Apache-2.0
/// Replaces `lipp_fifo` in proofs of other modules. The outputs of this module are arbitrary.
///
/// The module fifo_checks with AssumeFifo = 1 restricts the outputs to the behaviour that the proof
/// of `lipp_fifo` has shown.
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
