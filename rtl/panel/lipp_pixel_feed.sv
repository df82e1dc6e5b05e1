// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Passes a stream of pixels to the video output: outputs each pixel at its own position in the
/// video frame, or drops a pixel that arrives too late.
///
/// Input begin_i is a pulse at the start of a video frame. If draws_i is high with begin_i, the
/// stream must then deliver the pixels of the frame in order. Input draws_i may be high only while
/// complete_o is high. If draws_i is low at begin_i, the frame takes no pixels from the stream.
/// Input want_i takes the next pixel of the frame: in the clock of want_i, rgb_o is that pixel and
/// hit_o is high. If the pixel has not arrived yet, rgb_o is black, hit_o is low, and the pixel is
/// dropped when it arrives. Pixels that are still missing at the next begin_i are dropped too.
///
/// Output underflow_o pulses one clock after a pixel was missing on the panel. Input shown_i is
/// high while the frame is on the panel; with shown_i low, missing pixels are not reported. Output
/// complete_o is high if all pixels of the frame have arrived or were not requested. Output last_o
/// is a pulse one clock after the last pixel of the frame arrived.
module lipp_pixel_feed #(
  parameter int Pixels = 640 * 480  // number of pixels of a frame
) (
  input  logic        clk_i,
  input  logic        rst_ni,

  input  logic        begin_i,
  input  logic        draws_i,
  input  logic        shown_i,
  output logic        complete_o,
  output logic        last_o,

  input  logic        pixel_valid_i,
  output logic        pixel_ready_o,
  input  logic [23:0] pixel_rgb_i,

  input  logic        want_i,
  output logic        hit_o,
  output logic [23:0] rgb_o,
  output logic        underflow_o
);

  if (Pixels < 1) begin : gen_illegal
    $fatal(1, "lipp_pixel_feed: Pixels must be 1 or more");
  end

  localparam int CountBits = $clog2(Pixels + 1);
  // The current frame takes pixels: draws_i was high and no pixel was missing when it began.
  logic draws_q;
  logic [CountBits-1:0] pending_q;  // pixels of the frame that have not arrived yet
  logic [CountBits-1:0] late_q;     // missing pixels whose position the video has already passed
  logic drop, come, miss, ends;
  assign drop = !draws_q || late_q != '0;
  assign hit_o = want_i && pixel_valid_i && !drop;
  assign miss = want_i && shown_i && !hit_o;
  assign pixel_ready_o = drop || want_i;
  assign come = pixel_valid_i && pixel_ready_o;
  assign ends = come && pending_q == CountBits'(1);
  assign rgb_o = hit_o ? pixel_rgb_i : '0;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {draws_q, underflow_o, last_o} <= '0;
      {pending_q, late_q, complete_o} <= {{(2 * CountBits){1'b0}}, 1'b1};
    end else begin
      complete_o <= !(begin_i && draws_i) && (complete_o || ends);
      underflow_o <= miss;
      last_o <= ends;
      if (begin_i) begin
        draws_q <= draws_i;
        late_q <= '0;
      end else if (draws_q) begin
        late_q <= late_q + CountBits'(miss) - CountBits'(come && late_q != '0);
      end
      pending_q <= begin_i && draws_i ? CountBits'(Pixels) : pending_q - CountBits'(come);
    end
  end

endmodule

`default_nettype wire
