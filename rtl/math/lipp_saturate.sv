// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Narrows a signed word to To bits. A value above the range of To bits becomes the maximum, a
/// value below it the minimum. The latency is 1 clock.
///
/// Output beyond_o reports that the value is out of range by more than 2^Slack units in the last
/// place. Rounding errors are smaller, so only an arithmetic overflow sets beyond_o.
module lipp_saturate #(
  parameter int From = 20,
  parameter int To = 18,
  parameter int Slack = lipp_math_pkg::Slack
) (
  input  logic                   clk_i,
  input  logic signed [From-1:0] d_i,
  output logic signed [To-1:0]   q_o,
  output logic                   beyond_o
);

  if (To < 1 || To > From) begin : gen_illegal
    $fatal(1, "lipp_saturate: To must be 1 or more and From no less");
  end
  if (Slack < 0 || Slack >= To) begin : gen_illegal_slack
    $fatal(1, "lipp_saturate: Slack must be 0 or more and less than To");
  end

  localparam int Wu = From > Slack ? From - Slack : 1;
  localparam logic [Wu-1:0] Above = Wu'(1) << (To - 1 - Slack);
  logic fits;
  logic [Wu-1:0] upper;
  assign fits = d_i[From-1:To-1] == {(From - To + 1){d_i[From-1]}};
  assign upper = Wu'(d_i >>> Slack);
  always_ff @(posedge clk_i) begin
    q_o <= fits ? d_i[To-1:0] : {d_i[From-1], {(To - 1){~d_i[From-1]}}};
    beyond_o <= !fits && upper != Above && upper != ~Above;
  end

endmodule

`default_nettype wire
