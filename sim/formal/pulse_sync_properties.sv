// SPDX-License-Identifier: Apache-2.0
/// Proves that `lipp_pulse_sync` loses no accepted pulse between two arbitrary clocks: the solver
/// chooses when each clock has an edge.
///
/// Each accepted pulse produces one output pulse before the next pulse can be accepted.
module pulse_sync_properties (
  input logic from_clk_i,
  input logic to_clk_i,
  input logic rst_ni,
  input logic pulse_i
);

  logic busy, pulse;
  lipp_pulse_sync i_sync (
    .from_clk_i, .from_rst_ni(rst_ni), .from_pulse_i(pulse_i), .from_busy_o(busy),
    .to_clk_i, .to_rst_ni(rst_ni), .to_pulse_o(pulse)
  );

  // Reset is active only in the first step of the proof: a later reset leads to the same state.
  reg started_q = 0;
  always @($global_clock) started_q <= 1;
  always @* assume(rst_ni == started_q);

  // accepted_q: number of accepted pulses; received_q: number of clocks with an output pulse
  reg [1:0] accepted_q, received_q;
  always @(posedge from_clk_i or negedge rst_ni) begin
    if (!rst_ni) accepted_q <= 0;
    else accepted_q <= accepted_q + (pulse_i && !busy);
  end
  always @(posedge to_clk_i or negedge rst_ni) begin
    if (!rst_ni) received_q <= 0;
    else received_q <= received_q + pulse;
  end
  wire [1:0] late = accepted_q - received_q;

  // These registers carry the level to the other clock and back; at most one adjacent pair differs.
  (* hierconn *) wire \i_sync.level_q ;
  (* hierconn *) wire \i_sync.there_q ;
  (* hierconn *) wire [1:0] \i_sync.i_there.stage_q ;
  (* hierconn *) wire [1:0] \i_sync.i_back.stage_q ;
  wire [5:0] levels = {
    \i_sync.i_back.stage_q [1], \i_sync.i_back.stage_q [0], \i_sync.there_q ,
    \i_sync.i_there.stage_q [1], \i_sync.i_there.stage_q [0], \i_sync.level_q
  };
  wire [4:0] changes = levels[5:1] ^ levels[4:0];
  always @* begin
    if (rst_ni) begin
      one_for_one: assert(late <= 1 && (busy || late == 0));
      inside_way: assert((changes & (changes - 5'd1)) == 0);
      inside_late: assert((late == 1) == (\i_sync.level_q != \i_sync.there_q ));
      cover_again: cover(accepted_q == 2 && received_q == 2 && !busy);
      cover_refused: cover(pulse_i && busy && late == 0);
    end
  end

endmodule
