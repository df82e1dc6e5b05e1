/// frame_check at a port of a frame store, which the test fills.
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
  input  logic                 fill_i,
  input  logic                 fill_buffer_i,
  input  logic [PlaceBits-1:0] fill_at_i,
  input  logic [23:0]          fill_rgb_i
);

  logic read_buffer;
  logic [PlaceBits-1:0] read_at;
  logic [23:0] read_rgb, unused_rgb;
  lipp_frame_check #(.Width(Width), .Height(Height)) i_check (
    .clk_i, .rst_ni, .start_i, .buffer_i, .busy_o, .done_o, .crc_o,
    .read_buffer_o(read_buffer), .read_at_o(read_at), .read_rgb_i(read_rgb)
  );
  lipp_frame_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .write_i(fill_i), .write_buffer_i(fill_buffer_i), .write_at_i(fill_at_i),
    .write_rgb_i(fill_rgb_i), .a_buffer_i(1'b0), .a_at_i('0), .a_rgb_o(unused_rgb),
    .b_buffer_i(read_buffer), .b_at_i(read_at), .b_rgb_o(read_rgb)
  );

endmodule
