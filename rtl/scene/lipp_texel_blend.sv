// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Blends the texels of a layer by their weights: linear light, premultiplied by the opacity, and opacity.
///
/// With the bytes r, g, b, a of texel n and its weight w_n (65536: the whole):
///
///   share_n = (w_n (a + [a >= 128]) + 2^7) >> 8        16 fraction bits
///   light_o = (sum over n of (share_n r^2 >> 8) + 2^7) >> 8,  g and b likewise
///   opacity_o = sum over n of share_n
///
/// Weights whose sum is at most 65536 keep the opacity at 65536 or below, and the light at 65025. With one tap a
/// weight is 65536 or 0. Latency texel_blend_latency(Taps).
module lipp_texel_blend #(
  parameter int Taps = 1  // 1 or 4
) (
  input  logic                                                  clk_i,
  input  logic [Taps-1:0][31:0]                                 colour_i,  // {a, b, g, r}
  input  logic [Taps-1:0][lipp_scene_pkg::ShareBits-1:0]        weight_i,
  output logic [2:0][lipp_scene_pkg::LightBits-1:0]             light_o,  // [2] red, [0] blue
  output logic [lipp_scene_pkg::ShareBits-1:0]                  opacity_o
);
  import lipp_math_pkg::*;
  import lipp_scene_pkg::*;

  localparam int SquareLatency = low_latency(8);
  localparam int SharesLatency = shares_latency(Taps);
  localparam int CellLatency = mul_latency(MulBits, MulBits);

  if (Taps != 1 && Taps != 4) begin : gen_illegal
    $fatal(1, "lipp_texel_blend: Taps must be 1 or 4");
  end

  // ---- shares and squares, then their products ----
  localparam int Wp = 2 * MulBits - 8;
  logic [Taps-1:0][ShareBits-1:0] share;
  logic [2:0][Taps-1:0][Wp-1:0] product;
  for (genvar n = 0; n < Taps; n++) begin : gen_tap
    logic [7:0] alpha;
    assign alpha = colour_i[n][31:24];
    if (Taps == 1) begin : gen_whole
      logic [8:0] opacity_q;
      always_ff @(posedge clk_i) begin
        opacity_q <= weight_i[n][ShareBits-1] ? 9'(alpha) + 9'(alpha[7]) : '0;
      end
      lipp_delay #(.Width(ShareBits), .Cycles(SharesLatency - 1)) i_share (
        .clk_i, .d_i({opacity_q, 8'd0}), .q_o(share[n])
      );
      logic unused_weight;
      assign unused_weight = ^weight_i[n];
    end else begin : gen_part
      logic [8:0] opacity_q;
      logic [ShareBits-1:0] weight_q, share_q;
      logic signed [MulBits+8:0] whole;
      always_ff @(posedge clk_i) begin
        opacity_q <= 9'(alpha) + 9'(alpha[7]);
        weight_q <= weight_i[n];
        share_q <= ShareBits'((whole + (MulBits + 9)'(128)) >>> 8);
      end
      lipp_low_product #(.Low(9)) i_share (
        .clk_i, .a_i($signed({1'b0, weight_q})), .low_i(opacity_q), .p_o(whole)
      );
      assign share[n] = share_q;
    end

    for (genvar c = 0; c < 3; c++) begin : gen_channel
      // Red is the lowest byte, and light_o's highest part.
      logic [7:0] value;
      logic signed [MulBits+7:0] square;
      logic [LightBits-1:0] light;
      logic signed [MulBits-1:0] light_word;
      assign value = colour_i[n][8*(2-c)+:8];
      lipp_low_product #(.Low(8)) i_square (
        .clk_i, .a_i($signed(18'(value))), .low_i(value), .p_o(square)
      );
      lipp_delay #(.Width(LightBits), .Cycles(SharesLatency - SquareLatency)) i_light (
        .clk_i, .d_i(square[LightBits-1:0]), .q_o(light)
      );
      assign light_word = $signed({2'b00, light});
      lipp_multiplier #(.Wa(MulBits), .Wb(MulBits), .Drop(8)) i_product (
        .clk_i, .a_i($signed({1'b0, share[n]})), .b_i(light_word), .p_o(product[c][n])
      );
      logic unused_square;
      assign unused_square = ^square[MulBits+7:LightBits];
    end
  end

  // ---- sums ----
  logic [ShareBits-1:0] opacity;
  for (genvar c = 0; c < 3; c++) begin : gen_light
    logic [Wp-1:0] first_q, second_q, sum;
    always_ff @(posedge clk_i) light_o[c] <= sum[LightBits+7:8];
    assign sum = first_q + second_q;
    if (Taps == 1) begin : gen_one
      assign second_q = Wp'(128);
      always_ff @(posedge clk_i) first_q <= product[c][0];
    end else begin : gen_four
      always_ff @(posedge clk_i) begin
        first_q <= product[c][0] + product[c][1];
        second_q <= product[c][2] + (product[c][3] + Wp'(128));
      end
    end
    logic unused_sum;
    assign unused_sum = ^sum;
  end
  if (Taps == 1) begin : gen_one
    assign opacity = share[0];
    lipp_delay #(.Width(ShareBits), .Cycles(CellLatency + 2)) i_opacity (
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
    lipp_delay #(.Width(ShareBits), .Cycles(CellLatency)) i_opacity (
      .clk_i, .d_i(opacity), .q_o(opacity_o)
    );
  end

endmodule

`default_nettype wire
