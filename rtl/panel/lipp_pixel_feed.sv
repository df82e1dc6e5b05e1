// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Pixels of a stream to the video: each is shown at its own place in the frame, or not at all.
///
/// begin_i is the start of a frame of the video. With draws_i, which needs complete_o, the stream
/// brings the frame's pixels from then on, in order. want_i takes the frame's next pixel; rgb_o is
/// that pixel in the same clock, and hit_o high. If it has not come, rgb_o is black, and the pixel
/// is dropped when it comes. Pixels that are missing at begin_i are dropped too, and a frame
/// without draws_i takes none.
///
/// underflow_o is high a clock after a pixel that was late, while shown_i says that the frame is on
/// the panel. complete_o: no pixel is missing. last_o is a pulse a clock after the frame's last
/// pixel came.
module lipp_pixel_feed #(
  parameter int Pixels = 640 * 480
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
  // the frame of the video has pixels: none was missing as it began
  logic draws_q;
  logic [CountBits-1:0] pending_q;  // pixels that have not come
  logic [CountBits-1:0] late_q;  // of these, the ones that the video has passed
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
