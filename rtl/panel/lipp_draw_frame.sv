// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Has the panel drawn: sends its pixels' rays to the optics, gives the drawn pixels to the video.
///
/// begin_i is the start of a frame of the video, in its vertical sync. If no pixel of the frame
/// before is missing, the scene takes its registers then (take_o), unless a write to them is being
/// executed (hold_i): that frame is drawn from the registers of the one before. shown_o, whether
/// the panel shows the scene, is source_i as taken with the registers. A frame of Width * Height
/// pixels begins with begin_i if shown_o is high in the next clock. So a set of registers draws
/// whole frames only.
///
/// Rays of pixel (c, r), counted from the panel's top left, as lipp_raster's:
///   u = 8 (2 c + 1 - Width) + du,  v = 8 (Height - 2 r - 1) + dv, in this order of (du, dv):
///   SamplesBits 0: (0, 0)
///               1: (-4, 4), (4, -4)
///               2: (-4, 4), (4, 4), (-4, -4), (4, -4)
/// first and last mark the frame's.
///
/// Drawn pixels come in the rays' order. want_i takes the frame's next pixel for the video; rgb_o
/// is that pixel, or black if it has not come: underflow_o is high in the next clock then, and the
/// pixel is dropped when it comes. So each pixel is shown at its own place or not at all. If pixels
/// are still missing at begin_i, they are dropped, and the frame that would begin is black: all its
/// pixels are underflows. owns_o: the optics belong to the drawing, since in the clock before the
/// scene was to be shown, or was shown, or pixels were missing.
module lipp_draw_frame #(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int SamplesBits = 0  // rays for each pixel, as a power of two: 0 to 2
) (
  input  logic                                         clk_i,
  input  logic                                         rst_ni,

  input  logic                                         begin_i,
  input  logic                                         source_i,  // the scene is to be shown
  input  logic                                         hold_i,
  output logic                                         take_o,
  output logic                                         shown_o,
  output logic                                         owns_o,

  output logic                                         ray_valid_o,
  input  logic                                         ray_ready_i,
  output logic signed [lipp_optics_pkg::PixelBits-1:0] ray_u_o,
  output logic signed [lipp_optics_pkg::PixelBits-1:0] ray_v_o,
  output logic                                         ray_first_o,
  output logic                                         ray_last_o,

  input  logic                                         pixel_valid_i,
  output logic                                         pixel_ready_o,
  input  logic [23:0]                                  pixel_rgb_i,

  input  logic                                         want_i,
  output logic [23:0]                                  rgb_o,
  output logic                                         underflow_o,
  output logic                                         drawn_o  // pulse: the frame's last pixel has come
);
  import lipp_optics_pkg::PanelBits, lipp_optics_pkg::PixelBits;

  localparam int Pixels = Width * Height;
  localparam int CountBits = $clog2(Pixels + 1);

  if (Width < 1 || Width >= 1 << PanelBits || Height < 1 || Height >= 1 << PanelBits) begin : gen_illegal_panel
    $fatal(1, "lipp_draw_frame: Width and Height must be 1 to %0d", (1 << PanelBits) - 1);
  end
  if (SamplesBits < 0 || SamplesBits > 2) begin : gen_illegal_samples
    $fatal(1, "lipp_draw_frame: SamplesBits must be 0 to 2");
  end

  // ---- frames ----
  logic shown_q, begins, owed_none_q;
  logic [CountBits-1:0] owed_q;  // pixels of the frame that have not come
  assign take_o = begin_i && owed_none_q && !hold_i;
  assign begins = begin_i && owed_none_q && (hold_i ? shown_q : source_i);
  assign shown_o = shown_q;

  // ---- the rays ----
  localparam logic [PanelBits-1:0] LastColumn = PanelBits'(Width - 1);
  localparam logic [PanelBits-1:0] LastRow = PanelBits'(Height - 1);
  localparam logic [1:0] LastSample = 2'((1 << SamplesBits) - 1);
  logic [PanelBits-1:0] column_q, row_q;
  logic [1:0] sample_q;
  logic step, walk_q, end_of_pixel, end_of_row, end_of_frame;
  assign step = !ray_valid_o || ray_ready_i;
  assign end_of_pixel = sample_q == LastSample;
  assign end_of_row = end_of_pixel && column_q == LastColumn;
  assign end_of_frame = end_of_row && row_q == LastRow;
  // Quarters of a pixel, to the right and up.
  logic right, up;
  assign right = sample_q[0];
  assign up = SamplesBits == 2 ? !sample_q[1] : !sample_q[0];
  localparam int HalfBits = PanelBits + 1;
  logic signed [HalfBits-1:0] half_u, half_v;
  assign half_u = {column_q, 1'b1} - HalfBits'(Width);
  assign half_v = HalfBits'(Height) - {row_q, 1'b1};
  always_ff @(posedge clk_i) begin
    if (begins) begin
      {column_q, row_q, sample_q} <= '0;
    end else if (step && walk_q) begin
      sample_q <= end_of_pixel ? '0 : sample_q + 1'b1;
      if (end_of_pixel) column_q <= end_of_row ? '0 : column_q + 1'b1;
      if (end_of_row) row_q <= row_q + 1'b1;
    end
    if (step) begin
      ray_u_o <= {half_u, 3'b0} + (SamplesBits == 0 ? '0 : right ? PixelBits'(4) : -PixelBits'(4));
      ray_v_o <= {half_v, 3'b0} + (SamplesBits == 0 ? '0 : up ? PixelBits'(4) : -PixelBits'(4));
      ray_first_o <= column_q == '0 && row_q == '0 && sample_q == '0;
      ray_last_o <= end_of_frame;
    end
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {walk_q, ray_valid_o} <= '0;
    end else begin
      walk_q <= begins || (walk_q && !(step && end_of_frame));
      if (step) ray_valid_o <= walk_q;
    end
  end

  // ---- the pixels ----
  logic draws_q;                 // the frame of the video is drawn: it began with no pixel missing
  logic [CountBits-1:0] late_q;  // pixels that the video has passed and that have not come
  logic drop, come, hit, miss;
  assign drop = !draws_q || late_q != '0;
  assign hit = want_i && pixel_valid_i && !drop;
  assign miss = want_i && shown_q && !hit;
  assign pixel_ready_o = drop || want_i;
  assign come = pixel_valid_i && pixel_ready_o;
  assign rgb_o = hit ? pixel_rgb_i : '0;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {shown_q, owns_o, draws_q, underflow_o, drawn_o} <= '0;
      {owed_q, late_q, owed_none_q} <= {{(2 * CountBits){1'b0}}, 1'b1};
    end else begin
      owns_o <= source_i || shown_q || !owed_none_q;
      owed_none_q <= !begins && (owed_none_q || (come && owed_q == CountBits'(1)));
      underflow_o <= miss;
      drawn_o <= come && owed_q == CountBits'(1);
      if (take_o) shown_q <= source_i;
      if (begin_i) begin
        draws_q <= begins;
        late_q <= '0;
      end else if (draws_q) begin
        late_q <= late_q + CountBits'(miss) - CountBits'(come && late_q != '0);
      end
      owed_q <= begins ? CountBits'(Pixels) : owed_q - CountBits'(come);
    end
  end

endmodule

`default_nettype wire
