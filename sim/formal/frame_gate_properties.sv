// SPDX-License-Identifier: Apache-2.0
/// Proves the assertions of frame_gate_checks for `lipp_frame_gate`, with any software, any rays at
/// both inputs and any reader. The invariants below make the proof inductive.
module frame_gate_properties (
  input logic clk_i,
  input logic rst_ni,
  input logic apply_i,
  input logic stream_i,
  input logic start_i,
  input logic abort_i,
  input logic raster_running_i,
  input logic raster_valid_i,
  input logic raster_last_i,
  input logic stream_valid_i,
  input logic stream_last_i,
  input logic ready_i
);

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  always @* if (!started_q) assume(!rst_ni);

  logic apply_waits_o, take_o, stream_o, start_waits_o, begin_o, valid_o;
  logic raster_ready_o, stream_ready_o;
  lipp_frame_gate i_gate (
    .clk_i, .rst_ni, .apply_i, .apply_waits_o, .stream_i, .take_o, .stream_o, .start_i,
    .start_waits_o, .begin_o, .abort_i, .raster_running_i, .raster_valid_i, .raster_ready_o,
    .raster_last_i,
    .stream_valid_i, .stream_ready_o, .stream_last_i, .valid_o, .ready_i
  );
  lipp_frame_gate_checks #(.AssumeRaster(1'b1)) i_checks (
    .clk_i, .rst_ni, .apply_i, .apply_waits_o, .stream_i, .take_o, .stream_o, .start_i,
    .start_waits_o, .begin_o, .abort_i, .raster_running_i, .raster_valid_i, .raster_ready_o,
    .raster_last_i,
    .stream_valid_i, .stream_ready_o, .stream_last_i, .valid_o, .ready_i
  );

  // These wires carry internal registers of the design: yosys flattens the hierarchy and connects
  // each wire to the register of the same name.
  (* hierconn *) wire \i_gate.within_q ;
  (* hierconn *) wire \i_checks.within_q ;
  (* hierconn *) wire \i_checks.change_due_q ;
  (* hierconn *) wire \i_checks.due_next_q ;
  (* hierconn *) wire [1:0] \i_checks.begun_q ;
  (* hierconn *) wire \i_checks.walks_q ;
  always @(posedge clk_i) begin
    if (rst_ni) begin
      inside_within: assert(\i_gate.within_q == \i_checks.within_q );
      inside_due: assert((!\i_checks.change_due_q || apply_waits_o)
          && (!\i_checks.due_next_q || (apply_waits_o && start_waits_o)));
      // A pending change takes effect a clock after begin_o, unless a stream's frame is running.
      inside_time: assert(!\i_checks.change_due_q || stream_o
          || (\i_checks.begun_q == 0 && take_o));
    end
  end

  // ---- cover statements: events that the proof must reach ----
  reg waited_q;         // 1: a change waited for the last ray of a frame
  reg [1:0] changed_q;  // number of changes of the source
  reg stream_q;
  wire waits = apply_waits_o && \i_checks.within_q && start_waits_o;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      waited_q <= 0;
      changed_q <= 0;
      stream_q <= 0;
    end else begin
      waited_q <= waited_q || waits;
      changed_q <= changed_q + (stream_q != stream_o && changed_q != 3);
      stream_q <= stream_o;
    end
  end
  always @(posedge clk_i) begin
    if (rst_ni) begin
      cover_waited: cover(waited_q && take_o);
      cover_sources: cover(changed_q == 2 && valid_o && ready_i);
      cover_due_in_stream: cover(\i_checks.change_due_q && stream_o && \i_checks.begun_q == 3);
      cover_again: cover(take_o && apply_i);
    end
  end

endmodule
