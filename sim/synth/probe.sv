// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Registers around a design for place-and-route: a few pins fill and read them.
///
/// Every input of the design comes from a shift register, and every output is combined into a
/// register: no logic is optimised away, and no timing path ends at a pin.
module probe #(
  parameter int In = 1,
  parameter int Out = 1
) (
  input  logic           clk_i,
  input  logic           rst_ni,
  input  logic           bit_i,
  output logic           bit_o,
  output logic           rst_no,  // of the design
  output logic [In-1:0]  in_o,    // to its inputs
  input  logic [Out-1:0] out_i    // from its outputs
);

  // The names are kept, so that the report can tell these registers from the design's.
  (* keep *) logic [1:0] reset_q;  // high: the cells' resets are
  (* keep *) logic [In-1:0] in_q;
  (* keep *) logic [Out-1:0] out_q, fold_q;
  (* keep *) logic bit_q;
  assign rst_no = !reset_q[1];
  assign in_o = in_q;
  assign bit_o = bit_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) reset_q <= '1;
    else reset_q <= {reset_q[0], 1'b0};
  end
  always_ff @(posedge clk_i) begin
    in_q <= In'({in_q, bit_i});
    out_q <= out_i;
    fold_q <= out_q ^ (fold_q << 1);
    bit_q <= fold_q[Out-1];
  end

endmodule

`default_nettype wire
