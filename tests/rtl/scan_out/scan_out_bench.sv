/// scan_out with two buffers, which the test fills, and beside a scene: pixel n of a frame is n times a
/// constant and a key.
module scan_out_bench #(
  parameter int Width = 70,
  parameter int Height = 35,
  parameter int HFront = 3,
  parameter int HSync = 5,
  parameter int HBack = 4,
  parameter int VFront = 2,
  parameter int VSync = 3,
  parameter int VBack = 1,
  parameter bit HPositive = 1'b1,
  parameter bit VPositive = 1'b1,
  parameter int Grid = 0,
  parameter int ClocksPerPixel = 1,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,
  input  logic                 swap_i,
  input  logic [7:0]           brightness_i,
  input  logic [2:0]           kind_i,
  input  logic [7:0]           view_i,  // red of the pattern of views, everywhere on the panel
  input  logic                 scene_i,  // the scene is to be shown, from the next frame on
  input  logic [23:0]          key_i,
  output logic                 pixel_o,
  output logic                 de_o,
  output logic                 hsync_o,
  output logic                 vsync_o,
  output logic                 frame_start_o,
  output logic [31:0]          shown_crc_o,
  output logic [31:0]          frames_o,
  /// pixel, front, swapped, frame_start, vsync, hsync, de, rgb
  output logic [30:0]          out_o,
  output logic                 frame_end_o,
  output logic                 want_o,
  input  logic                 fill_i,
  input  logic                 fill_buffer_i,
  input  logic [PlaceBits-1:0] fill_at_i,
  input  logic [23:0]          fill_rgb_i
);

  logic front, filled, swapped;
  logic [23:0] rgb;
  lipp_panel_pkg::pattern_t pattern;
  // Every pixel lies on the same point of lenslet (0, 0): (view + 1/2) / 256 - 1/2 pitches.
  lipp_optics_pkg::optics_config_t optics;
  always_comb begin
    optics = '0;
    optics.x_offset = ($signed({44'd0, view_i}) - 52'sd128) <<< 32;
    optics.x_offset[31] = 1'b1;
  end
  assign pattern = '{kind: lipp_panel_pkg::pattern_e'(kind_i), i: '0, j: '0};
  assign out_o = {pixel_o, front, swapped, frame_start_o, vsync_o, hsync_o, de_o, rgb};

  lipp_scan_out #(
    .Width(Width), .Height(Height), .HFront(HFront), .HSync(HSync), .HBack(HBack),
    .VFront(VFront), .VSync(VSync), .VBack(VBack), .HPositive(HPositive), .VPositive(VPositive),
    .Grid(Grid), .ClocksPerPixel(ClocksPerPixel)
  ) i_scan_out (
    .clk_i, .rst_ni, .swap_i, .swapped_o(swapped), .front_o(front), .filled_o(filled), .brightness_i,
    .pattern_i(pattern), .optics_i(optics), .frame_end_o, .want_o, .pixel_i(pixel), .pixel_o, .de_o, .hsync_o, .vsync_o, .rgb_o(rgb), .frame_start_o, .shown_crc_o, .frames_o
  );
  // A pixel is there in the clock in which it is wanted, and in no other.
  logic scene_q;
  logic [PlaceBits-1:0] at_q;
  logic [23:0] pixel_q, key_q, pixel;
  logic [23:0] pixels[2 << PlaceBits];
  always_comb begin
    pixel = 24'hdead00;
    if (want_o) pixel = scene_q ? pixel_q ^ key_q : filled ? pixels[{front, at_q}] : '0;
  end
  always_ff @(posedge clk_i) if (fill_i) pixels[{fill_buffer_i, fill_at_i}] <= fill_rgb_i;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {scene_q, pixel_q, key_q, at_q} <= '0;
    end else if (frame_end_o) begin
      {scene_q, pixel_q, key_q, at_q} <= {scene_i, 24'd0, key_i, PlaceBits'(0)};
    end else if (want_o) begin
      {pixel_q, at_q} <= {pixel_q + 24'h9e3779, at_q + 1'b1};
    end
  end

endmodule
