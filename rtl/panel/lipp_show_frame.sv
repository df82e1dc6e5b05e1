// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Sends the stored frame to the video output: reads the front buffer once per frame.
///
/// Input begin_i is a pulse at the start of a video frame. From the clock after begin_i on, front_i
/// is the buffer of the frame, and shown_i is high if the frame is on the panel. Input swapped_i is
/// high in the clock after begin_i if the buffer changed. Input crc_i is the CRC-32 of the new
/// buffer, and is valid from the clock after swapped_i. In the clock after swapped_i, the frame
/// store receives the request for the pixels. `lipp_pixel_feed` outputs each pixel at its own
/// position in the video frame. A late pixel is dropped, and underflow_o pulses.
///
/// After a frame was shown without underflow, its CRC-32 is compared with crc_i. If the two CRCs
/// differ, the memory has lost the frame: lost_o is high and the panel black until the next swap.
module lipp_show_frame #(
  parameter int Width = 640,
  parameter int Height = 480,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,

  input  logic                 begin_i,
  input  logic                 front_i,
  input  logic                 shown_i,
  input  logic                 swapped_i,
  input  logic [31:0]          crc_i,

  output logic                 valid_o,         // request of the frame store's client show
  input  logic                 ready_i,
  output logic                 buffer_o,
  output logic [PlaceBits-1:0] first_o,
  output logic [PlaceBits:0]   count_o,
  input  logic                 pixel_valid_i,
  output logic                 pixel_ready_o,
  input  logic [23:0]          pixel_rgb_i,

  input  logic                 want_i,
  output logic [23:0]          rgb_o,
  output logic                 underflow_o,
  output logic                 lost_o
);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_show_frame: Width and Height must be 1 to 16383");
  end

  logic begin_q, shows, begins, complete, hit, last;
  assign shows = shown_i && (!lost_o || swapped_i);
  assign begins = begin_q && shows && complete;
  assign first_o = '0;
  assign count_o = (PlaceBits + 1)'(Width * Height);
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {begin_q, valid_o} <= '0;
    else {begin_q, valid_o} <= {begin_i, begins || (valid_o && !ready_i)};
  end
  always_ff @(posedge clk_i) if (begins) buffer_o <= front_i;

  lipp_pixel_feed #(.Pixels(Width * Height)) i_feed (
    .clk_i, .rst_ni, .begin_i(begin_q), .draws_i(begins), .shown_i(shows), .complete_o(complete),
    .last_o(last), .pixel_valid_i, .pixel_ready_o, .pixel_rgb_i, .want_i,
    .hit_o(hit), .rgb_o, .underflow_o
  );

  // ---- check the CRC of the shown frame ----
  logic hit_q, in_time_q, last_q;  // in_time_q: no pixel of the frame was late so far
  logic [23:0] rgb_q;
  logic [31:0] crc_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {hit_q, in_time_q, last_q, lost_o} <= '0;
    end else begin
      hit_q <= hit;
      last_q <= last && !begins;  // a last pixel that comes at begin_i is late
      in_time_q <= begins || (in_time_q && !underflow_o);
      if (begin_q && swapped_i) lost_o <= 1'b0;
      else if (last_q && in_time_q) lost_o <= ~crc_q != crc_i;
    end
  end
  always_ff @(posedge clk_i) begin
    rgb_q <= rgb_o;
    if (begins) crc_q <= lipp_link_pkg::CrcStart;
    else if (hit_q) crc_q <= lipp_link_pkg::crc32_pixel(crc_q, rgb_q);
  end

endmodule

`default_nettype wire
