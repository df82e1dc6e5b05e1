// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Delays a word by a fixed number of clocks: q(t) = d(t - Cycles).
///
/// The module builds short delays from registers, and longer delays from ring buffers in
/// distributed or block memory. With ring buffers a simulator updates only a few words per clock,
/// and synthesis infers memories instead of long chains of registers.
module lipp_delay #(
  parameter int Width = 1,   // number of bits of the word
  parameter int Cycles = 1,  // latency in clocks, 0 or more
  parameter bit Block = 1'b1 // 0: long delays use only distributed memory
) (
  input  logic             clk_i,
  input  logic [Width-1:0] d_i,
  output logic [Width-1:0] q_o
);

  localparam int LongestChain = 5;
  // maximum length of a ring buffer: 16 entries of distributed memory plus the output register
  localparam int LongestRing = 17;

  if (Width < 1 || Cycles < 0) begin : gen_illegal
    $fatal(1, "lipp_delay: Width must be 1 or more and Cycles 0 or more");
  end else if (Cycles == 0) begin : gen_wire
    assign q_o = d_i;
    logic unused_clk;
    assign unused_clk = clk_i;
  end else if (Cycles <= LongestChain) begin : gen_chain
    for (genvar k = 0; k < Cycles; k++) begin : gen_stage
      logic [Width-1:0] q;
      if (k == 0) begin : gen_first
        always_ff @(posedge clk_i) q <= d_i;
      end else begin : gen_next
        always_ff @(posedge clk_i) q <= gen_stage[k-1].q;
      end
    end
    assign q_o = gen_stage[Cycles-1].q;
  end else if (Cycles <= LongestRing) begin : gen_ring
    lipp_ring #(.Width(Width), .Cycles(Cycles)) i_ring (.clk_i, .d_i, .q_o);
  end else if (!Block) begin : gen_rings
    // Use as few ring buffers as possible, with lengths that differ by at most one.
    localparam int Rings = (Cycles + LongestRing - 1) / LongestRing;
    for (genvar k = 0; k < Rings; k++) begin : gen_part
      logic [Width-1:0] d, q;
      if (k == 0) begin : gen_first
        assign d = d_i;
      end else begin : gen_next
        assign d = gen_part[k-1].q;
      end
      lipp_ring #(.Width(Width), .Cycles((Cycles + k) / Rings)) i_ring (.clk_i, .d_i(d), .q_o(q));
    end
    assign q_o = gen_part[Rings-1].q;
  end else begin : gen_block_ring
    lipp_block_ring #(.Width(Width), .Cycles(Cycles)) i_ring (.clk_i, .d_i, .q_o);
  end

endmodule

`default_nettype wire
