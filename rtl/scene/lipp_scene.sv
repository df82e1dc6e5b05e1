// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Draws the scene, which is a stack of textured layers: exit rays enter and panel pixels leave,
/// one ray per clock, with a valid/ready handshake on both sides.
///
/// Rays arrive in the order of the panel's pixels, 2^samples_bits rays for each pixel. One pixel
/// leaves for each group of 2^samples_bits rays. The registers in use are a copy of config_i. Input
/// take_i requests a new copy, which is made when all rays inside have left as pixels. Until the
/// copy is made, busy_o is high and the input is closed, so a frame is drawn with one set of
/// registers. Reset also requests a copy.
///
/// Input write_i stores a byte in a texture slot, 0 to slots - 1. The bytes of a slot are the
/// texels row by row, then the palette (r, g, b, a of each entry). The four bytes of a palette
/// entry must come one after another, with no byte for another slot between them. Slot 15 is the
/// panel's curve. A byte can be written in every clock. A slot that is being drawn must not be
/// written; the module does not check this rule.
///
/// The modules in order are `lipp_exit_line`, `lipp_layer_coordinate` for each layer,
/// `lipp_texel_fetch`, `lipp_texel_blend` for each layer, `lipp_composite`, `lipp_sample_mean` and
/// `lipp_curve_table`. A ray whose status is neither ok nor crosstalk is black. The latency is
/// scene_latency(F, Scene) + 5 clocks if the output is always ready.
module lipp_scene #(
  parameter int F = 16,  // F, number of fraction bits of the optics
  parameter lipp_scene_pkg::scene_build_t Scene = lipp_scene_pkg::FourLayers
) (
  input  logic                                         clk_i,
  input  logic                                         rst_ni,

  input  lipp_scene_pkg::scene_config_t                config_i,  // registers to copy next
  input  logic                                         take_i,  // pulse: requests a copy
  output logic                                         busy_o,  // 1: a copy is pending
  output logic                                         idle_o,  // 1: no ray is inside

  input  logic                                         write_i,  // 1: write a byte of a slot
  input  logic [3:0]                                   write_slot_i,
  input  logic [19:0]                                  write_at_i,
  input  logic [7:0]                                   write_data_i,

  input  logic                                         exit_valid_i,
  output logic                                         exit_ready_o,
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] exit_i_i,  // lenslet i of the exit ray
  input  logic signed [lipp_optics_pkg::IndexBits-1:0] exit_j_i,
  input  logic signed [F+3:0]                          exit_x_i,
  input  logic signed [F+3:0]                          exit_y_i,
  input  logic signed [F+3:0]                          exit_z_i,
  input  logic signed [F+1:0]                          exit_dx_i,
  input  logic signed [F+1:0]                          exit_dy_i,
  input  logic signed [F+1:0]                          exit_dz_i,
  input  lipp_optics_pkg::ray_status_e                 exit_status_i,
  input  logic                                         exit_first_i,
  input  logic                                         exit_last_i,

  output logic                                         pixel_valid_o,
  input  logic                                         pixel_ready_i,
  output logic [23:0]                                  pixel_rgb_o,  // pixel {r, g, b}, three bytes
  output logic                                         pixel_first_o,
  output logic                                         pixel_last_o
);
  import lipp_optics_pkg::*;
  import lipp_scene_pkg::*;

  localparam scene_build_t Built = built(Scene);
  localparam int Layers = int'(Built.layers);
  localparam int Taps = taps(Built);
  localparam int SamplesBits = int'(Built.samples_bits);
  localparam int Latency = scene_latency(F, Built);
  localparam int Tail = mean_latency(SamplesBits) + curve_latency();  // latency after composite
  localparam int AddressBits = $clog2(Latency + 16);

  if (!legal(Scene)) begin : gen_illegal
    $fatal(1, "lipp_scene: Scene must have 1 to 8 layers, and sizes as in lipp_scene_pkg::legal");
  end

  // ---- copy the registers ----
  scene_config_t used;
  logic busy, hold, idle;
  lipp_config_bank #(.Width($bits(scene_config_t))) i_config_bank (
    .clk_i, .rst_ni, .config_i, .apply_i(take_i), .idle_i(idle), .busy_o(busy), .hold_o(hold),
    .config_o(used)
  );
  assign {busy_o, idle_o} = {busy, idle};
  logic unused_config;  // a build reads only some layers
  assign unused_config = ^used;

  // ---- register the exit ray ----
  logic signed [IndexBits-1:0] i_q, j_q;
  logic signed [F+3:0] x_q, y_q, z_q;
  logic signed [F+1:0] dx_q, dy_q, dz_q;
  ray_status_e status_q;
  logic valid_q, first_q, last_q;
  always_ff @(posedge clk_i) begin
    {i_q, j_q} <= {exit_i_i, exit_j_i};
    {x_q, y_q, z_q} <= {exit_x_i, exit_y_i, exit_z_i};
    {dx_q, dy_q, dz_q} <= {exit_dx_i, exit_dy_i, exit_dz_i};
    status_q <= exit_status_i;
    {first_q, last_q} <= {exit_first_i, exit_last_i};
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) valid_q <= 1'b0;
    else valid_q <= exit_valid_i && exit_ready_o;
  end

  // ---- compute the line of the exit ray ----
  logic signed [F+8:0] x, y;
  logic signed [F+3:0] slope_x, slope_y;
  logic draws;
  lipp_exit_line #(.F(F)) i_exit_line (
    .clk_i, .i_i(i_q), .j_i(j_q), .x_i(x_q), .y_i(y_q), .z_i(z_q), .dx_i(dx_q), .dy_i(dy_q),
    .dz_i(dz_q), .status_i(status_q), .xi_i(used.lattice_xi), .xj_i(used.lattice_xj),
    .yj_i(used.lattice_yj), .x_o(x), .y_o(y), .slope_x_o(slope_x), .slope_y_o(slope_y),
    .draws_o(draws)
  );

  // ---- read and blend the texels of each layer ----
  look_t [Layers-1:0] look;
  logic [Layers-1:0][CoordinateBits-1:0] s, t;
  logic [Layers-1:0] hidden;
  logic [Layers-1:0][Taps-1:0][EntryBits-1:0] colour;
  logic [Layers-1:0][Taps-1:0][ShareBits-1:0] weight;
  logic [Layers-1:0][2:0][LightBits-1:0] light;
  logic [Layers-1:0][ShareBits-1:0] opacity;
  logic [Layers-1:0][BrightnessBits-1:0] brightness;
  for (genvar k = 0; k < Layers; k++) begin : gen_layer
    layer_config_t layer;
    assign layer = used.layers[k];
    assign look[k] = layer.look;
    assign brightness[k] = layer.look.brightness;
    lipp_layer_coordinate #(.F(F), .Bilinear(Built.bilinear)) i_coordinate (
      .clk_i, .x_i(x), .y_i(y), .slope_x_i(slope_x), .slope_y_i(slope_y), .s0_i(layer.s0),
      .t0_i(layer.t0), .depth_i(layer.depth), .a_i(layer.a), .b_i(layer.b), .c_i(layer.c),
      .d_i(layer.d), .infinite_i(layer.look.infinite), .s_o(s[k]), .t_o(t[k]), .beyond_o(hidden[k])
    );
    lipp_texel_blend #(.Taps(Taps)) i_blend (
      .clk_i, .colour_i(colour[k]), .weight_i(weight[k]), .light_o(light[k]), .opacity_o(opacity[k])
    );
  end
  lipp_texel_fetch #(.Scene(Built)) i_fetch (
    .clk_i, .write_i, .write_slot_i, .write_at_i, .write_data_i, .look_i(look), .s_i(s), .t_i(t),
    .hidden_i(hidden), .colour_o(colour), .weight_o(weight)
  );

  // ---- compute the pixel ----
  logic valid, first, last, draws_late;
  logic [2:0][LightBits-1:0] ray_light;
  lipp_delay #(
    .Width(1), .Cycles(layer_latency(F) + fetch_latency() + texel_blend_latency()), .Block(1'b0)
  ) i_draws (.clk_i, .d_i(draws), .q_o(draws_late));
  lipp_composite #(.Layers(Layers)) i_composite (
    .clk_i, .light_i(light), .opacity_i(opacity), .draws_i(draws_late), .brightness_i(brightness),
    .background_i(used.background), .light_o(ray_light)
  );

  // This delay carries the marks of each ray. A reset does not clear the delay; the marks of the
  // discarded rays leave it before the next frame's first ray.
  logic pixel_ends, pixel_first, pixel_last, ends, out_first, out_last;
  logic [2:0][LightBits-1:0] pixel_light;
  logic [2:0][7:0] rgb;
  lipp_delay #(.Width(3), .Cycles(Latency - Tail), .Block(1'b0)) i_marks (
    .clk_i, .d_i({valid_q, first_q, last_q}), .q_o({valid, first, last})
  );
  lipp_sample_mean #(.SamplesBits(SamplesBits)) i_mean (
    .clk_i, .rst_ni, .valid_i(valid), .first_i(first), .last_i(last), .light_i(ray_light),
    .last_of_pixel_o(pixel_ends), .first_o(pixel_first), .last_o(pixel_last), .light_o(pixel_light)
  );
  logic curve_q;
  logic [CurveBits-1:0] curve_at_q;
  logic [7:0] curve_data_q;
  always_ff @(posedge clk_i) begin
    curve_q <= write_i && write_slot_i == 4'(CurveSlot) && write_at_i[19:CurveBits] == '0;
    curve_at_q <= write_at_i[CurveBits-1:0];
    curve_data_q <= write_data_i;
  end
  lipp_curve_table i_curve (
    .clk_i, .write_i(curve_q), .write_at_i(curve_at_q), .write_data_i(curve_data_q),
    .light_i(pixel_light), .rgb_o(rgb)
  );
  lipp_delay #(.Width(3), .Cycles(curve_latency())) i_ends (
    .clk_i, .d_i({pixel_ends, pixel_first, pixel_last}), .q_o({ends, out_first, out_last})
  );

  // ---- add the handshakes; the output FIFO drops rays that do not end a pixel ----
  logic out_valid, out_ends;
  lipp_flow_control #(.Latency(Latency + 1), .AddressBits(AddressBits), .Width(27)) i_flow (
    .clk_i, .rst_ni, .hold_i(hold), .idle_o(idle), .valid_i(exit_valid_i), .ready_o(exit_ready_o),
    .piped_i({ends, out_first, out_last, rgb}), .valid_o(out_valid),
    .ready_i(pixel_ready_i || !out_ends),
    .data_o({out_ends, pixel_first_o, pixel_last_o, pixel_rgb_o})
  );
  assign pixel_valid_o = out_valid && out_ends;

endmodule

`default_nettype wire
