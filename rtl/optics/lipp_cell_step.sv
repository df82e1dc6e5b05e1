// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 5 of the ray trace: checks whether the point on the dome is in the lenslet's own cell, and,
/// if the point is outside, selects the next cell to try.
///
/// A ray's intersection N with a dome is valid only inside the cell of that dome. For a point
/// outside, the next dome to try is that of the neighbouring cell in the direction of the point.
/// The distances q of the point from the cell's centre along the cell's axes are compared with half
/// a pitch, H = px / (2 R), where px is the pitch along the rows and R the dome's radius. The point
/// is inside the cell if -H <= q < H on every axis. The shear s is 0 with Shear = 0.
///
/// On the square grid, di is the sign of q0 if q0 is outside, else 0; dj likewise follows from q1:
///
///   q0 = nx - s ny
///   q1 = ny            (compared with py / (2 R), where py is the distance between rows).
///
/// On the hexagonal grid, the step (di, dj) crosses the side of the cell with the largest |q|,
/// where |q| is ~q for q < 0. The step is (1, 0) for q0, (0, 1) for q1, (-1, 1) for q2, and the
/// opposite for q < 0:
///
///   q0 = nx - s ny
///   q1 = nx / 2 + h ny,   h = (sqrt(3)/2) px / py - s / 2
///   q2 = q1 - q0.
///
/// The comparison q < -H is computed as ~q >= H, which needs no negation. In the formulas all words
/// are integers, h = n 2^(F+1) + m with 0 <= m < 2^(F+1), and a b >> k is the product of
/// `lipp_multiplier` truncated by k bits. The distances are
///
///   q0   = ((nx << 3) - (ny s >> F-3) + 4) >> 3
///   q1   = ((ny m >> F-2) + (nx << 2) + (n ny << 3) + 4) >> 3,  h = n 2^(F+1) + m.
///
/// The words q, H and h have F + 1 fraction bits, and s has F. The latency is
/// cell_step_latency(Grid, F, Shear) clocks.
module lipp_cell_step #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,  // 1: cross terms use multiplier cells
  parameter int Grid = lipp_optics_pkg::GridSquare,
  parameter bit Shear = 1'b0
) (
  input  logic                clk_i,
  input  logic signed [F+1:0] nx_i,
  input  logic signed [F+1:0] ny_i,
  input  logic signed [F+1:0] half_i,    // half pitch H = px / (2 R), F + 1 fraction bits
  input  logic signed [F+1:0] half_y_i,  // half row distance py / (2 R), F + 1 fraction bits
  input  logic signed [F+3:0] rise_i,    // coefficient h (hexagonal), F + 1 fraction bits
  input  logic signed [F+1:0] shear_i,   // shear s (Shear = 1), F fraction bits
  output logic signed [1:0]   di_o,
  output logic signed [1:0]   dj_o,
  output logic                inside_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wq = W + 3;  // width of q0, q1 and q2, without overflow for any inputs
  localparam int Wt = Wq + Guard;
  localparam int MulLatency = mul_latency(W, W);

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_cell_step: F must be 14 to 23");
  end
  if (Grid != GridSquare && Grid != GridHex) begin : gen_illegal_grid
    $fatal(1, "lipp_cell_step: Grid must be GridSquare or GridHex");
  end

  // ---- compute q0, the distance along the rows ----
  logic signed [Wq-1:0] q0_d;
  if (Shear) begin : gen_shear
    localparam int Drop = F - Guard;
    logic signed [2*W-Drop-1:0] lean;
    logic signed [W-1:0] nx_late;
    logic signed [Wt-1:0] sum_q;
    lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)) i_lean (
      .clk_i, .a_i(ny_i), .b_i(shear_i), .p_o(lean)
    );
    lipp_delay #(.Width(W), .Cycles(MulLatency)) i_nx (.clk_i, .d_i(nx_i), .q_o(nx_late));
    // The word nx << 3 ends in three zero bits. Setting bit 2 adds the rounding constant 4.
    always_ff @(posedge clk_i) sum_q <= ((Wt'(nx_late) <<< Guard) | Wt'(4)) - Wt'(lean);
    assign q0_d = Wq'(sum_q >>> Guard);
  end else begin : gen_upright
    logic signed [W-1:0] nx_late;
    lipp_delay #(.Width(W), .Cycles(Grid == GridHex ? MulLatency + 1 : 0)) i_nx (
      .clk_i, .d_i(nx_i), .q_o(nx_late)
    );
    assign q0_d = Wq'(nx_late);
    logic unused_shear;
    assign unused_shear = ^shear_i;
  end

  if (Grid == GridHex) begin : gen_hex
    // ---- compute h ny with F + 4 fraction bits, as (m ny) 2^-(F+1) + n ny ----
    localparam int Drop = F + 1 - Guard;
    logic signed [2*W-Drop-1:0] rise;
    lipp_multiplier #(.CrossCells(CrossCells), .Wa(W), .Wb(W), .Drop(Drop)) i_rise (
      .clk_i, .a_i(ny_i), .b_i({1'b0, rise_i[F:0]}), .p_o(rise)
    );
    logic signed [Wt-1:0] ny, half_nx_q, half_nx_q2, once_q, fourth_q, offset_q, constant_q,
        constant, sum_q;
    assign ny = Wt'(ny_i) <<< Guard;
    always_ff @(posedge clk_i) begin
      half_nx_q <= (Wt'(nx_i) <<< (Guard - 1)) + Wt'(4);  // the 4 is the rounding constant
      once_q <= (rise_i[F+1] ? ny : '0) + (rise_i[F+2] ? ny <<< 1 : '0);
      fourth_q <= rise_i[F+3] ? ny <<< 2 : '0;
      offset_q <= once_q - fourth_q;
      half_nx_q2 <= half_nx_q;
      constant_q <= half_nx_q2 + offset_q;
    end
    lipp_delay #(.Width(Wt), .Cycles(MulLatency - 3)) i_rest (.clk_i, .d_i(constant_q),
        .q_o(constant));
    logic signed [Wq-1:0] q0_q, q1_q, q2_q, q1_d;
    assign q1_d = Wq'(sum_q >>> Guard);
    always_ff @(posedge clk_i) begin
      sum_q <= Wt'(rise) + constant;
      q0_q <= q0_d;
      q1_q <= q1_d;
      q2_q <= q1_d - q0_d;
    end
    logic unused_half_y;
    assign unused_half_y = ^half_y_i;

    // ---- compare each distance with the limits of the cell ----
    logic [Wq-1:0] size0_q, size1_q, size2_q;
    logic out0_q, out1_q, out2_q, minus0_q, minus1_q, minus2_q;
    logic signed [Wq-1:0] half;
    assign half = Wq'(half_i);
    always_ff @(posedge clk_i) begin
      size0_q <= q0_q[Wq-1] ? ~q0_q : q0_q;
      size1_q <= q1_q[Wq-1] ? ~q1_q : q1_q;
      size2_q <= q2_q[Wq-1] ? ~q2_q : q2_q;
      {minus0_q, minus1_q, minus2_q} <= {q0_q[Wq-1], q1_q[Wq-1], q2_q[Wq-1]};
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
    logic signed [Wq-1:0] q0, half;
    logic signed [W-1:0] q1;
    if (Shear) begin : gen_late
      always_ff @(posedge clk_i) q0 <= q0_d;
    end else begin : gen_now
      assign q0 = q0_d;
    end
    lipp_delay #(.Width(W), .Cycles(Shear ? MulLatency + 2 : 0)) i_ny (
      .clk_i, .d_i(ny_i), .q_o(q1)
    );
    assign half = Wq'(half_i);
    logic unused_rise;
    assign unused_rise = ^rise_i;
    logic right_q, left_q, up_q, down_q;
    always_ff @(posedge clk_i) begin
      right_q <= q0 >= half;
      left_q <= ~q0 >= half;
      up_q <= q1 >= half_y_i;
      down_q <= ~q1 >= half_y_i;
      di_o <= right_q ? 2'sd1 : left_q ? -2'sd1 : '0;
      dj_o <= up_q ? 2'sd1 : down_q ? -2'sd1 : '0;
      inside_o <= !(right_q || left_q || up_q || down_q);
    end
  end

endmodule

`default_nettype wire
