// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// CRC-32 of a whole buffer of the frame store: rows top to bottom, bytes R, G, B.
///
/// start_i starts the check; it is ignored while busy_o is high. done_o is a pulse
/// Width * Height + ReadLatency + 1 clocks later; crc_o is then valid until the next start. The
/// module reads one pixel a clock through a port of the store, which it owns while busy_o is high.
module lipp_frame_check #(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int ReadLatency = 2,  // 2 or more
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,

  input  logic                 start_i,
  input  logic                 buffer_i,  // copied at the start
  output logic                 busy_o,
  output logic                 done_o,    // pulse
  output logic [31:0]          crc_o,

  output logic                 read_buffer_o,
  output logic [PlaceBits-1:0] read_at_o,
  input  logic [23:0]          read_rgb_i  // ReadLatency clocks after its address
);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_frame_check: Width and Height must be 1 to 16383");
  end
  if (ReadLatency < 2) begin : gen_illegal
    $fatal(1, "lipp_frame_check: ReadLatency must be 2 or more");
  end

  logic ask_q, take;
  logic [ReadLatency:1] asked_q;  // clocks ago
  logic [31:0] crc_q;
  assign take = start_i && !busy_o;
  assign busy_o = ask_q || asked_q != '0;
  assign crc_o = ~crc_q;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {ask_q, asked_q, done_o} <= '0;
    end else begin
      if (take) ask_q <= 1'b1;
      else if (read_at_o == PlaceBits'(Width * Height - 1)) ask_q <= 1'b0;
      asked_q <= ReadLatency'({asked_q, ask_q});
      done_o <= asked_q == ReadLatency'(1) << (ReadLatency - 1);
    end
  end

  always_ff @(posedge clk_i) begin
    if (take) begin
      read_buffer_o <= buffer_i;
      read_at_o <= '0;
      crc_q <= lipp_link_pkg::CrcStart;
    end else begin
      if (ask_q) read_at_o <= read_at_o + 1'b1;
      if (asked_q[ReadLatency]) crc_q <= lipp_link_pkg::crc32_pixel(crc_q, read_rgb_i);
    end
  end

endmodule

`default_nettype wire
