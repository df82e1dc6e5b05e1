/// tile_writer before a store that the test may fill and read too. pause_i holds back whatever the store
/// would do in that clock.
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

  input  logic                  pause_i,
  /// The write in the clock before: whether, buffer, place, pixel.
  output logic [PlaceBits+25:0] written_o,

  input  logic                  fill_i,
  input  logic                  at_buffer_i,
  input  logic [PlaceBits-1:0]  at_i,
  input  logic [23:0]           rgb_i,
  output logic [23:0]           rgb_o
);

  logic write_valid, write_ready, write_buffer, write_pixel_valid, write_pixel_ready, write_done;
  logic read_valid, read_ready, read_buffer, read_pixel_valid, read_pixel_ready;
  logic [PlaceBits-1:0] write_first, read_first;
  logic [PlaceBits:0] write_count, read_count;
  logic [23:0] write_rgb, read_rgb;
  lipp_tile_writer #(.Width(Width), .Height(Height)) i_writer (
    .clk_i, .rst_ni, .start_i, .tile_i, .coding_i, .buffer_i, .empty_i, .done_o, .ok_o, .crc_o,
    .valid_i, .ready_o, .data_i, .last_i, .write_valid_o(write_valid), .write_ready_i(write_ready),
    .write_buffer_o(write_buffer), .write_first_o(write_first), .write_count_o(write_count),
    .write_pixel_valid_o(write_pixel_valid), .write_pixel_ready_i(write_pixel_ready),
    .write_rgb_o(write_rgb), .write_done_i(write_done), .read_valid_o(read_valid),
    .read_ready_i(read_ready), .read_buffer_o(read_buffer), .read_first_o(read_first),
    .read_count_o(read_count), .read_pixel_valid_i(read_pixel_valid),
    .read_pixel_ready_o(read_pixel_ready), .read_rgb_i(read_rgb)
  );

  // ---- the store: a request, its pixels, and for a write its end ----
  logic [23:0] pixels[2 << PlaceBits];
  logic writes_q, ends_q, reads_q, to_q, from_q, write;
  logic [PlaceBits-1:0] to_at_q, from_at_q;
  logic [PlaceBits:0] to_left_q, from_left_q;
  assign write_ready = !writes_q && !ends_q && !pause_i;
  assign write_pixel_ready = writes_q && !pause_i;
  assign write = write_pixel_valid && write_pixel_ready;
  assign write_done = ends_q && !pause_i;
  always_ff @(posedge clk_i) written_o <= {write && rst_ni, to_q, to_at_q, write_rgb};
  assign read_ready = !reads_q && !pause_i;
  assign read_pixel_valid = reads_q && !pause_i;
  assign read_rgb = read_pixel_valid ? pixels[{from_q, from_at_q}] : 24'hdead00;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {writes_q, ends_q, reads_q} <= '0;
    end else begin
      if (write_valid && write_ready) begin
        {writes_q, to_q, to_at_q, to_left_q} <= {1'b1, write_buffer, write_first, write_count};
      end else if (write) begin
        {to_at_q, to_left_q} <= {to_at_q + 1'b1, to_left_q - 1'b1};
        if (to_left_q == (PlaceBits + 1)'(1)) {writes_q, ends_q} <= 2'b01;
      end
      if (write_done) ends_q <= 1'b0;
      if (read_valid && read_ready) begin
        {reads_q, from_q, from_at_q, from_left_q} <= {1'b1, read_buffer, read_first, read_count};
      end else if (read_pixel_valid && read_pixel_ready) begin
        {from_at_q, from_left_q} <= {from_at_q + 1'b1, from_left_q - 1'b1};
        if (from_left_q == (PlaceBits + 1)'(1)) reads_q <= 1'b0;
      end
    end
  end
  always_ff @(posedge clk_i) begin
    if (fill_i) pixels[{at_buffer_i, at_i}] <= rgb_i;
    else if (write) pixels[{to_q, to_at_q}] <= write_rgb;
    rgb_o <= pixels[{at_buffer_i, at_i}];
  end
  // What the contract of a store demands of its clients.
  always_ff @(posedge clk_i) begin
    if (rst_ni) begin
      a_count: assert (!(write_valid && write_ready) || (write_count != '0 && int'(write_first) + int'(write_count) <= Width * Height));
      a_idle: assert (!(done_o && (writes_q || ends_q || reads_q)));
    end
  end

endmodule
