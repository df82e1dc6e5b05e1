`default_nettype none

/// Step 5: tells whether the point on the dome is in the lenslet's own cell, or else which cell to
/// try next.
///
/// An intersection with a dome is valid only *inside the dome's own cell*. Otherwise the next dome
/// to try is that of the neighbouring cell in the direction of the point. Distances along the
/// cell's axes are compared with half a pitch, H = p / (2 R); the cell is -H <= q < H:
///   square   q0 = nx, q1 = ny; (di, dj) is the sign of each that is outside
///   hex      q0 = nx, q1 = nx / 2 + (sqrt(3)/2) ny, q2 = q1 - nx; the step goes across the
///            flat with the largest |q|, ~q below 0: (1, 0), (0, 1), (-1, 1) or their opposites
///
/// q < -H is tested as ~q >= H, which needs no negation.
///
///   q1   = ((ny h >> F-2) + (nx << 2) + 4) >> 3,  h = floor(sqrt(3)/2 2^(F+1) + 1/2)
///
/// as integers, ny h >> k the product that `multiplier` cuts by k places. Words: near.
/// Latency cell_step_latency(Grid, F).
module cell_step #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // cross terms of products in multiplier cells
  parameter int Grid = optics_pkg::GridSquare
) (
  input  logic                clk_i,
  input  logic signed [F+1:0] nx_i,
  input  logic signed [F+1:0] ny_i,
  input  logic signed [F+1:0] half_i,
  output logic signed [1:0]   di_o,
  output logic signed [1:0]   dj_o,
  output logic                inside_o
);
  import optics_pkg::*;

  localparam int W = F + 2;

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "cell_step: F must be 14 to 23");
  end
  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "cell_step: Grid must be GridSquare or GridHex");
  end

  if (Grid == GridHex) begin : gen_hex
    // sqrt(3)/2 as a near word, and the product with F + 4 fraction bits
    localparam int Drop = F + 1 - Guard;
    localparam int Wp = 2 * W - Drop;
    localparam logic signed [W-1:0] HalfSqrt3 =
        W'($rtoi(0.8660254037844386468 * real'(1 << (F + 1)) + 0.5));
    logic signed [Wp-1:0] rise, half_nx_q, sum_q;
    logic signed [W-1:0] nx_late;
    logic signed [W:0] q0_q, q1_q, q2_q, q1_d;
    multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)) i_rise (
      .clk_i, .a_i(ny_i), .b_i(HalfSqrt3), .p_o(rise)
    );
    delay #(.Width(W), .Cycles(mul_latency(W, W) - 1)) i_nx (.clk_i, .d_i(nx_i), .q_o(nx_late));
    logic signed [W-1:0] nx_q, nx_q2;
    assign q1_d = (W + 1)'(sum_q >>> Guard);
    always_ff @(posedge clk_i) begin
      half_nx_q <= (Wp'(nx_late) <<< (Guard - 1)) + Wp'(4);  // with the rounding's half
      nx_q <= nx_late;
      sum_q <= rise + half_nx_q;
      nx_q2 <= nx_q;
      q0_q <= (W + 1)'(nx_q2);
      q1_q <= q1_d;
      q2_q <= q1_d - (W + 1)'(nx_q2);
    end

    // ---- distances, and which of them are outside the half-open cell ----
    logic [W:0] size0_q, size1_q, size2_q;
    logic out0_q, out1_q, out2_q, minus0_q, minus1_q, minus2_q;
    logic signed [W:0] half;
    assign half = (W + 1)'(half_i);
    always_ff @(posedge clk_i) begin
      size0_q <= q0_q[W] ? ~q0_q : q0_q;
      size1_q <= q1_q[W] ? ~q1_q : q1_q;
      size2_q <= q2_q[W] ? ~q2_q : q2_q;
      {minus0_q, minus1_q, minus2_q} <= {q0_q[W], q1_q[W], q2_q[W]};
      out0_q <= q0_q >= half || ~q0_q >= half;
      out1_q <= q1_q >= half || ~q1_q >= half;
      out2_q <= q2_q >= half || ~q2_q >= half;
    end
    logic first0, first1;
    assign first0 = size0_q >= size1_q && size0_q >= size2_q;
    assign first1 = size1_q >= size2_q;
    always_ff @(posedge clk_i) begin
      inside_o <= !(out0_q || out1_q || out2_q);
      if (!(out0_q || out1_q || out2_q)) begin
        di_o <= '0;
        dj_o <= '0;
      end else if (first0) begin
        di_o <= minus0_q ? -2'sd1 : 2'sd1;
        dj_o <= '0;
      end else if (first1) begin
        di_o <= '0;
        dj_o <= minus1_q ? -2'sd1 : 2'sd1;
      end else begin
        di_o <= minus2_q ? 2'sd1 : -2'sd1;
        dj_o <= minus2_q ? -2'sd1 : 2'sd1;
      end
    end
  end else begin : gen_square
    logic right_q, left_q, up_q, down_q;
    always_ff @(posedge clk_i) begin
      right_q <= nx_i >= half_i;
      left_q <= ~nx_i >= half_i;
      up_q <= ny_i >= half_i;
      down_q <= ~ny_i >= half_i;
      di_o <= right_q ? 2'sd1 : left_q ? -2'sd1 : '0;
      dj_o <= up_q ? 2'sd1 : down_q ? -2'sd1 : '0;
      inside_o <= !(right_q || left_q || up_q || down_q);
    end
  end

endmodule

`default_nettype wire
