// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reads pixels from block RAM: accepts requests for consecutive pixels, outputs one per clock.
///
/// The next request is accepted after the last pixel of the current request. Input rgb_i in clock t
/// is the pixel at the address at_o of clock t - 2. A request's first pixel comes after 7 clocks.
module lipp_block_read_port #(
  parameter int Width = 640,
  parameter int Height = 480,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,
  input  logic                 valid_i,
  output logic                 ready_o,
  input  logic                 buffer_i,
  input  logic [PlaceBits-1:0] first_i,
  input  logic [PlaceBits:0]   count_i,  // number of pixels of the request, 1 or more
  output logic                 pixel_valid_o,
  input  logic                 pixel_ready_i,
  output logic [23:0]          rgb_o,

  output logic                 buffer_o,
  output logic [PlaceBits-1:0] at_o,
  input  logic [23:0]          rgb_i
);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_block_read_port: Width and Height must be 1 to 16383");
  end

  // number of pixels still to read from the RAM (unasked_q) and still to output (remaining_q)
  logic [PlaceBits:0] unasked_q, remaining_q;
  logic busy_q, asks_q, open, ask, take, unused_idle;
  assign ready_o = !busy_q;
  assign ask = asks_q && open;
  assign take = pixel_valid_o && pixel_ready_i;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {busy_q, asks_q} <= '0;
    end else if (!busy_q) begin
      {busy_q, asks_q} <= {2{valid_i}};
    end else begin
      if (take && remaining_q == (PlaceBits + 1)'(1)) busy_q <= 1'b0;
      if (ask && unasked_q == (PlaceBits + 1)'(1)) asks_q <= 1'b0;
    end
  end
  always_ff @(posedge clk_i) begin
    if (!busy_q) begin
      {buffer_o, at_o} <= {buffer_i, first_i};
      {unasked_q, remaining_q} <= {2{count_i}};
    end else begin
      if (ask) {at_o, unasked_q} <= {at_o + 1'b1, unasked_q - 1'b1};
      if (take) remaining_q <= remaining_q - 1'b1;
    end
  end

  lipp_flow_control #(.Latency(2), .AddressBits(4), .Width(24)) i_flow (
    .clk_i, .rst_ni, .hold_i(1'b0), .idle_o(unused_idle), .valid_i(asks_q), .ready_o(open),
    .piped_i(rgb_i), .valid_o(pixel_valid_o), .ready_i(pixel_ready_i), .data_o(rgb_o)
  );

endmodule

`default_nettype wire
