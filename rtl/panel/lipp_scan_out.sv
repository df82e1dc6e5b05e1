// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Video output: continuously outputs frames of the frame store or a test pattern.
///
/// A pixel lasts ClocksPerPixel clocks, and pixel_o marks the first of these clocks. A line
/// consists of horizontal sync, back porch, pixels and front porch. A frame consists of vertical
/// sync, back porch, visible lines and front porch. Vertical sync begins and ends together with
/// horizontal sync. A sync signal with positive polarity is high during sync, a sync signal with
/// negative polarity is low. Output rgb_o is black outside the pixels.
///
/// Frames and settings change only at the start of vertical sync, so every frame is shown complete.
/// If swap_i is high at the start of vertical sync, the buffers are swapped: swapped_o pulses and
/// front_o changes. Inputs brightness_i, pattern_i and optics_i are also sampled at the start of
/// vertical sync. Reset starts a frame of buffer 0. Output filled_o is low until the first swap:
/// until then no buffer contains a frame.
///
/// Output frame_end_o is a pulse at the start of vertical sync, one clock before swapped_o. At
/// frame_end_o, no pixel of the previous frame is in the pipeline. After frame_end_o, want_o pulses
/// for each pixel of the frame, even while a test pattern is shown. In the clock of each pulse of
/// want_o, pixel_i must be that pixel. The first pulse of want_o comes VSync + VBack lines and
/// HSync + HBack pixels after frame_end_o.
///
/// Each of the values r, g, b is output as floor(p (brightness + 1) / 256), where p is the pixel's
/// value. Pixel and sync outputs are aligned, each delayed by pattern_latency(Grid) + 3 clocks from
/// the counters. Output frame_start_o is high with the first pixel of a frame. Two clocks after the
/// last pixel of a frame, shown_crc_o is the CRC-32 of the frame's output bytes (rows top to
/// bottom, R, G, B), and frames_o has been incremented.
module lipp_scan_out #(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int HFront = 16,
  parameter int HSync = 96,
  parameter int HBack = 48,
  parameter int VFront = 10,
  parameter int VSync = 2,
  parameter int VBack = 33,
  parameter bit HPositive = 1'b1,                // 1: the horizontal sync is active high
  parameter bit VPositive = 1'b1,                // 1: the vertical sync is active high
  parameter int F = 23,  // number of fraction bits of the test pattern's optics
  parameter int Grid = lipp_optics_pkg::GridSquare,
  parameter int ClocksPerPixel = 1,              // clocks per pixel, a power of two
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                       clk_i,
  input  logic                       rst_ni,

  input  logic                            swap_i,  // 1: swap the buffers; high until swapped_o
  output logic                            swapped_o,
  output logic                            front_o,
  output logic                            filled_o,
  input  logic [7:0]                      brightness_i,
  input  lipp_panel_pkg::pattern_t        pattern_i,
  input  lipp_optics_pkg::optics_config_t optics_i,

  output logic                       frame_end_o,
  output logic                       want_o,
  input  logic [23:0]                pixel_i,

  output logic                       pixel_o,
  output logic                       de_o,
  output logic                       hsync_o,
  output logic                       vsync_o,
  output logic [23:0]                rgb_o,
  output logic                       frame_start_o,
  output logic [31:0]                shown_crc_o,
  output logic [31:0]                frames_o
);
  import lipp_panel_pkg::*;

  localparam int FirstX = HSync + HBack;
  localparam int FirstY = VSync + VBack;
  localparam int LineClocks = FirstX + Width + HFront;
  localparam int Lines = FirstY + Height + VFront;
  localparam int XBits = $clog2(LineClocks + 1);
  localparam int YBits = $clog2(Lines + 1);
  localparam int PanelBits = lipp_optics_pkg::PanelBits;
  localparam int Pattern = pattern_latency(Grid);
  localparam int Latency = Pattern + 3;  // latency from the counters to the output

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_scan_out: Width and Height must be 1 to 16383");
  end
  if (HFront < 0 || HSync < 1 || HBack < 0
      || VFront < 1 || VSync < 1 || VBack < 0) begin : gen_illegal_timing
    $fatal(1, "lipp_scan_out: porches must be 0 or more, and syncs and VFront 1 or more");
  end
  if (LineClocks * ClocksPerPixel < Pattern + 2) begin : gen_illegal_line
    $fatal(1, "lipp_scan_out: a line must be %0d clocks or more", Pattern + 2);
  end
  if (ClocksPerPixel < 1 || (ClocksPerPixel & (ClocksPerPixel - 1)) != 0) begin : gen_illegal_clocks
    $fatal(1, "lipp_scan_out: ClocksPerPixel must be a power of two");
  end

  // ---- divide the clock into pixels: begin_q[k] is high k clocks after a pixel's first clock,
  // and begin_q[k-1] is high k clocks after a pixel's last clock ----
  logic [Latency:0] begin_q;
  logic pixel_end;
  if (ClocksPerPixel == 1) begin : gen_clock
    assign begin_q = '1;
    assign pixel_end = 1'b1;
  end else begin : gen_clocks
    localparam int PhaseBits = $clog2(ClocksPerPixel);
    logic [PhaseBits-1:0] phase_q;
    logic [Latency:1] late_q;
    assign pixel_end = phase_q == '1;
    assign begin_q = {late_q, phase_q == '0};
    always_ff @(posedge clk_i or negedge rst_ni) begin
      if (!rst_ni) {phase_q, late_q} <= '0;
      else {phase_q, late_q} <= {PhaseBits'(phase_q + 1'b1), late_q[Latency-1:1], phase_q == '0};
    end
  end
  assign pixel_o = begin_q[Latency];

  // ---- count the position from the start of both syncs ----
  logic [XBits-1:0] x_q;
  logic [YBits-1:0] y_q;
  logic active;
  assign active = x_q >= XBits'(FirstX) && x_q < XBits'(FirstX + Width)
      && y_q >= YBits'(FirstY) && y_q < YBits'(FirstY + Height);
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      x_q <= '0;
      y_q <= '0;
    end else if (!pixel_end) begin
      x_q <= x_q;
    end else if (x_q != XBits'(LineClocks - 1)) begin
      x_q <= x_q + 1'b1;
    end else begin
      x_q <= '0;
      y_q <= y_q == YBits'(Lines - 1) ? '0 : y_q + 1'b1;
    end
  end

  // ---- decode the position, and delay the sync signals to the output ----
  logic [Latency:1] active_q, hsync_q, vsync_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {active_q, hsync_q, vsync_q} <= '0;
    end else begin
      active_q <= {active_q[Latency-1:1], active};
      hsync_q <= {hsync_q[Latency-1:1], x_q < XBits'(HSync)};
      vsync_q <= {vsync_q[Latency-1:1], y_q < YBits'(VSync)};
    end
  end
  assign de_o = active_q[Latency];
  assign hsync_o = hsync_q[Latency] == HPositive;
  assign vsync_o = vsync_q[Latency] == VPositive;

  // ---- swap buffers, and sample settings, between two frames ----
  logic frame_end;
  logic [7:0] brightness_q;
  pattern_t pattern_q;
  lipp_optics_pkg::optics_config_t optics_q;
  assign frame_end = vsync_q[Pattern] && !vsync_q[Pattern+1];
  assign frame_end_o = frame_end;
  assign want_o = active_q[Pattern] && begin_q[Pattern];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {front_o, swapped_o, filled_o} <= '0;
      brightness_q <= '1;
      pattern_q <= '0;
    end else begin
      swapped_o <= frame_end && swap_i;
      if (frame_end) begin
        front_o <= front_o ^ swap_i;
        filled_o <= filled_o || swap_i;
        brightness_q <= brightness_i;
        pattern_q <= pattern_i;
      end
    end
  end

  always_ff @(posedge clk_i) if (frame_end) optics_q <= optics_i;

  // ---- select the pixel of the frame or of the test pattern ----
  logic [PlaceBits-1:0] at_q;  // index of the pixel in the frame
  logic [23:0] pattern_rgb, rgb_q;
  lipp_test_pattern #(.Width(Width), .Height(Height), .F(F), .Grid(Grid)) i_pattern (
    .clk_i, .pattern_i(pattern_q), .optics_i(optics_q),
    .column_i(PanelBits'(x_q - XBits'(FirstX))), .row_i(PanelBits'(y_q - YBits'(FirstY))),
    .rgb_o(pattern_rgb)
  );
  always_ff @(posedge clk_i) begin
    if (frame_end) at_q <= '0;
    else if (active_q[Pattern] && begin_q[Pattern-1]) at_q <= at_q + 1'b1;
    if (pattern_q.kind != PatternOff) rgb_q <= pattern_rgb;
    else if (begin_q[Pattern]) rgb_q <= pixel_i;
  end

  // p (brightness + 1) is computed in two steps: first the products with the upper and the lower
  // half of the brightness, then their sum.
  logic [2:0][11:0] high_q;
  logic [2:0][12:0] low_q;
  always_ff @(posedge clk_i) begin
    for (int k = 0; k < 3; k++) begin
      high_q[k] <= 12'(rgb_q[8*k+:8]) * 12'(brightness_q[7:4]);
      low_q[k] <= 13'(rgb_q[8*k+:8]) * 13'(brightness_q[3:0]) + 13'(rgb_q[8*k+:8]);
      rgb_o[8*k+:8] <= '0;
      if (active_q[Latency-1]) rgb_o[8*k+:8] <= 8'((high_q[k] + 12'(low_q[k][12:4])) >> 4);
    end
  end

  // ---- compute the frame's CRC, and count the frames ----
  localparam int Shown = Latency - Pattern;  // latency from the pixel's index to the output
  logic [Shown:1] first_q, last_q;
  logic ended_q;
  logic [31:0] crc_q;
  assign frame_start_o = first_q[Shown];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {first_q, last_q, ended_q} <= '0;
      frames_o <= '0;
      shown_crc_o <= '0;
    end else begin
      first_q <= {first_q[Shown-1:1], active_q[Pattern] && begin_q[Pattern] && at_q == '0};
      last_q <= {
        last_q[Shown-1:1],
        active_q[Pattern] && begin_q[Pattern] && at_q == PlaceBits'(Width * Height - 1)
      };
      ended_q <= last_q[Shown];
      if (ended_q) begin
        frames_o <= frames_o + 1'b1;
        shown_crc_o <= ~crc_q;
      end
    end
  end
  always_ff @(posedge clk_i) begin
    if (de_o && pixel_o) begin
      crc_q <= lipp_link_pkg::crc32_pixel(frame_start_o ? lipp_link_pkg::CrcStart : crc_q, rgb_o);
    end
  end

endmodule

`default_nettype wire
