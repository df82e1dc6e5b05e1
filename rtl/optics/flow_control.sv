`default_nettype none

/// Valid and ready around a pipeline that never stops: rays enter only while there is room for all.
///
/// A ray accepted at the input is marked valid and comes out Latency clocks later into a FIFO,
/// whose room was set aside when it was accepted. Nothing in the pipeline needs an enable, and
/// back-pressure costs no bubble: up to 2^AddressBits rays are on the way or wait, more than
/// Latency.
///
/// hold_i closes the input; idle_o tells that no ray is on the way or waits, so that what the
/// pipeline computes with may change.
module flow_control #(
  parameter int Latency = 100,
  parameter int AddressBits = 9,
  parameter int Width = 36      // bits of a ray that leaves the pipeline
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             hold_i,
  output logic             idle_o,
  input  logic             valid_i,
  output logic             ready_o,
  input  logic [Width-1:0] piped_i,  // from the pipeline, Latency clocks after its ray went in
  output logic             valid_o,
  input  logic             ready_i,
  output logic [Width-1:0] data_o
);

  localparam int Room = 1 << AddressBits;

  if (Latency < 1 || Latency > Room - 8) begin : gen_illegal
    $fatal(1, "flow_control: Latency must be 1 to 8 less than the FIFO's places");
  end

  logic [AddressBits:0] taken_q, taken_d;  // rays that have a place set aside
  logic open_q, accept, leave;

  assign ready_o = open_q && !hold_i;
  assign accept = valid_i && ready_o;
  assign leave = valid_o && ready_i;
  assign taken_d = taken_q + (AddressBits + 1)'(accept) - (AddressBits + 1)'(leave);
  assign idle_o = taken_q == '0;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      taken_q <= '0;
      open_q <= 1'b0;
    end else begin
      taken_q <= taken_d;
      // One place is kept back, for a ray that is accepted while this is being decided.
      open_q <= taken_q < (AddressBits + 1)'(Room - 1);
    end
  end

  // ---- which stages hold a ray, 64 to a register: what a simulator shifts at once ----
  localparam int Held = Latency < 1 ? 1 : Latency;  // that a refused Latency gets to its message
  localparam int Marks = (Held + 63) / 64;
  for (genvar k = 0; k < Marks; k++) begin : gen_marks
    localparam int Stages = Held - 64 * k < 64 ? Held - 64 * k : 64;
    logic [Stages-1:0] valid_q;
    logic enter;
    if (k == 0) begin : gen_first
      assign enter = accept;
    end else begin : gen_next
      assign enter = gen_marks[k-1].valid_q[63];
    end
    always_ff @(posedge clk_i or negedge rst_ni) begin
      if (!rst_ni) valid_q <= '0;
      else valid_q <= (valid_q << 1) | Stages'(enter);
    end
  end

  fifo #(.Width(Width), .AddressBits(AddressBits)) i_fifo (
    .clk_i, .rst_ni, .write_i(gen_marks[Marks-1].valid_q[(Held-1)%64]), .data_i(piped_i),
    .valid_o, .ready_i, .data_o
  );

endmodule

`default_nettype wire
