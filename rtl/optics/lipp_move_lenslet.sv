// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 5: the ray's point V relative to the dome that is a step (di, dj) away.
///
///   hx' = hx - di cx - dj rx,   hy' = hy - dj cy
///
/// where cx is the pitch, cy the distance of rows and rx the way along them to the next row's
/// lenslet, in radii: 0 (square) or cx / 2 rounded down (hex), with Shear a word of its own.
/// beyond_o: hx' or hy' is outside [-4, 4). Latency 2.
module lipp_move_lenslet #(
  parameter int F = 23,
  parameter int Grid = lipp_optics_pkg::GridSquare,
  parameter bit Shear = 1'b0
) (
  input  logic                clk_i,
  input  logic signed [F+2:0] hx_i,  // F fraction bits
  input  logic signed [F+2:0] hy_i,
  input  logic signed [1:0]   di_i,
  input  logic signed [1:0]   dj_i,
  input  logic signed [F+1:0] cx_i,  // wide
  input  logic signed [F+1:0] cy_i,  // wide
  input  logic signed [F+1:0] rx_i,  // wide (Shear)
  output logic signed [F+2:0] hx_o,
  output logic signed [F+2:0] hy_o,
  output logic                beyond_o
);
  import lipp_optics_pkg::*;

  localparam int Wh = F + 3;
  localparam int Ws = Wh + 2;  // three words' sum

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
