// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Composites layers from front to back in linear light, with a background behind the last layer.
///
/// P_k is the light of layer k, multiplied by its opacity A_k, and B_k is the brightness of layer
/// k, at most 256. C_k is the light of the layers in front of layer k. T_k is the transmittance of
/// the layers in front of layer k. A_k and T_k are in units of 2^-16, B_k is in units of 2^-8. With
/// C_0 = 0 and T_0 = 65536, the steps are
///
///   G_k     = (T_k B_k + 2^7) >> 8
///   C_(k+1) = C_k + ((P_k G_k + 2^15) >> 16)        for each of red, green and blue
///   T_(k+1) = T_k - ((T_k A_k + 2^15) >> 16)
///   light_o = min(C_n + ((background T_n + 2^15) >> 16), 65535), or 0 where draws_i is low.
///
/// The number of layers is n. Input P_k must be at most A_k; then C_k fits into 17 bits. The
/// latency is composite_latency(Layers) clocks.
///
/// Products with a brightness are made in logic, because a board with four layers and a bilinear
/// filter needs all multiplier cells for other products.
module lipp_composite #(
  parameter int Layers = 4
) (
  input  logic                                                  clk_i,
  input  logic [Layers-1:0][2:0][lipp_scene_pkg::LightBits-1:0] light_i,  // P_k; [2] red, [0] blue
  input  logic [Layers-1:0][lipp_scene_pkg::ShareBits-1:0]      opacity_i,
  input  logic                                                  draws_i,
  input  logic [Layers-1:0][lipp_scene_pkg::BrightnessBits-1:0] brightness_i,  // constant per frame
  input  logic [2:0][lipp_scene_pkg::LightBits-1:0]             background_i,  // constant per frame
  output logic [2:0][lipp_scene_pkg::LightBits-1:0]             light_o
);
  import lipp_math_pkg::*;
  import lipp_scene_pkg::*;

  localparam int CellLatency = cell_latency();
  localparam int GainLatency = small_latency();
  localparam int Step = CellLatency + 1;  // clocks from T_k to T_(k+1)
  localparam int Wc = LightBits + 1;
  localparam int Wp = 2 * MulBits;

  if (Layers < 1 || Layers > MostLayers) begin : gen_illegal
    $fatal(1, "lipp_composite: Layers must be 1 to 8");
  end
  // For k >= 1, T_k is valid Step (k - 1) + 1 clocks after the input. The loop generates at least
  // one layer, so that elaboration with an illegal number of layers reaches the error message.
  for (genvar k = 0; k < Layers || k == 0; k++) begin : gen_layer
    logic [ShareBits-1:0] transmittance_q;       // transmittance T_(k+1)
    // sum_q is C_(k+1), valid GainLatency clocks after T_(k+1), or one clock earlier for layer 0.
    logic [2:0][Wc-1:0] sum_q;
    logic [BrightnessBits-1:0] bright_q;
    logic [2:0][LightBits-1:0] light;
    localparam int GainAt = k == 0 ? 0 : Step * (k - 1) + 1 + GainLatency;
    always_ff @(posedge clk_i) begin
      bright_q <= brightness_i[k] > 9'd256 ? 9'd256 : brightness_i[k];
    end

    if (k == 0) begin : gen_front
      always_ff @(posedge clk_i) transmittance_q <= Whole - opacity_i[0];
    end else begin : gen_behind
      logic [ShareBits-1:0] ahead, opacity;
      logic signed [Wp-1:0] absorbed;
      logic [ShareBits:0] gain;  // brightness factor G_k
      logic [Wp-1:0] transmittance_d;
      assign ahead = gen_layer[k-1].transmittance_q;
      lipp_delay #(.Width(ShareBits), .Cycles(Step * (k - 1) + 1), .Block(1'b0)) i_opacity (
        .clk_i, .d_i(opacity_i[k]), .q_o(opacity)
      );
      lipp_mult18 i_lost (
        .clk_i, .a_i($signed({1'b0, ahead})), .b_i($signed({1'b0, opacity})), .p_o(absorbed)
      );
      lipp_small_product #(.Wa(ShareBits), .Drop(8)) i_gain (
        .clk_i, .a_i(ahead), .b_i(bright_q), .p_o(gain)
      );
      logic [ShareBits-1:0] ahead_late;
      lipp_delay #(.Width(ShareBits), .Cycles(CellLatency)) i_before (
        .clk_i, .d_i(ahead), .q_o(ahead_late)
      );
      // T - ((p + 2^15) >> 16) is computed as (2^16 T + 2^15 - 1 - p) >> 16, which saves an adder.
      assign transmittance_d = {3'd0, ahead_late, 16'h7FFF} - absorbed;
      always_ff @(posedge clk_i) transmittance_q <= transmittance_d[16+:ShareBits];
      logic unused_bits;
      assign unused_bits = ^{transmittance_d, gain[ShareBits]};
    end

    lipp_delay #(.Width(3 * LightBits), .Cycles(GainAt), .Block(1'b0)) i_light (
      .clk_i, .d_i(light_i[k]), .q_o(light)
    );
    for (genvar c = 0; c < 3; c++) begin : gen_channel
      if (k == 0) begin : gen_front
        // The gain of layer 0 is G_0 = 2^8 B_0, since T_0 = 2^16.
        logic [LightBits:0] part;
        lipp_small_product #(.Wa(LightBits), .Drop(8)) i_part (
          .clk_i, .a_i(light[c]), .b_i(bright_q), .p_o(part)
        );
        assign sum_q[c] = part;
      end else begin : gen_behind
        logic signed [Wp-1:0] part;
        logic [Wp-1:0] sum_d;
        logic [Wc-1:0] so_far;
        lipp_mult18 i_part (
          .clk_i, .a_i($signed({1'b0, gen_layer[k].gen_behind.gain[ShareBits-1:0]})),
          .b_i($signed({2'b00, light[c]})), .p_o(part)
        );
        // The sum of layer 0 is valid one clock earlier than the sums of other layers.
        lipp_delay #(.Width(Wc), .Cycles(k == 1 ? CellLatency + 1 : CellLatency)) i_so_far (
          .clk_i, .d_i(gen_layer[k-1].sum_q[c]), .q_o(so_far)
        );
        assign sum_d = {3'd0, so_far, 16'h8000} + part;
        always_ff @(posedge clk_i) sum_q[c] <= sum_d[16+:Wc];
        logic unused_sum;
        assign unused_sum = ^sum_d;
      end
    end
  end

  // ---- add the background light ----
  localparam int Last = Layers > 0 ? Layers - 1 : 0;
  logic draws;
  logic [2:0][Wc-1:0] pixel_sum_q;
  lipp_delay #(.Width(1), .Cycles(Step * Layers + 1), .Block(1'b0)) i_draws (
    .clk_i, .d_i(draws_i), .q_o(draws)
  );
  for (genvar c = 0; c < 3; c++) begin : gen_background
    logic [LightBits-1:0] back_q;
    logic signed [Wp-1:0] part;
    logic [Wc-1:0] so_far;
    logic [Wp-1:0] sum_d;
    always_ff @(posedge clk_i) back_q <= background_i[c];
    lipp_mult18 i_part (
      .clk_i, .a_i($signed({1'b0, gen_layer[Last].transmittance_q})),
      .b_i($signed({2'b00, back_q})), .p_o(part)
    );
    lipp_delay #(.Width(Wc), .Cycles(CellLatency - GainLatency + (Layers == 1 ? 1 : 0))) i_so_far (
      .clk_i, .d_i(gen_layer[Last].sum_q[c]), .q_o(so_far)
    );
    assign sum_d = {3'd0, so_far, 16'h8000} + part;
    always_ff @(posedge clk_i) begin
      pixel_sum_q[c] <= sum_d[16+:Wc];
      light_o[c] <= !draws ? '0 : pixel_sum_q[c][Wc-1] ? '1 : pixel_sum_q[c][LightBits-1:0];
    end
    logic unused_sum;
    assign unused_sum = ^sum_d;
  end

endmodule

`default_nettype wire
