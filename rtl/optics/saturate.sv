`default_nettype none

/// Narrows a signed word: values out of range become the largest or smallest. Latency 1.
module saturate #(
  parameter int From = 20,
  parameter int To = 18
) (
  input  logic                   clk_i,
  input  logic signed [From-1:0] d_i,
  output logic signed [To-1:0]   q_o
);

  if (To < 1 || To > From) begin : gen_illegal
    $fatal(1, "saturate: To must be 1 or more and From no less");
  end

  logic fits;
  assign fits = d_i[From-1:To-1] == {(From - To + 1){d_i[From-1]}};
  always_ff @(posedge clk_i) begin
    q_o <= fits ? d_i[To-1:0] : {d_i[From-1], {(To - 1){~d_i[From-1]}}};
  end

endmodule

`default_nettype wire
