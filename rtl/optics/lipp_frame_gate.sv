// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Lets new optics and another source of rays take effect between two frames only.
///
/// apply_i requests a change. take_o is its clock: at once between two frames, otherwise after the
/// frame's last ray was accepted. No ray is accepted in that clock, and stream_o, the source, is
/// stream_i from the next clock on. start_i requests a frame of the raster; one request is kept
/// while the raster runs. Requests for the same thing that come before it is done are one. abort_i
/// ends the frame of the rays that were accepted, and drops a frame that waits; the raster outside
/// stops with the same pulse.
///
/// The raster's first ray comes 3 or more clocks after begin_o. So a frame uses every change that
/// was requested before its start, or together with it.
module lipp_frame_gate (
  input  logic clk_i,
  input  logic rst_ni,

  input  logic apply_i,           // pulse
  output logic apply_waits_o,     // until take_o
  input  logic stream_i,          // source of the next change; 0: raster, 1: stream
  output logic take_o,            // pulse: optics and source take effect
  output logic stream_o,          // source in effect

  input  logic start_i,           // pulse
  output logic start_waits_o,     // until begin_o
  output logic begin_o,           // pulse: the raster begins a frame
  input  logic abort_i,           // pulse
  input  logic raster_running_i,  // until the frame's last ray was accepted

  input  logic raster_valid_i,
  output logic raster_ready_o,
  input  logic raster_last_i,     // of its frame
  input  logic stream_valid_i,
  output logic stream_ready_o,
  input  logic stream_last_i,

  output logic valid_o,           // a ray of the source in effect
  input  logic ready_i
);

  logic within_d, within_q;  // a frame's first ray was accepted, and not yet its last
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
      // Decided a clock ahead, since the input must be closed in the clock of the change.
      take_o <= apply_waits_o && !within_d && !take_o;
      apply_waits_o <= apply_i || (apply_waits_o && !take_o);
      start_waits_o <= start_i || (start_waits_o && !begin_o && !abort_i);
      if (take_o) stream_o <= stream_i;
    end
  end

endmodule

`default_nettype wire
