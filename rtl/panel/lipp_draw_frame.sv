// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Draws the scene: sends the rays of all panel pixels to the optics, and outputs the pixels that
/// the scene returns.
///
/// Input begin_i is a pulse at the start of a video frame, during vertical sync. In the clock of
/// begin_i, the scene's new registers take effect (take_o) if all pixels of the previous frame have
/// arrived and hold_i is low. Input hold_i is high while software writes the registers, and keeps
/// the previous registers in use. Output shown_o, high while the panel shows the scene, is source_i
/// sampled together with the registers. A frame of Width * Height pixels is drawn if shown_o is
/// high in the clock after begin_i. Therefore every frame is drawn with one set of registers.
///
/// Let c and r be a pixel's column and row, counted from the panel's top left. As in lipp_raster,
/// the pixel's rays start at the panel position
///
///   u = 8 (2 c + 1 - Width) + du,  v = 8 (Height - 2 r - 1) + dv
///
/// Here u and v have 4 fraction bits. The offsets (du, dv) of a pixel's rays are, in this order:
///
///   With SamplesBits = 0 the offset is (0, 0).
///   With SamplesBits = 1 the offsets are (-4, 4), (4, -4).
///   With SamplesBits = 2 the offsets are (-4, 4), (4, 4), (-4, -4), (4, -4).
///
/// Output ray_first_o marks the first ray of the frame, ray_last_o the last. The drawn pixels must
/// arrive in the order of the rays. `lipp_pixel_feed` outputs each pixel at its own position in the
/// video frame, and counts and drops late pixels. If pixels of a frame are still missing at
/// begin_i, the next frame is black and all its pixels count as underflows. Output owns_o is high
/// while this module needs the optics: while pixels are missing, or, one clock late, while source_i
/// or shown_o is high.
module lipp_draw_frame #(
  parameter int Width = 640,   // the panel's width in pixels
  parameter int Height = 480,  // the panel's height in pixels
  parameter int SamplesBits = 0  // 2^SamplesBits rays per pixel, SamplesBits from 0 to 2
) (
  input  logic                                         clk_i,
  input  logic                                         rst_ni,

  input  logic                                         begin_i,
  input  logic                                         source_i,  // 1: show the scene
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
  // pulse: the last drawn pixel of the frame has arrived
  output logic                                         drawn_o
);
  import lipp_optics_pkg::PanelBits, lipp_optics_pkg::PixelBits;

  if (Width < 1 || Width >= 1 << PanelBits
      || Height < 1 || Height >= 1 << PanelBits) begin : gen_illegal_panel
    $fatal(1, "lipp_draw_frame: Width and Height must be 1 to %0d", (1 << PanelBits) - 1);
  end
  if (SamplesBits < 0 || SamplesBits > 2) begin : gen_illegal_samples
    $fatal(1, "lipp_draw_frame: SamplesBits must be 0 to 2");
  end

  // ---- begin frames, and take new registers ----
  logic scene_shown_q, begins, complete;
  assign take_o = begin_i && complete && !hold_i;
  assign begins = begin_i && complete && (hold_i ? scene_shown_q : source_i);
  assign shown_o = scene_shown_q;

  // ---- send the rays of the frame ----
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
  // Each ray is a quarter of a pixel to the right or left, and up or down, from its pixel's centre.
  logic right, up;
  assign right = sample_q[0];
  assign up = SamplesBits == 2 ? !sample_q[1] : !sample_q[0];
  localparam int HalfBits = PanelBits + 1;
  logic signed [HalfBits-1:0] half_u, half_v;
  assign half_u = {column_q, 1'b1} - HalfBits'(Width);
  assign half_v = HalfBits'(Height) - {row_q, 1'b1};
  always_ff @(posedge clk_i) begin
    if (step) begin
      ray_u_o <= {half_u, 3'b0} + (SamplesBits == 0 ? '0 : right ? PixelBits'(4) : -PixelBits'(4));
      ray_v_o <= {half_v, 3'b0} + (SamplesBits == 0 ? '0 : up ? PixelBits'(4) : -PixelBits'(4));
      ray_first_o <= column_q == '0 && row_q == '0 && sample_q == '0;
      ray_last_o <= end_of_frame;
    end
  end
  // After the last ray of a frame, the counters are at the first ray of the next frame.
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {column_q, row_q, sample_q, walk_q, ray_valid_o} <= '0;
    end else begin
      if (step && walk_q) begin
        sample_q <= end_of_pixel ? '0 : sample_q + 1'b1;
        if (end_of_pixel) column_q <= end_of_row ? '0 : column_q + 1'b1;
        if (end_of_row) row_q <= end_of_frame ? '0 : row_q + 1'b1;
      end
      walk_q <= begins || (walk_q && !(step && end_of_frame));
      if (step) ray_valid_o <= walk_q;
    end
  end

  // ---- output the drawn pixels ----
  logic unused_hit;
  lipp_pixel_feed #(.Pixels(Width * Height)) i_feed (
    .clk_i, .rst_ni, .begin_i, .draws_i(begins), .shown_i(scene_shown_q), .complete_o(complete),
    .last_o(drawn_o), .pixel_valid_i, .pixel_ready_o, .pixel_rgb_i, .want_i, .hit_o(unused_hit),
    .rgb_o, .underflow_o
  );
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {scene_shown_q, owns_o} <= '0;
    end else begin
      owns_o <= source_i || scene_shown_q || !complete;
      if (take_o) scene_shown_q <= source_i;
    end
  end

endmodule

`default_nettype wire
