/// frame_check at a block store, which the test fills; pause_i holds its pixels back.
module frame_check_bench #(
  parameter int Width = 9,
  parameter int Height = 5,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,
  input  logic                 start_i,
  input  logic                 buffer_i,
  output logic                 busy_o,
  output logic                 done_o,
  output logic [31:0]          crc_o,
  input  logic                 pause_i,
  input  logic                 fill_i,
  input  logic                 fill_buffer_i,
  input  logic [PlaceBits-1:0] fill_at_i,
  input  logic [23:0]          fill_rgb_i,
  output logic                 fill_done_o
);

  logic valid, ready, buffer, pixel_valid, pixel_ready;
  logic [PlaceBits-1:0] first;
  logic [PlaceBits:0] count;
  logic [23:0] rgb;
  lipp_frame_check #(.Width(Width), .Height(Height)) i_check (
    .clk_i, .rst_ni, .start_i, .buffer_i, .busy_o, .done_o, .crc_o, .read_valid_o(valid),
    .read_ready_i(ready && !pause_i), .read_buffer_o(buffer), .read_first_o(first),
    .read_count_o(count), .read_pixel_valid_i(pixel_valid && !pause_i),
    .read_pixel_ready_o(pixel_ready), .read_rgb_i(pause_i ? 24'hdead00 : rgb)
  );
  logic unused_show, unused_write;
  logic [23:0] unused_rgb;
  logic [2:0] unused_ready;
  assign unused_show = ^{unused_rgb, unused_ready, unused_write};
  lipp_block_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .rst_ni, .show_valid_i(1'b0), .show_ready_o(unused_ready[0]), .show_buffer_i(1'b0),
    .show_first_i('0), .show_count_i('0), .show_pixel_valid_o(unused_ready[1]),
    .show_pixel_ready_i(1'b0), .show_rgb_o(unused_rgb), .write_valid_i(fill_i),
    .write_ready_o(unused_ready[2]), .write_buffer_i(fill_buffer_i), .write_first_i(fill_at_i),
    .write_count_i((PlaceBits + 1)'(1)), .write_pixel_valid_i(fill_i), .write_pixel_ready_o(unused_write),
    .write_rgb_i(fill_rgb_i), .write_done_o(fill_done_o), .read_valid_i(valid && !pause_i),
    .read_ready_o(ready), .read_buffer_i(buffer), .read_first_i(first), .read_count_i(count),
    .read_pixel_valid_o(pixel_valid), .read_pixel_ready_i(pixel_ready && !pause_i), .read_rgb_o(rgb)
  );

endmodule
