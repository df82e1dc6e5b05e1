// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Registers both directions of a valid/ready stream, which breaks all combinational paths.
///
/// The latency is 1 clock, and the throughput is one word per clock. Output in_ready_o is a
/// register and therefore falls one clock late. A word that arrives while in_ready_o is still high
/// waits in a second register. Output in_ready_o is low during reset. Input clear_i drops the
/// stored words and the incoming word: from the next clock on the buffer is empty and ready.
module lipp_skid_buffer #(
  parameter int Width = 8
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             clear_i,
  input  logic             in_valid_i,
  output logic             in_ready_o,
  input  logic [Width-1:0] in_data_i,
  output logic             out_valid_o,
  input  logic             out_ready_i,
  output logic [Width-1:0] out_data_o
);

  if (Width < 1) begin : gen_illegal
    $fatal(1, "lipp_skid_buffer: Width must be 1 or more");
  end

  logic into, move;       // into: a word arrives; move: the output register is free
  logic spare_d, spare_q; // 1: a word is in the second register
  logic [Width-1:0] spare_data_q;
  assign into = in_valid_i && in_ready_o;
  assign move = !out_valid_o || out_ready_i;
  assign spare_d = !move && (spare_q || into);

  always_ff @(posedge clk_i) begin
    if (!spare_q) spare_data_q <= in_data_i;
    if (move) out_data_o <= spare_q ? spare_data_q : in_data_i;
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {in_ready_o, out_valid_o, spare_q} <= '0;
    end else if (clear_i) begin
      {in_ready_o, out_valid_o, spare_q} <= 3'b100;
    end else begin
      in_ready_o <= !spare_d;
      out_valid_o <= !move || spare_q || into;
      spare_q <= spare_d;
    end
  end

endmodule

`default_nettype wire
