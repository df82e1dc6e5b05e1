// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Adds valid/ready handshakes to a pipeline that never stalls.
///
/// A ray is accepted only if the FIFO behind the pipeline has room for it, and that room is
/// reserved at once. The ray leaves the pipeline Latency clocks later and enters the FIFO. The
/// pipeline needs no enable, and back-pressure inserts no bubbles: 2^AddressBits rays, more than
/// Latency, fit into pipeline and FIFO.
///
/// hold_i closes the input in the next clock: ready_o is a register. idle_o: no ray is in the
/// pipeline or in the FIFO, so that the pipeline's configuration may change. A ray that comes is
/// counted a clock later, one that leaves two clocks later: the ways from valid_i and ready_i end
/// in registers, and the output may be far away. idle_o falls with a ray that comes, and rises
/// three clocks after the last one left.
module lipp_flow_control #(
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

  if (Latency < 1 || Latency > Room - 10) begin : gen_illegal
    $fatal(1, "lipp_flow_control: Latency must be 1 to 10 less than the FIFO's places");
  end

  logic [AddressBits:0] reserved_q, reserved_d;  // rays with a reserved place
  logic accept, entered;                   // entered: in the last clock
  logic [1:0] departed_q;                      // a ray left, one and two clocks ago

  assign accept = valid_i && ready_o;
  assign reserved_d = reserved_q + (AddressBits + 1)'(entered) - (AddressBits + 1)'(departed_q[1]);

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      reserved_q <= '0;
      departed_q <= '0;
      idle_o <= 1'b1;
      ready_o <= 1'b0;
    end else begin
      reserved_q <= reserved_d;
      departed_q <= {departed_q[0], valid_o && ready_i};
      idle_o <= reserved_q == '0 && !entered && !accept;
      // Two places are spare, for rays that are accepted while this is being computed.
      ready_o <= reserved_q < (AddressBits + 1)'(Room - 2) && !hold_i;
    end
  end

  // ---- stages that hold a ray, 64 to a register: a simulator shifts these in one operation ----
  localparam int Held = Latency < 1 ? 1 : Latency;  // 1: for $fatal of an illegal one
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

  assign entered = gen_marks[0].valid_q[0];

  lipp_fifo #(.Width(Width), .AddressBits(AddressBits)) i_fifo (
    .clk_i, .rst_ni, .write_i(gen_marks[Marks-1].valid_q[(Held-1)%64]), .data_i(piped_i),
    .valid_o, .ready_i, .data_o
  );

endmodule

`default_nettype wire
