/// The words in use beside the words being written: a copy is taken over only while nothing uses it.
///
/// apply_i asks for a new copy of config_i, which is made in the first clock after it in which idle_i
/// is high. busy_o tells that a copy is still to be made: nothing may start to use config_o before.
/// After reset a copy is asked for at once.
module config_bank #(
  parameter int Width = 32
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic [Width-1:0] config_i,
  input  logic             apply_i,
  input  logic             idle_i,    // nothing uses config_o
  output logic             busy_o,
  output logic [Width-1:0] config_o
);

  logic pending_q;
  logic [Width-1:0] config_q;
  assign busy_o = pending_q;
  assign config_o = config_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) pending_q <= 1'b1;
    else if (apply_i) pending_q <= 1'b1;
    else if (idle_i) pending_q <= 1'b0;
  end

  always_ff @(posedge clk_i) if (pending_q && idle_i) config_q <= config_i;

endmodule
