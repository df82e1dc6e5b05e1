// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Blends the texels of a layer by their weights. The outputs are the opacity, and the linear light
/// multiplied by that opacity.
///
/// Let A be the opacity (0 to 256), r, g and b the colour bytes and w_n the weight (16 fraction
/// bits) of texel n. The results are
///
///   share_n = (w_n A + 2^7) >> 8        16 fraction bits
///   light_o = (sum over n of (share_n r^2 >> 8) + 2^7) >> 8,  g and b likewise
///   opacity_o = sum over n of share_n.
///
/// If the sum of the weights is at most 65536, the opacity is at most 65536 and the light is at
/// most 65025. With one tap (nearest texel), the weight is 65536 or 0. The latency is
/// texel_blend_latency() clocks.
module lipp_texel_blend #(
  parameter int Taps = 1  // number of filter taps, 1 or 4
) (
  input  logic                                                  clk_i,
  input  logic [Taps-1:0][lipp_scene_pkg::EntryBits-1:0]        colour_i,  // palette entry per tap
  input  logic [Taps-1:0][lipp_scene_pkg::ShareBits-1:0]        weight_i,
  output logic [2:0][lipp_scene_pkg::LightBits-1:0]             light_o,  // [2] red, [0] blue light
  output logic [lipp_scene_pkg::ShareBits-1:0]                  opacity_o
);
  import lipp_math_pkg::*;
  import lipp_scene_pkg::*;

  if (Taps != 1 && Taps != 4) begin : gen_illegal
    $fatal(1, "lipp_texel_blend: Taps must be 1 or 4");
  end

  // ---- compute share_n and the squared colours, then their products ----
  localparam int Wp = LightBits + 8;  // width of a product and of the sum
  logic [Taps-1:0][ShareBits-1:0] share;
  logic [2:0][Taps-1:0][Wp-1:0] product;
  for (genvar n = 0; n < Taps; n++) begin : gen_tap
    logic [8:0] opacity;
    assign opacity = colour_i[n][EntryBits-1:24];
    if (Taps == 1) begin : gen_whole
      logic [8:0] opacity_q, opacity_q2;
      always_ff @(posedge clk_i) begin
        opacity_q <= weight_i[n][ShareBits-1] ? opacity : '0;
        opacity_q2 <= opacity_q;
      end
      assign share[n] = {opacity_q2, 8'd0};
      logic unused_weight;
      assign unused_weight = ^weight_i[n];
    end else begin : gen_part
      logic [ShareBits:0] part;
      lipp_small_product #(.Wa(ShareBits), .Drop(8)) i_share (
        .clk_i, .a_i(weight_i[n]), .b_i(opacity), .p_o(part)
      );
      assign share[n] = part[ShareBits-1:0];
      logic unused_part;
      assign unused_part = part[ShareBits];
    end

    for (genvar c = 0; c < 3; c++) begin : gen_channel
      // The order of channels is reversed: red is the lowest byte of colour_i, but the top part of
      // light_o.
      logic [LightBits-1:0] square;
      logic signed [2*MulBits-1:0] full_product;
      lipp_byte_square i_square (
        .clk_i, .value_i(colour_i[n][8*(2-c)+:8]), .square_o(square)
      );
      lipp_mult18 i_product (
        .clk_i, .a_i($signed({1'b0, share[n]})), .b_i($signed({2'b00, square})), .p_o(full_product)
      );
      assign product[c][n] = full_product[8+:Wp];
      logic unused_bits_of_product;
      assign unused_bits_of_product = ^full_product;
    end
  end

  // ---- add the products of all taps ----
  logic [ShareBits-1:0] opacity;
  for (genvar c = 0; c < 3; c++) begin : gen_light
    logic [Wp-1:0] first_q, second_q, sum;
    always_ff @(posedge clk_i) light_o[c] <= sum[Wp-1:8];
    assign sum = first_q + second_q;
    if (Taps == 1) begin : gen_one
      assign second_q = Wp'(128);
      always_ff @(posedge clk_i) first_q <= product[c][0];
    end else begin : gen_four
      // Module lipp_gated_sum keeps synthesis from merging this sum into an adder of three words.
      logic [Wp-1:0] third, pair;
      assign third = product[c][3] + Wp'(128);
      lipp_gated_sum #(.W(Wp)) i_pair (
        .a_i(product[c][2]), .x_i('1), .b_i(third), .y_i('1), .s_o(pair)
      );
      always_ff @(posedge clk_i) begin
        first_q <= product[c][0] + product[c][1];
        second_q <= pair;
      end
    end
    logic unused_sum;
    assign unused_sum = ^sum;
  end
  if (Taps == 1) begin : gen_one
    assign opacity = share[0];
    lipp_delay #(.Width(ShareBits), .Cycles(cell_latency() + 2)) i_opacity (
      .clk_i, .d_i(opacity), .q_o(opacity_o)
    );
  end else begin : gen_four
    logic [ShareBits-1:0] even_q, odd_q, opacity_q;
    always_ff @(posedge clk_i) begin
      even_q <= share[0] + share[1];
      odd_q <= share[2] + share[3];
      opacity_q <= even_q + odd_q;
    end
    assign opacity = opacity_q;
    lipp_delay #(.Width(ShareBits), .Cycles(cell_latency())) i_opacity (
      .clk_i, .d_i(opacity), .q_o(opacity_o)
    );
  end

endmodule

`default_nettype wire
