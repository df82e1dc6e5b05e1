// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Example of a user's design around Lippmann's optics block: writes the display's registers,
/// traces a chief ray for every pixel of the panel, and outputs the exit rays.
///
///   boot -> APB4 ------------------> lipp_optics_block -> exit rays
///   pixel_source -> fifo (stream) ->
///
/// The example's modules `board`, `fifo` and `delay` do not collide with lipp_board and so on.
module board
  import display_pkg::F, lipp_optics_pkg::IndexBits, lipp_optics_pkg::PixelBits;
(
  input  logic                        clk_i,
  input  logic                        rst_ni,         // asynchronous

  output logic                        exit_valid_o,
  input  logic                        exit_ready_i,
  output logic signed [IndexBits-1:0] exit_i_o,       // lenslet index along a row
  output logic signed [IndexBits-1:0] exit_j_o,
  output logic signed [F+3:0]         exit_x_o,       // exit point, lens-local, in radii
  output logic signed [F+3:0]         exit_y_o,
  output logic signed [F+3:0]         exit_z_o,
  output logic signed [F+1:0]         exit_dx_o,      // direction, a unit vector
  output logic signed [F+1:0]         exit_dy_o,
  output logic signed [F+1:0]         exit_dz_o,
  output lipp_optics_pkg::ray_status_e    exit_status_o,
  output logic                        exit_last_o,    // 1: the last exit ray of the frame
  output logic                        lost_o          // 1: the ray two clocks ago was not ok
);

  logic rst_n;
  lipp_reset_sync i_reset (.clk_i, .rst_ni, .rst_no(rst_n));

  // ---- registers ----
  logic sel, enable, ready;
  logic [8:0] addr;
  logic [31:0] wdata;
  boot i_boot (
    .clk_i, .rst_ni(rst_n), .sel_o(sel), .enable_o(enable), .addr_o(addr), .wdata_o(wdata),
    .ready_i(ready)
  );

  // ---- pixels ----
  logic pixel_valid, pixel_full, pixel_first, pixel_last, ray_valid, ray_ready, ray_first, ray_last;
  logic signed [PixelBits-1:0] pixel_u, pixel_v, ray_u, ray_v;
  pixel_source i_source (
    .clk_i, .rst_ni(rst_n), .valid_o(pixel_valid), .ready_i(!pixel_full),
    .u_o(pixel_u), .v_o(pixel_v), .first_o(pixel_first), .last_o(pixel_last)
  );
  fifo #(.Bits(2 * PixelBits + 2)) i_fifo (
    .clk_i, .rst_ni(rst_n),
    .push_i(pixel_valid && !pixel_full), .full_o(pixel_full),
    .word_i({pixel_u, pixel_v, pixel_first, pixel_last}),
    .pop_i(ray_valid && ray_ready), .filled_o(ray_valid),
    .word_o({ray_u, ray_v, ray_first, ray_last})
  );

  // ---- optics ----
  logic [31:0] unused_rdata;
  logic unused_error, unused_first;
  lipp_optics_pkg::optics_config_t unused_optics;
  lipp_optics_block #(.Build(display_pkg::Build)) i_optics (
    .clk_i, .rst_ni(rst_n),
    .s_apb_psel(sel), .s_apb_penable(enable), .s_apb_pwrite(1'b1), .s_apb_pprot('0),
    .s_apb_paddr(addr), .s_apb_pwdata(wdata), .s_apb_pstrb('1), .s_apb_pready(ready),
    .s_apb_prdata(unused_rdata), .s_apb_pslverr(unused_error),
    .ray_valid_i(ray_valid), .ray_ready_o(ray_ready), .ray_u_i(ray_u), .ray_v_i(ray_v),
    .ray_a_i('0), .ray_b_i('0), .ray_first_i(ray_first), .ray_last_i(ray_last),
    .exit_valid_o, .exit_ready_i, .exit_i_o, .exit_j_o, .exit_x_o, .exit_y_o, .exit_z_o,
    .exit_dx_o, .exit_dy_o, .exit_dz_o, .exit_status_o, .exit_first_o(unused_first), .exit_last_o,
    .optics_o(unused_optics)
  );
  delay #(.Clocks(2)) i_lost (
    .clk_i, .bit_i(exit_valid_o && exit_ready_i && exit_status_o != lipp_optics_pkg::StatusOk),
    .bit_o(lost_o)
  );

endmodule

`default_nettype wire
