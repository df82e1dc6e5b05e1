// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 5 of the ray trace: computes the ray's start V relative to the next dome, which is (di, dj)
/// lenslets away.
///
/// The new coordinates are
///
///   hx' = hx - di cx - dj rx,   hy' = hy - dj cy,
///
/// where cx is the pitch along the rows, cy is the distance between rows, and rx is the shift along
/// x from a lenslet to its neighbour in the next row. All lengths are in radii with F fraction
/// bits, and the results are exact. With Shear = 1, rx is an input. With Shear = 0, rx is 0 on a
/// square grid and floor(cx / 2) on a hexagonal grid. Output beyond_o reports that hx' or hy' is
/// outside [-4, 4). The latency is 2 clocks.
module lipp_move_lenslet #(
  parameter int F = 23,
  parameter int Grid = lipp_optics_pkg::GridSquare,
  parameter bit Shear = 1'b0
) (
  input  logic                clk_i,
  input  logic signed [F+2:0] hx_i,  // x of point V in radii, F fraction bits
  input  logic signed [F+2:0] hy_i,
  input  logic signed [1:0]   di_i,
  input  logic signed [1:0]   dj_i,
  input  logic signed [F+1:0] cx_i,  // pitch along the rows, in 2^-F radii
  input  logic signed [F+1:0] cy_i,  // distance between rows, in 2^-F radii
  input  logic signed [F+1:0] rx_i,  // x shift to the next row, in 2^-F radii (Shear = 1)
  output logic signed [F+2:0] hx_o,
  output logic signed [F+2:0] hy_o,
  output logic                beyond_o
);
  import lipp_optics_pkg::*;

  localparam int Wh = F + 3;
  localparam int Ws = Wh + 2;  // width of a sum of three words

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_move_lenslet: F must be 14 to 23");
  end
  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "lipp_move_lenslet: Grid must be GridSquare or GridHex");
  end

  logic signed [Wh-1:0] rx, columns_x, rows_x, row, step_y_q, hx_q, hy_q;
  logic signed [Ws-1:0] step_x_q, hx_d, hy_d;
  assign rx = Shear ? Wh'(rx_i) : Grid == GridHex ? Wh'(cx_i >>> 1) : '0;
  assign columns_x = di_i == 2'sd0 ? '0 : di_i[1] ? -Wh'(cx_i) : Wh'(cx_i);
  assign rows_x = dj_i == 2'sd0 ? '0 : dj_i[1] ? -rx : rx;
  assign row = dj_i == 2'sd0 ? '0 : dj_i[1] ? -Wh'(cy_i) : Wh'(cy_i);
  assign hx_d = Ws'(hx_q) - step_x_q;
  assign hy_d = Ws'(hy_q) - Ws'(step_y_q);
  always_ff @(posedge clk_i) begin
    step_x_q <= Ws'(columns_x) + Ws'(rows_x);
    step_y_q <= row;
    hx_q <= hx_i;
    hy_q <= hy_i;
    hx_o <= Wh'(hx_d);
    hy_o <= Wh'(hy_d);
    beyond_o <= hx_d != Ws'($signed(hx_d[Wh-1:0])) || hy_d != Ws'($signed(hy_d[Wh-1:0]));
  end

  logic unused_row;
  assign unused_row = ^rx_i;

endmodule

`default_nettype wire
