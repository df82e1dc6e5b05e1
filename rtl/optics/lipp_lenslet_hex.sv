// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 2 of the ray trace, builds with a hexagonal grid: finds the lenslet whose cell contains the
/// pixel's point, and measures the point from that lenslet's centre.
///
/// The point has the coordinates x in pitches and t = y in rows, where a row is sqrt(3)/2 pitches
/// high. The point's oblique coordinates are s = x - t/2 and t. The integer parts of s and t are
/// the corner (i0, j0) of the parallelogram that contains the point; the fractions of s and t are
/// fs and ft. The borders between the cells of the corners are the lines q = 1/2 and q = 1, where q
/// is q0 or q1:
///
///   q0 = fs + ft/2,   q1 = fs/2 + ft.
///
/// The lenslet (i, j) is
///
///   (i, j) - (i0, j0) = (0, 0)  if q0 < 1/2 and q1 < 1/2
///                       (1, 1)  if q0 >= 1 and q1 >= 1
///                       (1, 0)  otherwise, if ft < fs
///                       (0, 1)  otherwise.
///
/// The point measured from the lenslet's centre is computed without rounding:
///
///   local x = x - i - j/2,   local t = t - j.
///
/// The outputs are the indices, and the local point x_o in pitches and y_o in rows, signed with F
/// fraction bits. Output beyond_o reports that an index wraps. The latency is
/// lenslet_latency(GridHex) clocks.
module lipp_lenslet_hex #(
  parameter int F = 23
) (
  input  logic                                           clk_i,
  input  logic signed [lipp_optics_pkg::IndexBits+F-1:0] x_i,
  input  logic signed [lipp_optics_pkg::IndexBits+F-1:0] y_i,
  output logic signed [lipp_optics_pkg::IndexBits-1:0]   i_o,
  output logic signed [lipp_optics_pkg::IndexBits-1:0]   j_o,
  output logic signed [F+1:0]                            x_o,
  output logic signed [F+1:0]                            y_o,
  output logic                                           beyond_o
);
  import lipp_optics_pkg::*;

  localparam int L = IndexBits + F;

  if (F < 14 || F > 23) begin : gen_illegal
    $fatal(1, "lipp_lenslet_hex: F must be 14 to 23");
  end

  // ---- compute the oblique coordinates; s has F + 1 fraction bits ----
  logic [L+1:0] s_q;
  logic [L-1:0] t_q;
  always_ff @(posedge clk_i) begin
    s_q <= {x_i[L-1], x_i, 1'b0} - (L + 2)'(y_i);
    t_q <= y_i;
  end

  // ---- compute q0 in units of 2^-(F + 1) and q1 in units of 2^-(F + 2) ----
  logic [F:0] fs;
  logic [F-1:0] ft, ft_q2;
  logic signed [IndexBits:0] i0_q2;
  logic signed [IndexBits-1:0] j0_q2;
  logic [F+1:0] q0_q;
  logic [F+2:0] q1_q;
  logic right_q;
  assign fs = s_q[F:0];
  assign ft = t_q[F-1:0];
  always_ff @(posedge clk_i) begin
    i0_q2 <= s_q[L+1:F+1];
    j0_q2 <= t_q[L-1:F];
    ft_q2 <= ft;
    q0_q <= (F + 2)'(fs) + (F + 2)'(ft);
    q1_q <= (F + 3)'(fs) + {1'b0, ft, 2'b0};
    right_q <= {ft, 1'b0} < fs;
  end

  // ---- find the corner whose cell contains the point ----
  logic near, far;
  logic di_q, dj_q;
  logic signed [IndexBits:0] i0_q3, i_q4, j_q4;
  logic signed [IndexBits-1:0] j0_q3;
  logic [F:0] q0_q3;
  logic [F-1:0] ft_q3;
  assign near = q0_q[F+1:F] == '0 && q1_q[F+2:F+1] == '0;
  assign far = q0_q[F+1] && q1_q[F+2];
  always_ff @(posedge clk_i) begin
    di_q <= !near && (far || right_q);
    dj_q <= !near && (far || !right_q);
    i0_q3 <= i0_q2;
    j0_q3 <= j0_q2;
    q0_q3 <= q0_q[F+1:1];  // drops the lowest bit of q0, which is always 0
    ft_q3 <= ft_q2;
  end
  logic unused_bit;
  assign unused_bit = q0_q[0] ^ (^q1_q[F:0]);

  // ---- measure the point from the lenslet's centre ----
  always_ff @(posedge clk_i) begin
    i_q4 <= i0_q3 + (IndexBits + 1)'($signed({1'b0, di_q}));
    j_q4 <= (IndexBits + 1)'(j0_q3) + (IndexBits + 1)'($signed({1'b0, dj_q}));
    x_o <= $signed({1'b0, q0_q3}) - $signed({1'b0, di_q, dj_q, {(F - 1){1'b0}}});
    y_o <= $signed({2'b0, ft_q3}) - $signed({1'b0, dj_q, {F{1'b0}}});
  end
  assign i_o = IndexBits'(i_q4);
  assign j_o = IndexBits'(j_q4);
  assign beyond_o = i_q4[IndexBits] != i_q4[IndexBits-1] || j_q4[IndexBits] != j_q4[IndexBits-1];

endmodule

`default_nettype wire
