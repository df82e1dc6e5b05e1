// SPDX-License-Identifier: Apache-2.0
/// Checks at the ports of `lipp_frame_gate` that changes take effect only between frames, and
/// checks the rules of the raster that feeds the frame gate.
module lipp_frame_gate_checks #(
  parameter bit AssumeRaster = 1'b0  // 1: assume, not assert, the raster's rules
) (
  input logic clk_i,
  input logic rst_ni,
  input logic apply_i,
  input logic apply_waits_o,
  input logic stream_i,
  input logic take_o,
  input logic stream_o,
  input logic start_i,
  input logic start_waits_o,
  input logic begin_o,
  input logic abort_i,
  input logic raster_running_i,
  input logic raster_valid_i,
  input logic raster_ready_o,
  input logic raster_last_i,
  input logic stream_valid_i,
  input logic stream_ready_o,
  input logic stream_last_i,
  input logic valid_o,
  input logic ready_i
);

`ifdef FORMAL
  wire checked = rst_ni;
`else
  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;
`endif

  wire from_raster = raster_valid_i && raster_ready_o;
  wire from_stream = stream_valid_i && stream_ready_o;
  wire accept = from_raster || from_stream;
  wire last = from_stream ? stream_last_i : raster_last_i;

  reg within_q;          // 1: the first ray of a frame was accepted, its last not yet
  reg applies_q;         // 1: a change was requested and has not taken effect
  reg starts_q;          // 1: a frame was requested and has not begun
  reg due_next_q;        // 1: a change must take effect before the requested frame
  reg change_due_q;      // 1: a change must take effect before the current frame's rays
  reg walks_q;           // 1: the frame of the raster has begun and not ended
  reg [1:0] begun_q;     // clocks since the clock after begin_o, counted up to 3
  reg past_valid_q;      // 1: the registers below hold values of the previous clock
  reg took_q, stream_q, restart_q, waited_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {within_q, applies_q, starts_q, due_next_q, change_due_q, walks_q} <= 0;
      begun_q <= 0;
      {past_valid_q, waited_q} <= 0;
    end else begin
      if (abort_i) within_q <= 0;
      else if (accept) within_q <= !last;
      applies_q <= apply_i || (applies_q && !take_o);
      starts_q <= start_i || (starts_q && !begin_o && !abort_i);
      if (start_i) due_next_q <= apply_i || (applies_q && !take_o);
      else if (take_o || begin_o || abort_i) due_next_q <= 0;
      if (begin_o) change_due_q <= due_next_q && !take_o;
      else if (take_o) change_due_q <= 0;
      if (begin_o) walks_q <= 1;
      else if (!raster_running_i || (from_raster && raster_last_i)) walks_q <= 0;
      if (begin_o) begun_q <= 0;
      else if (begun_q < 3) begun_q <= begun_q + 1;
      past_valid_q <= 1;
      // 1: no frame is open after this clock, so a pending change must be made in the next clock.
      waited_q <= applies_q && !take_o && (abort_i || (accept ? last : !within_q));
    end
  end
  always @(posedge clk_i) begin
    took_q <= take_o;
    stream_q <= stream_o;
    restart_q <= stream_i;
  end

  always @(posedge clk_i) begin
    if (checked) begin
      // In each clock, at most one ray is accepted, from the source in effect. Each accepted ray is
      // passed on, and no other ray is passed on.
      one_source: assert(!(from_raster && from_stream));
      passed_on: assert(accept == (valid_o && ready_i));
      source: assert((!from_raster || !stream_o) && (!from_stream || stream_o));
      // A requested change takes effect between two frames, while the input is closed.
      closed: assert(!take_o || !accept);
      between: assert(!take_o || !within_q);
      requested: assert(!take_o || applies_q);
      // The source changes together with the configuration, and at no other time.
      changes: assert(!past_valid_q || stream_o == (took_q ? restart_q : stream_q));
      // No request is lost: each one is pending until the first clock in which it can be executed.
      waits: assert(apply_waits_o == applies_q && start_waits_o == starts_q);
      answered: assert(!waited_q || take_o);
      begins: assert(begin_o == (starts_q && !raster_running_i));
      // A frame uses every change that was requested before the start of the frame.
      in_time: assert(!from_raster || !change_due_q);
    end
  end

  // ---- rules for the raster: a frame runs from begin_o to its last ray, or is refused ----
  wire raster_ok = (!raster_running_i || walks_q) && (raster_running_i || !within_q || stream_o)
      && (!raster_valid_i || (raster_running_i && begun_q >= 2));
  if (AssumeRaster) begin : gen_assume_raster
    always @(posedge clk_i) if (checked) assume(raster_ok);
  end else begin : gen_raster
    always @(posedge clk_i) if (checked) raster: assert(raster_ok);
  end

endmodule

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_frame_gate lipp_frame_gate_checks i_checks (.*);
`endif
