// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Joins each group of Parts words of a stream into one wide word. The first word of a group
/// becomes the highest part.
///
/// A wide word is valid one clock after its last part arrived. The throughput is one part per
/// clock. Output in_ready_o follows out_ready_i in the same clock.
module lipp_word_join #(
  parameter int Width = 16,
  parameter int Parts = 3
) (
  input  logic                   clk_i,
  input  logic                   rst_ni,
  input  logic                   in_valid_i,
  output logic                   in_ready_o,
  input  logic [Width-1:0]       in_data_i,
  output logic                   out_valid_o,
  input  logic                   out_ready_i,
  output logic [Width*Parts-1:0] out_data_o
);

  if (Width < 1 || Parts < 2) begin : gen_illegal
    $fatal(1, "lipp_word_join: Width must be 1 or more and Parts 2 or more");
  end

  localparam int C = $clog2(Parts);
  logic [C-1:0] part_q;
  logic take, last;
  assign in_ready_o = !out_valid_o || out_ready_i;
  assign take = in_valid_i && in_ready_o;
  assign last = part_q == C'(Parts - 1);

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      part_q <= '0;
      out_valid_o <= 1'b0;
    end else begin
      if (take) part_q <= last ? '0 : part_q + 1'b1;
      out_valid_o <= (take && last) || (out_valid_o && !out_ready_i);
    end
  end
  always_ff @(posedge clk_i) if (take) out_data_o <= {out_data_o[Width*(Parts-1)-1:0], in_data_i};

endmodule

`default_nettype wire
