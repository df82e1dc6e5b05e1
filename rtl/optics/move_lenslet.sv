`default_nettype none

/// Step 5: the ray's point V relative to the dome that is a step (di, dj) away.
///
///   hx' = hx - di cx - dj rx,   hy' = hy - dj cy
///
/// where cx is the pitch, cy the distance of rows and rx the way along them to the next row's
/// lenslet, in radii: 0 (square) or cx / 2 rounded down (hex), with Shear a word of its own.
/// Latency 2.
module move_lenslet #(
  parameter int F = 23,
  parameter int Grid = optics_pkg::GridSquare,
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
  output logic signed [F+2:0] hy_o
);
  import optics_pkg::*;

  localparam int Wh = F + 3;

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "move_lenslet: F must be 14 to 23");
  end
  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "move_lenslet: Grid must be GridSquare or GridHex");
  end

  logic signed [Wh-1:0] rx, whole, part, row, step_x_q, step_y_q, hx_q, hy_q;
  assign rx = Shear ? Wh'(rx_i) : Grid == GridHex ? Wh'(cx_i >>> 1) : '0;
  assign whole = di_i == 2'sd0 ? '0 : di_i[1] ? -Wh'(cx_i) : Wh'(cx_i);
  assign part = dj_i == 2'sd0 ? '0 : dj_i[1] ? -rx : rx;
  assign row = dj_i == 2'sd0 ? '0 : dj_i[1] ? -Wh'(cy_i) : Wh'(cy_i);
  always_ff @(posedge clk_i) begin
    step_x_q <= whole + part;
    step_y_q <= row;
    hx_q <= hx_i;
    hy_q <= hy_i;
    hx_o <= hx_q - step_x_q;
    hy_o <= hy_q - step_y_q;
  end

  logic unused_row;
  assign unused_row = ^rx_i;

endmodule

`default_nettype wire
