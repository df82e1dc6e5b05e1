// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Top for a place-and-route trial of `lipp_sdram_store`, surrounded by the registers of `probe`.
/// The clients' ports have registers with clk_i, the SDRAM's pins with the memory clock.
module probe_sdram #(
  parameter int Width = 1280,
  parameter int Height = 720,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic clk_i,
  input  logic mem_clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o,
  input  logic mem_bit_i,
  output logic mem_bit_o
);

  localparam int Request = 2 + 2 * PlaceBits + 1;
  localparam int In = 3 * Request + 3 + 24;
  localparam int Out = 3 + 2 * 25 + 2;

  logic rst_n, unused_rst_n;
  logic [In-1:0] in;
  logic [Out-1:0] out;
  logic [15:0] dq_in;
  logic [40:0] pins;
  probe #(.In(In), .Out(Out)) i_probe (
    .clk_i, .rst_ni, .bit_i, .bit_o, .rst_no(rst_n), .in_o(in), .out_i(out)
  );
  probe #(.In(16), .Out(41)) i_mem_probe (
    .clk_i(mem_clk_i), .rst_ni, .bit_i(mem_bit_i), .bit_o(mem_bit_o), .rst_no(unused_rst_n),
    .in_o(dq_in), .out_i(pins)
  );

  logic show_valid, show_ready, show_buffer, show_pixel_valid, show_pixel_ready;
  logic write_valid, write_ready, write_buffer, write_pixel_valid, write_pixel_ready, write_done;
  logic read_valid, read_ready, read_buffer, read_pixel_valid, read_pixel_ready;
  logic [PlaceBits-1:0] show_first, write_first, read_first;
  logic [PlaceBits:0] show_count, write_count, read_count;
  logic [23:0] show_rgb, write_rgb, read_rgb;
  logic cke, cs_n, ras_n, cas_n, we_n, dq_oe;
  logic [1:0] ba, dqm;
  logic [12:0] a;
  logic [15:0] dq;
  assign {
    show_valid, show_buffer, show_first, show_count, show_pixel_ready, write_valid, write_buffer,
    write_first, write_count, write_pixel_valid, write_rgb, read_valid, read_buffer, read_first,
    read_count, read_pixel_ready
  } = in;
  assign out = {
    show_ready, show_pixel_valid, show_rgb, write_ready, write_pixel_ready, write_done, read_ready,
    read_pixel_valid, read_rgb
  };
  assign pins = {2'b00, cke, cs_n, ras_n, cas_n, we_n, ba, a, dqm, dq, dq_oe};
  lipp_sdram_store #(.Width(Width), .Height(Height)) i_store (
    .clk_i, .rst_ni(rst_n), .show_valid_i(show_valid), .show_ready_o(show_ready),
    .show_buffer_i(show_buffer), .show_first_i(show_first), .show_count_i(show_count),
    .show_pixel_valid_o(show_pixel_valid), .show_pixel_ready_i(show_pixel_ready),
    .show_rgb_o(show_rgb), .write_valid_i(write_valid), .write_ready_o(write_ready),
    .write_buffer_i(write_buffer), .write_first_i(write_first), .write_count_i(write_count),
    .write_pixel_valid_i(write_pixel_valid), .write_pixel_ready_o(write_pixel_ready),
    .write_rgb_i(write_rgb), .write_done_o(write_done), .read_valid_i(read_valid),
    .read_ready_o(read_ready), .read_buffer_i(read_buffer), .read_first_i(read_first),
    .read_count_i(read_count), .read_pixel_valid_o(read_pixel_valid),
    .read_pixel_ready_i(read_pixel_ready), .read_rgb_o(read_rgb), .mem_clk_i, .cke_o(cke),
    .cs_no(cs_n), .ras_no(ras_n), .cas_no(cas_n), .we_no(we_n), .ba_o(ba), .a_o(a), .dqm_o(dqm),
    .dq_o(dq), .dq_oe_o(dq_oe), .dq_i(dq_in)
  );

endmodule

`default_nettype wire
