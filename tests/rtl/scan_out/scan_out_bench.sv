/// scan_out at a port of a frame store, which the test fills, and beside a scene: pixel n of a frame is
/// n times a constant and a key.
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
  parameter int ReadLatency = 2,
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
  output logic                 scene_take_o,
  input  logic                 fill_i,
  input  logic                 fill_buffer_i,
  input  logic [PlaceBits-1:0] fill_at_i,
  input  logic [23:0]          fill_rgb_i
);

  logic front, swapped;
  logic [PlaceBits-1:0] read_at;
  logic [23:0] read_rgb, late_rgb, unused_rgb, rgb;
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
    .Grid(Grid), .ReadLatency(ReadLatency), .ClocksPerPixel(ClocksPerPixel)
  ) i_scan_out (
    .clk_i, .rst_ni, .swap_i, .swapped_o(swapped), .front_o(front), .brightness_i,
    .pattern_i(pattern), .optics_i(optics), .read_at_o(read_at), .read_rgb_i(late_rgb),
    .frame_end_o, .scene_i(scene_q), .scene_take_o, .scene_rgb_i(scene_rgb), .pixel_o,
    .de_o, .hsync_o, .vsync_o, .rgb_o(rgb), .frame_start_o, .shown_crc_o, .frames_o
  );
  // A pixel is there in the clock in which it is taken, and in no other.
  logic scene_q;
  logic [23:0] pixel_q, key_q, scene_rgb;
  assign scene_rgb = scene_take_o ? pixel_q ^ key_q : 24'hdead00;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {scene_q, pixel_q, key_q} <= '0;
    end else if (frame_end_o) begin
      {scene_q, pixel_q, key_q} <= {scene_i, 24'd0, key_i};
    end else if (scene_take_o) begin
      pixel_q <= pixel_q + 24'h9e3779;
    end
  end
  // Behind the store's two clocks, as many as make ReadLatency.
  lipp_delay #(.Width(24), .Cycles(ReadLatency - 2)) i_late (.clk_i, .d_i(read_rgb), .q_o(late_rgb));
  lipp_frame_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .write_i(fill_i), .write_buffer_i(fill_buffer_i), .write_at_i(fill_at_i),
    .write_rgb_i(fill_rgb_i), .a_buffer_i(front), .a_at_i(read_at), .a_rgb_o(read_rgb),
    .b_buffer_i(1'b0), .b_at_i('0), .b_rgb_o(unused_rgb)
  );

endmodule
