// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Splits each word of a stream into Parts narrower words, the highest part first.
///
/// The throughput is one part per clock, and the latency is 0. The input word must be stable until
/// its last part is taken.
module lipp_word_split #(
  parameter int Width = 16,
  parameter int Parts = 3
) (
  input  logic                   clk_i,
  input  logic                   rst_ni,
  input  logic                   in_valid_i,
  output logic                   in_ready_o,
  input  logic [Width*Parts-1:0] in_data_i,
  output logic                   out_valid_o,
  input  logic                   out_ready_i,
  output logic [Width-1:0]       out_data_o
);

  if (Width < 1 || Parts < 2) begin : gen_illegal
    $fatal(1, "lipp_word_split: Width must be 1 or more and Parts 2 or more");
  end

  localparam int C = $clog2(Parts);
  logic [C-1:0] part_q;  // number of parts that follow the current part
  logic last;
  assign last = part_q == '0;
  assign out_valid_o = in_valid_i;
  assign in_ready_o = out_ready_i && last;
  always_comb begin
    out_data_o = in_data_i[Width-1:0];
    for (int k = 1; k < Parts; k++) if (part_q == C'(k)) out_data_o = in_data_i[Width*k+:Width];
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) part_q <= C'(Parts - 1);
    else if (in_valid_i && out_ready_i) part_q <= last ? C'(Parts - 1) : part_q - 1'b1;
  end

endmodule

`default_nettype wire
