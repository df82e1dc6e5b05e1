// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Surrounds a design with registers for place-and-route trials, so that a few pins can drive and
/// read all ports of the design.
///
/// Every input of the design comes from a shift register, and every output is combined into a
/// register. Therefore no logic is optimised away, and no timing path ends at a pin.
module probe #(
  parameter int In = 1,
  parameter int Out = 1
) (
  input  logic           clk_i,
  input  logic           rst_ni,
  input  logic           bit_i,
  output logic           bit_o,
  output logic           rst_no,  // reset of the design under test
  output logic [In-1:0]  in_o,    // inputs of the design under test
  input  logic [Out-1:0] out_i    // outputs of the design under test
);

  // Synthesis keeps these names, so that the report can tell these registers from the design's.
  (* keep *) logic [1:0] reset_q;  // high in reset, because the FPGA's cells need this polarity
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
