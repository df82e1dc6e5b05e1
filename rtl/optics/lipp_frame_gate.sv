// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Applies new optics and a new source of rays only between two frames.
///
/// Input apply_i requests a change of optics and source. Output take_o is high in the clock of the
/// change. Between two frames the change is made at once, otherwise after the frame's last ray was
/// accepted. No ray is accepted in the clock of the change. Output stream_o, the source in effect,
/// equals stream_i from the next clock on. Input start_i requests a frame of the raster. While the
/// raster runs, one start is remembered. Repeated requests of the same kind count as one request
/// until that request is served. Input abort_i ends the current frame and cancels the remembered
/// start; the raster outside this module stops at the same pulse.
///
/// The raster offers the first ray of a frame 3 or more clocks after begin_o. Therefore a frame
/// uses every change that was requested before start_i or in the clock of start_i.
module lipp_frame_gate (
  input  logic clk_i,
  input  logic rst_ni,

  input  logic apply_i,           // pulse: requests a change
  output logic apply_waits_o,     // 1: a change is requested but not made
  input  logic stream_i,          // source after the next change; 0: raster, 1: stream
  output logic take_o,            // pulse: optics and source take effect
  output logic stream_o,          // source in effect; 0: raster, 1: stream

  input  logic start_i,           // pulse: requests a frame of the raster
  output logic start_waits_o,     // 1: a frame is requested but not begun
  output logic begin_o,           // pulse: the raster begins a frame
  input  logic abort_i,           // pulse: ends the current frame and cancels the start
  input  logic raster_running_i,  // 1: the raster's frame is not complete

  input  logic raster_valid_i,
  output logic raster_ready_o,
  input  logic raster_last_i,     // 1: last ray of its frame
  input  logic stream_valid_i,
  output logic stream_ready_o,
  input  logic stream_last_i,

  output logic valid_o,           // 1: the source in effect offers a ray
  input  logic ready_i
);

  logic within_d, within_q;  // 1: the first ray of a frame was accepted, its last was not
  logic accept, last;
  assign last = stream_o ? stream_last_i : raster_last_i;
  assign valid_o = (stream_o ? stream_valid_i : raster_valid_i) && !take_o;
  assign accept = valid_o && ready_i;
  assign raster_ready_o = !stream_o && ready_i && !take_o;
  assign stream_ready_o = stream_o && ready_i && !take_o;
  assign within_d = !abort_i && (accept ? !last : within_q);
  assign begin_o = start_waits_o && !raster_running_i;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {within_q, take_o, apply_waits_o, start_waits_o, stream_o} <= '0;
    end else begin
      within_q <= within_d;
      // take_o is computed a clock ahead, because the input must be closed when the change is made.
      take_o <= apply_waits_o && !within_d && !take_o;
      apply_waits_o <= apply_i || (apply_waits_o && !take_o);
      start_waits_o <= start_i || (start_waits_o && !begin_o && !abort_i);
      if (take_o) stream_o <= stream_i;
    end
  end

endmodule

`default_nettype wire
