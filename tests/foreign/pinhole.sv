// SPDX-License-Identifier: Apache-2.0
/// A small ray design that is not Lippmann's: chief rays of square lenslets without refraction, in fixed point of its own.
///
/// A pixel's place comes as u and v, 2^20 to a pixel. The lattice is an affine map of it, 2^60 to a pitch: the coefficients
/// of u and v have 2^40. Out come the lenslet and the ray's direction along the array's axes, 2^30 to 1, rounded down.
/// Latency: 3 clocks. A pixel goes in each clock.
module pinhole #(
  parameter int Places = 30  // binary places of the direction
) (
  input  logic                 clk_i,
  input  logic signed [39:0]   u_i,
  input  logic signed [39:0]   v_i,
  input  logic signed [79:0]   x_from_u_i,
  input  logic signed [79:0]   x_from_v_i,
  input  logic signed [79:0]   x_zero_i,    // 2^60 to a pitch
  input  logic signed [79:0]   y_from_u_i,
  input  logic signed [79:0]   y_from_v_i,
  input  logic signed [79:0]   y_zero_i,
  input  logic signed [63:0]   pitch_x_i,   // in units of the distance D, 2^40 to 1
  input  logic signed [63:0]   pitch_y_i,
  output logic signed [15:0]   i_o,
  output logic signed [15:0]   j_o,
  output logic signed [Places+1:0] dx_o,
  output logic signed [Places+1:0] dy_o,
  output logic signed [Places+1:0] dz_o
);

  localparam logic signed [127:0] Half = 128'sd1 <<< 59;
  typedef logic signed [127:0] wide_t;

  // ---- the lattice: the nearest centre, and the way from it ----
  wide_t x, y, at_x, at_y;
  logic signed [15:0] i, j, i_q, j_q, i_q2, j_q2;
  always_comb begin
    x = wide_t'(u_i) * wide_t'(x_from_u_i) + wide_t'(v_i) * wide_t'(x_from_v_i) + wide_t'(x_zero_i);
    y = wide_t'(u_i) * wide_t'(y_from_u_i) + wide_t'(v_i) * wide_t'(y_from_v_i) + wide_t'(y_zero_i);
    i = 16'((x + Half) >>> 60);
    j = 16'((y + Half) >>> 60);
    at_x = x - (wide_t'(i) <<< 60);
    at_y = y - (wide_t'(j) <<< 60);
  end

  // ---- slopes of the ray, 2^50 to 1 ----
  wide_t slope_x, slope_y, slope_x_q, slope_y_q, slope_x_q2, slope_y_q2;
  always_comb begin
    slope_x = -(at_x * wide_t'(pitch_x_i)) >>> 50;
    slope_y = -(at_y * wide_t'(pitch_y_i)) >>> 50;
  end

  // ---- the length of (slope, 1), 2^50 to 1 ----
  function automatic wide_t root_of(input wide_t square);
    wide_t rest, root;
    rest = square;
    root = '0;
    for (int k = 62; k >= 0; k--)
      if (rest >= ((root <<< 1) + (128'sd1 <<< k)) <<< k) begin
        rest -= ((root <<< 1) + (128'sd1 <<< k)) <<< k;
        root += 128'sd1 <<< k;
      end
    return root;
  endfunction
  wide_t length_q;

  always_ff @(posedge clk_i) begin
    {slope_x_q, slope_y_q, i_q, j_q} <= {slope_x, slope_y, i, j};
    {slope_x_q2, slope_y_q2, i_q2, j_q2} <= {slope_x_q, slope_y_q, i_q, j_q};
    length_q <= root_of(slope_x_q * slope_x_q + slope_y_q * slope_y_q + (128'sd1 <<< 100));
    dx_o <= (Places + 2)'((slope_x_q2 <<< Places) / length_q);
    dy_o <= (Places + 2)'((slope_y_q2 <<< Places) / length_q);
    dz_o <= (Places + 2)'((128'sd1 <<< (50 + Places)) / length_q);
    {i_o, j_o} <= {i_q2, j_q2};
  end

endmodule
