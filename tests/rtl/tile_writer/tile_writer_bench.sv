/// tile_writer before a frame store, which the test may fill and read too.
module tile_writer_bench #(
  parameter int Width = 72,
  parameter int Height = 56,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                  clk_i,
  input  logic                  rst_ni,

  input  logic                  start_i,
  input  logic [15:0]           tile_i,
  input  logic [7:0]            coding_i,
  input  logic                  buffer_i,
  input  logic                  empty_i,

  input  logic                  valid_i,
  input  logic [7:0]            data_i,
  input  logic                  last_i,
  output logic                  ready_o,
  output logic                  done_o,
  output logic                  ok_o,
  output logic [31:0]           crc_o,

  /// The write in this clock: whether, buffer, place, pixel.
  output logic [PlaceBits+25:0] written_o,

  input  logic                  fill_i,
  input  logic                  at_buffer_i,
  input  logic [PlaceBits-1:0]  at_i,
  input  logic [23:0]           rgb_i,
  output logic [23:0]           rgb_o
);

  logic write, write_buffer, copy_buffer;
  logic [PlaceBits-1:0] write_at, copy_at;
  logic [23:0] write_rgb, copy_rgb;
  assign written_o = {write, write_buffer, write_at, write_rgb};

  lipp_tile_writer #(.Width(Width), .Height(Height)) i_writer (
    .clk_i, .rst_ni, .start_i, .tile_i, .coding_i, .buffer_i, .empty_i, .done_o, .ok_o, .crc_o,
    .valid_i, .ready_o, .data_i, .last_i, .write_o(write), .write_buffer_o(write_buffer),
    .write_at_o(write_at), .write_rgb_o(write_rgb), .copy_buffer_o(copy_buffer),
    .copy_at_o(copy_at), .copy_rgb_i(copy_rgb)
  );
  lipp_frame_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .write_i(fill_i || write), .write_buffer_i(fill_i ? at_buffer_i : write_buffer),
    .write_at_i(fill_i ? at_i : write_at), .write_rgb_i(fill_i ? rgb_i : write_rgb),
    .a_buffer_i(at_buffer_i), .a_at_i(at_i), .a_rgb_o(rgb_o),
    .b_buffer_i(copy_buffer), .b_at_i(copy_at), .b_rgb_o(copy_rgb)
  );

endmodule
