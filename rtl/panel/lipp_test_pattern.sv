// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes a pixel of a test pattern from the pixel's column and row and from the optics.
///
/// The latency is pattern_latency(Grid) clocks. Inputs pattern_i and optics_i must not change
/// within a frame. PatternLens, PatternCentres and PatternViews are black where the array has no
/// lenslet. PatternOff and undefined pattern numbers give black.
///
///   PatternLens     white inside the cell of lenslet (i, j), black elsewhere.
///   PatternCentres  white in each pixel that contains a lenslet's centre, black elsewhere.
///   PatternViews    r and g are the pixel's position in its cell, rightward and upward; b = 0.
///   PatternChecker  white and black tiles of 32 x 32 pixels, of which the first is black.
///   PatternRamp     grey, with the value of the column modulo 256.
///
/// Let (x, y) be the pixel's centre relative to the centre of its lenslet, in units of the pitch
/// along the rows and of the row distance. The values r and g of PatternViews are
///
///   r = floor(256 (x + 1/2)),  g = floor(256 (s + 1/2)),  both clipped to 0 .. 255,
///
/// where s = y on a square grid. On a hexagonal grid s = y - floor(y/4): a cell is 4/3 rows high.
///
/// For PatternCentres, a pixel contains a lenslet's centre if the centre is at most 17/32 pixels
/// away in both directions. If the centre lies on a border between pixels, all pixels that share
/// the border contain the centre. The coefficients xu, xv, yu, yv of the affine map are truncated
/// to 19 fraction bits, and x and y to 17. The condition for PatternCentres is
///
///   |yv x - xv y| <= 17/32 det,  |xu y - yu x| <= 17/32 det,  det = xu yv - xv yu
///
/// where 17/32 det is computed as floor(det/2) + floor(det/32).
module lipp_test_pattern #(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int F = 23,
  parameter int Grid = lipp_optics_pkg::GridSquare
) (
  input  logic                                  clk_i,
  input  lipp_panel_pkg::pattern_t              pattern_i,
  input  lipp_optics_pkg::optics_config_t       optics_i,
  input  logic [lipp_optics_pkg::PanelBits-1:0] column_i,
  input  logic [lipp_optics_pkg::PanelBits-1:0] row_i,
  output logic [23:0]                           rgb_o
);
  import lipp_math_pkg::*;
  import lipp_optics_pkg::*;
  import lipp_panel_pkg::*;

  localparam int Latency = pattern_latency(Grid);
  localparam int MulLatency = mul_latency(MulBits, MulBits);
  localparam int SideBits = $clog2(Tile);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_test_pattern: Width and Height must be 1 to 16383");
  end

  logic unused_optics;  // optics fields that test patterns do not use
  assign unused_optics = ^optics_i;

  // ---- compute checker and ramp, delayed to match the other patterns ----
  logic check, check_late;
  logic [7:0] ramp_late;
  assign check = column_i[SideBits] ^ row_i[SideBits];
  lipp_delay #(.Width(9), .Cycles(Latency - 1)) i_plain (
    .clk_i, .d_i({check, column_i[7:0]}), .q_o({check_late, ramp_late})
  );

  // ---- find the lenslet of the pixel's centre ----
  logic signed [PixelBits-1:0] u_q, v_q;
  always_ff @(posedge clk_i) begin
    u_q <= {column_i, 4'd8} - PixelBits'(8 * Width);
    v_q <= PixelBits'(8 * Height) - {row_i, 4'd8};
  end

  logic signed [IndexBits+F-1:0] lattice_x, lattice_y;
  // overflow flags, which a test pattern does not need
  logic lattice_beyond, index_beyond, unused_beyond;
  assign unused_beyond = lattice_beyond ^ index_beyond;
  lipp_pixel_to_lattice #(.F(F)) i_pixel_to_lattice (
    .clk_i, .u_i(u_q), .v_i(v_q),
    .x_from_u_i(optics_i.x_from_u), .x_from_v_i(optics_i.x_from_v), .x_offset_i(optics_i.x_offset),
    .y_from_u_i(optics_i.y_from_u), .y_from_v_i(optics_i.y_from_v), .y_offset_i(optics_i.y_offset),
    .x_o(lattice_x), .y_o(lattice_y), .beyond_o(lattice_beyond)
  );

  logic signed [IndexBits-1:0] i, j;
  logic signed [F+1:0] x, y, side_y;
  if (Grid == GridHex) begin : gen_hex
    lipp_lenslet_hex #(.F(F)) i_lenslet (
      .clk_i, .x_i(lattice_x), .y_i(lattice_y), .i_o(i), .j_o(j), .x_o(x), .y_o(y),
      .beyond_o(index_beyond)
    );
    assign side_y = y - (y >>> 2);
  end else begin : gen_square
    lipp_lenslet_square #(.F(F)) i_lenslet (
      .clk_i, .x_i(lattice_x), .y_i(lattice_y), .i_o(i), .j_o(j), .x_o(x), .y_o(y),
      .beyond_o(index_beyond)
    );
    assign side_y = y;
  end

  logic missing, missing_late;
  lipp_extent #(.Grid(Grid)) i_extent (
    .clk_i, .i_i(i), .j_i(j), .along_i(optics_i.extent_i[IndexBits+1:0]),
    .across_i(optics_i.extent_j[IndexBits:0]), .missing_o(missing)
  );
  lipp_delay #(.Width(1), .Cycles(MulLatency + 2 - extent_latency())) i_missing (
    .clk_i, .d_i(missing), .q_o(missing_late)
  );

  // ---- compute PatternLens and PatternViews ----

  /// Return floor(256 (side + 1/2)), clipped to 0 .. 255.
  function automatic logic [7:0] place(logic signed [F+1:0] side);
    logic [F+1:0] from_edge;
    from_edge = side + {3'b001, {(F - 1){1'b0}}};
    return from_edge[F+1] ? 8'd0 : from_edge[F] ? 8'd255 : from_edge[F-1-:8];
  endfunction

  logic lens_q, lens_late;
  logic [15:0] view_q, view_late;
  always_ff @(posedge clk_i) begin
    lens_q <= i == pattern_i.i && j == pattern_i.j;
    view_q <= {place(x), place(side_y)};
  end
  lipp_delay #(.Width(17), .Cycles(MulLatency + 1)) i_lens (
    .clk_i, .d_i({lens_q, view_q}), .q_o({lens_late, view_late})
  );

  // ---- compute PatternCentres: the point in pixels, multiplied by the determinant ----
  logic signed [MulBits-1:0] xu, xv, yu, yv, near_x, near_y;
  assign xu = optics_i.x_from_u[SlopeBits-1-:MulBits];
  assign xv = optics_i.x_from_v[SlopeBits-1-:MulBits];
  assign yu = optics_i.y_from_u[SlopeBits-1-:MulBits];
  assign yv = optics_i.y_from_v[SlopeBits-1-:MulBits];
  if (F < MulBits) begin : gen_coarse
    assign near_x = MulBits'(x) <<< (MulBits - 1 - F);
    assign near_y = MulBits'(y) <<< (MulBits - 1 - F);
  end else begin : gen_fine
    assign near_x = MulBits'(x >>> (F - MulBits + 1));
    assign near_y = MulBits'(y >>> (F - MulBits + 1));
  end

  logic signed [2*MulBits-1:0] yv_x, xv_y, xu_y, yu_x, xu_yv, xv_yu;
  lipp_multiplier i_yv_x (.clk_i, .a_i(yv), .b_i(near_x), .p_o(yv_x));
  lipp_multiplier i_xv_y (.clk_i, .a_i(xv), .b_i(near_y), .p_o(xv_y));
  lipp_multiplier i_xu_y (.clk_i, .a_i(xu), .b_i(near_y), .p_o(xu_y));
  lipp_multiplier i_yu_x (.clk_i, .a_i(yu), .b_i(near_x), .p_o(yu_x));
  lipp_multiplier i_xu_yv (.clk_i, .a_i(xu), .b_i(yv), .p_o(xu_yv));
  lipp_multiplier i_xv_yu (.clk_i, .a_i(xv), .b_i(yu), .p_o(xv_yu));

  localparam int Wp = 2 * MulBits + 1;
  logic signed [Wp-1:0] u_det_q, v_det_q, det_q, limit_q;
  // negative: more than 17/32 pixels from the lenslet's centre
  logic signed [Wp:0] u_over, u_under, v_over, v_under;
  logic centre_q;
  assign u_over = (Wp + 1)'(limit_q) - (Wp + 1)'(u_det_q);
  assign u_under = (Wp + 1)'(limit_q) + (Wp + 1)'(u_det_q);
  assign v_over = (Wp + 1)'(limit_q) - (Wp + 1)'(v_det_q);
  assign v_under = (Wp + 1)'(limit_q) + (Wp + 1)'(v_det_q);
  always_ff @(posedge clk_i) begin
    det_q <= Wp'(xu_yv) - Wp'(xv_yu);          // determinant with 38 fraction bits
    limit_q <= (det_q >>> 3) + (det_q >>> 7);  // limit with 36 fraction bits, like the products
    u_det_q <= Wp'(yv_x) - Wp'(xv_y);
    v_det_q <= Wp'(xu_y) - Wp'(yu_x);
    centre_q <= !(u_over[Wp] || u_under[Wp] || v_over[Wp] || v_under[Wp]);
  end

  // ---- select the pattern ----
  always_ff @(posedge clk_i) begin
    unique case (pattern_i.kind)
      PatternLens: rgb_o <= {24{lens_late && !missing_late}};
      PatternCentres: rgb_o <= {24{centre_q && !missing_late}};
      PatternViews: rgb_o <= missing_late ? '0 : {view_late, 8'd0};
      PatternChecker: rgb_o <= {24{check_late}};
      PatternRamp: rgb_o <= {3{ramp_late}};
      default: rgb_o <= '0;
    endcase
  end

endmodule

`default_nettype wire
