// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Adds valid/ready handshakes to a pipeline that never stalls.
///
/// A ray is accepted only if the FIFO behind the pipeline has a free entry, and that entry is
/// reserved at once. The ray leaves the pipeline Latency clocks later and enters the FIFO. The
/// pipeline needs no enable, and back-pressure inserts no bubbles. Pipeline and FIFO together
/// contain at most 2^AddressBits rays, which must be more than Latency.
///
/// Input hold_i makes ready_o low from the next clock on, because ready_o is a register. Output
/// idle_o is high while no ray is in the pipeline or in the FIFO, so that the pipeline's
/// configuration can change. The counter of rays counts an accepted ray with a delay of one clock,
/// a leaving ray with a delay of two. Therefore the timing paths from valid_i and ready_i end in
/// registers, and the output may lie far away on the FPGA. Output idle_o falls one clock after a
/// ray is accepted, and rises three clocks after the last ray has left.
module lipp_flow_control #(
  parameter int Latency = 100,
  parameter int AddressBits = 9,
  parameter int Width = 36      // number of bits of a ray that leaves the pipeline
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             hold_i,
  output logic             idle_o,
  input  logic             valid_i,
  output logic             ready_o,
  input  logic [Width-1:0] piped_i,  // ray from the pipeline, Latency clocks after it was accepted
  output logic             valid_o,
  input  logic             ready_i,
  output logic [Width-1:0] data_o
);

  localparam int Room = 1 << AddressBits;

  if (Latency < 1 || Latency > Room - 10) begin : gen_illegal
    $fatal(1, "lipp_flow_control: Latency must be 1 or more, and at most 2^AddressBits - 10");
  end

  logic [AddressBits:0] reserved_q, reserved_d;  // number of reserved FIFO entries
  logic accept, entered;                         // entered: a ray was accepted in the last clock
  logic [1:0] departed_q;                        // bit k: a ray left k + 1 clocks ago

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
      // The FIFO keeps two spare entries for rays that are accepted while ready_o is computed.
      ready_o <= reserved_q < (AddressBits + 1)'(Room - 2) && !hold_i;
    end
  end

  // ---- valid bits of the stages; a simulator shifts the 64 bits of a register in one step ----

  // Held is 1 for an illegal Latency, so that elaboration reaches the error message.
  localparam int Held = Latency < 1 ? 1 : Latency;
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
