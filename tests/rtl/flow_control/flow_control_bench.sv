/// flow_control around a pipeline that only delays.
module flow_control_bench #(
  parameter int Latency = 8,
  parameter int AddressBits = 4,
  parameter int Width = 20
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             hold_i,
  output logic             idle_o,
  input  logic             valid_i,
  output logic             ready_o,
  input  logic [Width-1:0] data_i,
  output logic             valid_o,
  input  logic             ready_i,
  output logic [Width-1:0] data_o
);

  logic [Width-1:0] piped;
  lipp_delay #(.Width(Width), .Cycles(Latency)) i_pipeline (.clk_i, .d_i(data_i), .q_o(piped));
  lipp_flow_control #(.Latency(Latency), .AddressBits(AddressBits), .Width(Width)) i_flow (
    .clk_i, .rst_ni, .hold_i, .idle_o, .valid_i, .ready_o, .piped_i(piped),
    .valid_o, .ready_i, .data_o
  );

endmodule
