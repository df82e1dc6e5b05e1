// SPDX-License-Identifier: Apache-2.0
/// Proves that `lipp_draw_frame` shows each pixel, or a counted black pixel, at its position, with
/// any timing of video and software, and with any optics and scene that keep the order of the rays.
///
/// The model of optics and scene outputs a pixel for every 2^SamplesBits rays, at any time. The
/// n-th pixel of a frame has the value n, so that a pixel at a wrong position is detected. The
/// video takes any number of pixels between two starts of a frame. The proof has four parts. First,
/// the rays of a frame are the rays of all its pixels in order, each once. Second, the video
/// receives at each position the pixel of that position, or a black pixel that is counted as
/// underflow. Third, each requested pixel arrives, and is taken once or dropped once. Fourth, new
/// registers take effect only at the start of a frame, when no register is being written and no ray
/// of another frame is in the pipeline.
module draw_frame_properties #(
  parameter int Width = 3,
  parameter int Height = 2,
  parameter int SamplesBits = 0
) (
  input logic clk_i,
  input logic rst_ni,
  input logic begin_i,
  input logic source_i,
  input logic hold_i,
  input logic ray_ready_i,
  input logic pixel_valid_i,
  input logic want_i
);

  localparam int Pixels = Width * Height;
  localparam int Rays = Pixels << SamplesBits;

  logic started_q = 1'b0;
  always_ff @(posedge clk_i) started_q <= 1'b1;
  always_comb if (!started_q) assume (!rst_ni);

  logic take, shown, owns, ray_valid, ray_first, ray_last, pixel_ready, underflow, drawn;
  logic signed [17:0] ray_u, ray_v;
  logic [23:0] rgb;
  logic [7:0] come_q;  // number of pixels of the frame that have arrived
  lipp_draw_frame #(.Width(Width), .Height(Height), .SamplesBits(SamplesBits)) i_dut (
    .clk_i, .rst_ni, .begin_i, .source_i, .hold_i, .take_o(take), .shown_o(shown), .owns_o(owns),
    .ray_valid_o(ray_valid), .ray_ready_i, .ray_u_o(ray_u), .ray_v_o(ray_v),
    .ray_first_o(ray_first), .ray_last_o(ray_last), .pixel_valid_i, .pixel_ready_o(pixel_ready),
    .pixel_rgb_i({16'habcd, come_q}), .want_i, .rgb_o(rgb), .underflow_o(underflow), .drawn_o(drawn)
  );

  // ---- track the frame being drawn, and the frame of the video ----
  logic [7:0] ray_count_q;    // number of rays of the frame sent to the optics
  logic [7:0] passed_q;       // number of pixels that the video has taken in its frame
  logic missed_q, last_q, source_q;
  logic [1:0] sets_q, drawn_sets_q;  // register sets taken: in total, and when drawing began
  wire begins = i_dut.begins;
  wire sends = ray_valid && ray_ready_i;
  wire comes = pixel_valid_i && pixel_ready;
  wire hit = i_dut.i_feed.hit_o;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {ray_count_q, come_q, passed_q} <= {8'(Rays), 8'(Pixels), 8'd0};
      {missed_q, last_q, source_q, sets_q, drawn_sets_q} <= '0;
    end else begin
      source_q <= source_i;
      ray_count_q <= begins ? 8'd0 : ray_count_q + 8'(sends);
      come_q <= begins ? 8'd0 : come_q + 8'(comes);
      passed_q <= begin_i ? 8'd0 : passed_q + 8'(want_i);
      missed_q <= want_i && shown && !hit;
      last_q <= comes && come_q == 8'(Pixels - 1);
      sets_q <= sets_q + 2'(take);
      if (begins) drawn_sets_q <= sets_q + 2'(take);
    end
  end
  always_comb begin
    // only pixels whose rays were sent to the optics may arrive
    assume (!pixel_valid_i || come_q < 8'(ray_count_q >> SamplesBits));
    assume (!want_i || passed_q < 8'(Pixels));
    assume (!want_i || !begin_i);
  end

  // ---- properties to prove ----
  wire [7:0] pixel = 8'(ray_count_q >> SamplesBits);  // index of the pixel of the offered ray
  wire [1:0] sample = 2'(ray_count_q) & 2'((1 << SamplesBits) - 1);
  wire signed [17:0] column = 18'(pixel % 8'(Width)), row = 18'(pixel / 8'(Width));
  wire signed [17:0] quarter_u = SamplesBits == 0 ? 18'sd0 : sample[0] ? 18'sd4 : -18'sd4;
  wire signed [17:0] quarter_v = SamplesBits == 0 ? 18'sd0
      : (SamplesBits == 1 ? sample[0] : sample[1]) ? -18'sd4 : 18'sd4;
  always_ff @(posedge clk_i) begin
    if (rst_ni) begin
      rays_in_place: assert (!ray_valid || (ray_u == 8 * (2 * column + 1 - Width) + quarter_u
          && ray_v == 8 * (Height - 2 * row - 1) + quarter_v));
      rays_marked: assert (!ray_valid || (ray_first == (ray_count_q == '0) && ray_last
          == (ray_count_q == 8'(Rays - 1))));
      rays_once: assert (!ray_valid || ray_count_q < 8'(Rays));
      pixel_in_place: assert (!hit || (comes && come_q == passed_q && rgb == {16'habcd, passed_q}));
      pixel_or_black: assert (hit || rgb == '0);
      in_time_or_counted: assert (underflow == missed_q);
      ended: assert (drawn == last_q);
      whole: assert (!begins || (ray_count_q == 8'(Rays) && come_q == 8'(Pixels)));
      taken_between: assert (!take || (begin_i && !hold_i && ray_count_q == 8'(Rays) && come_q
          == 8'(Pixels)));
      taken_soon: assert (!begin_i || hold_i || come_q != 8'(Pixels) || take);
      one_set: assert (come_q == 8'(Pixels) || sets_q == drawn_sets_q);
      drawn_when_shown: assert (!begins || (hold_i ? shown : source_i));
      owned: assert (owns || (!shown && !source_q && come_q == 8'(Pixels) && !ray_valid));
    end
  end

  // ---- invariants that make the proof inductive ----
  wire [7:0] pending = 8'(i_dut.i_feed.pending_q), late = 8'(i_dut.i_feed.late_q);
  wire [7:0] placed = 8'((i_dut.row_q * Width + i_dut.column_q) << SamplesBits)
      + 8'(i_dut.sample_q);
  always_ff @(posedge clk_i) begin
    if (rst_ni) begin
      in_owed: assert (pending == 8'(Pixels) - come_q && come_q <= 8'(Pixels));
      in_complete: assert (i_dut.complete == (pending == '0));
      in_sent: assert (ray_count_q <= 8'(Rays) && come_q <= 8'(ray_count_q >> SamplesBits));
      in_passed: assert (passed_q <= 8'(Pixels));
      in_late: assert (!i_dut.i_feed.draws_q || come_q + late == passed_q);
      in_late_none: assert (i_dut.i_feed.draws_q || late == '0);
      in_place: assert (i_dut.column_q < 14'(Width) && i_dut.row_q < 14'(Height)
          && i_dut.sample_q <= 2'((1 << SamplesBits) - 1));
      in_first: assert (i_dut.walk_q || placed == '0);
      in_walk: assert (!i_dut.walk_q || placed == ray_count_q + 8'(ray_valid));
      in_walked: assert (i_dut.walk_q || ray_count_q + 8'(ray_valid) == 8'(Rays));
      in_shown: assert (!i_dut.i_feed.draws_q || shown);
      in_missing: assert (come_q == 8'(Pixels) || shown);
      in_sets: assert (!i_dut.i_feed.draws_q || come_q == 8'(Pixels) || sets_q == drawn_sets_q);
    end
  end

  // ---- cover statements: events that the proof must reach ----
  // dropped_q: a late pixel was dropped in this frame; black_q: a frame was black
  logic dropped_q, black_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {dropped_q, black_q} <= '0;
    end else begin
      dropped_q <= !begin_i && (dropped_q || (comes && late != '0));
      black_q <= black_q || (begin_i && shown && !begins);
    end
  end
  always_ff @(posedge clk_i) begin
    if (rst_ni) begin
      cover_whole: cover (drawn && passed_q == 8'(Pixels) && late == '0);
      cover_late: cover (dropped_q && hit);
      cover_after_black: cover (black_q && hit);
      cover_held: cover (begin_i && hold_i && begins);
    end
  end

endmodule
