/// Delays a word by a fixed number of cycles: q(t) = d(t - Cycles).
///
/// Long delays are chains of ring memories of 16 places: a simulator touches few words a cycle, and
/// synthesis finds the small memories of FPGAs instead of chains of registers.
module delay #(
  parameter int Width = 1,   // bits of the word
  parameter int Cycles = 1   // latency, 0 or more
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  localparam int Longest = 17;  // cycles of a ring of 16 places

  if (Width < 1 || Cycles < 0) begin : gen_illegal
    $fatal(1, "delay: Width must be 1 or more and Cycles 0 or more");
  end

  if (Cycles == 0) begin : gen_wire
    assign q_o = d_i;
    logic unused_clk;
    assign unused_clk = clk_i;
  end else if (Cycles == 1) begin : gen_one
    always_ff @(posedge clk_i) q_o <= d_i;
  end else if (Cycles == 2) begin : gen_two
    logic [Width-1:0] q1;
    always_ff @(posedge clk_i) begin
      q1  <= d_i;
      q_o <= q1;
    end
  end else if (Cycles <= Longest) begin : gen_ring
    ring #(.Width(Width), .Cycles(Cycles)) i_ring (.clk_i, .d_i, .q_o);
  end else begin : gen_chain
    logic [Width-1:0] between;
    ring #(.Width(Width), .Cycles(Longest)) i_first (.clk_i, .d_i, .q_o(between));
    delay #(.Width(Width), .Cycles(Cycles - Longest)) i_rest (.clk_i, .d_i(between), .q_o);
  end

endmodule
