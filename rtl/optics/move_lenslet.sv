`default_nettype none

/// Step 5: the ray's point V relative to the dome that is a step (di, dj) away.
///
///   hx' = hx - di cx - dj cx / 2 (square: hx - di cx),   hy' = hy - dj cy
///
/// where cx = p/R is the pitch and cy = cx (square) or cx sqrt(3)/2 (hex) the distance of rows, in
/// radii; cx / 2 is rounded down. Latency 2.
module move_lenslet #(
  parameter int F = 23,
  parameter int Grid = optics_pkg::GridSquare
) (
  input  logic                clk_i,
  input  logic signed [F+2:0] hx_i,  // F fraction bits
  input  logic signed [F+2:0] hy_i,
  input  logic signed [1:0]   di_i,
  input  logic signed [1:0]   dj_i,
  input  logic signed [F+1:0] cx_i,  // wide
  input  logic signed [F+1:0] cy_i,  // wide
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

  // The sum is at most one and a half pitches.
  logic signed [Wh-1:0] whole, half, row, step_x_q, step_y_q, hx_q, hy_q;
  assign whole = di_i == 2'sd0 ? '0 : di_i[1] ? -Wh'(cx_i) : Wh'(cx_i);
  assign half = Grid != GridHex || dj_i == 2'sd0 ? '0 :
      dj_i[1] ? -Wh'(cx_i >>> 1) : Wh'(cx_i >>> 1);
  assign row = dj_i == 2'sd0 ? '0 : dj_i[1] ? -Wh'(cy_i) : Wh'(cy_i);
  always_ff @(posedge clk_i) begin
    step_x_q <= whole + half;
    step_y_q <= row;
    hx_q <= hx_i;
    hy_q <= hy_i;
    hx_o <= hx_q - step_x_q;
    hy_o <= hy_q - step_y_q;
  end

endmodule

`default_nettype wire
