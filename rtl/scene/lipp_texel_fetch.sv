// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reads the texels at each layer's texture coordinate, and computes the texels' filter weights.
///
/// A slot is a texture memory with one read port per filter tap. Each visible layer selects a slot
/// by the slot's number (look_i). If several visible layers select the same slot, only the layer
/// with the lowest index reads the slot, and the other layers are transparent. A crossbar connects
/// each layer's address to its slot, and the slot's colours back to the layer.
///
/// The coordinates s_i and t_i have 8 fraction bits. The integer parts of s_i and t_i are i = s_i
/// >> 8 and j = t_i >> 8. The fractions are f = s_i & 255 and g = t_i & 255. Weights have 16
/// fraction bits, so 65536 is a weight of 1. The texels and their weights are
///
///   nearest filter (one tap):    texel (i, j), weight 65536
///   bilinear filter (four taps): texel (i,     j)      weight (256 - f) (256 - g)
///                                texel (i + 1, j)      weight  f        (256 - g)
///                                texel (i,     j + 1)  weight (256 - f)  g
///                                texel (i + 1, j + 1)  weight  f         g.
///
/// Tap n = {row[0], column[0]} reads the texel whose row and column have the lowest bits row[0] and
/// column[0]. Therefore the four taps always read four different memories.
///
/// Output colour_o is {A, b, g, r} of a palette entry. The opacity byte a is widened to A = a + 1
/// for a >= 128 and A = a otherwise, so 256 is opaque. The bytes of an entry are written
/// consecutively.
///
/// The weight is 0 for texels outside the texture, for a layer whose hidden_i is high, and for a
/// layer that reads no slot. The colour of a texel with weight 0 is undefined. The latency is
/// fetch_latency() clocks.
module lipp_texel_fetch #(
  parameter lipp_scene_pkg::scene_build_t Scene = lipp_scene_pkg::FourLayers,
  localparam lipp_scene_pkg::scene_build_t Built = lipp_scene_pkg::built(Scene),
  localparam int Layers = int'(Built.layers),
  localparam int Taps = lipp_scene_pkg::taps(Built)
) (
  input  logic                                         clk_i,

  input  logic                                         write_i,  // 1: write a byte of a slot
  input  logic [3:0]                                   write_slot_i,
  input  logic [19:0]                                  write_at_i,
  input  logic [7:0]                                   write_data_i,

  input  lipp_scene_pkg::look_t [Layers-1:0]           look_i,
  input  logic [Layers-1:0][lipp_scene_pkg::CoordinateBits-1:0] s_i,  // coordinate s, 2^-8 texels
  input  logic [Layers-1:0][lipp_scene_pkg::CoordinateBits-1:0] t_i,
  input  logic [Layers-1:0]                            hidden_i,
  output logic [Layers-1:0][Taps-1:0][lipp_scene_pkg::EntryBits-1:0] colour_o,  // palette entry
  output logic [Layers-1:0][Taps-1:0][lipp_scene_pkg::ShareBits-1:0] weight_o  // in 2^-16
);
  import lipp_math_pkg::*;
  import lipp_scene_pkg::*;

  localparam int Slots = int'(Built.slots);
  localparam int WidthBits = int'(Built.width_bits);
  localparam int Height = int'(Built.height);
  localparam int AddressBits = $clog2(texels(Built) / Taps);
  localparam int WholeBits = CoordinateBits - CoordinateFraction;
  localparam int Latency = fetch_latency();

  if (!legal(Scene)) begin : gen_illegal
    $fatal(1, "lipp_texel_fetch: Scene is not legal");
  end

  // ---- select the slot of each layer, [layer][slot]; constant while rays are inside ----
  logic [Layers-1:0][Slots-1:0] selects_d, selects_q, owns_d, owns_q;
  logic [Layers-1:0] owns_any_q;
  always_comb begin
    for (int k = 0; k < Layers; k++) begin
      for (int m = 0; m < Slots; m++) begin
        selects_d[k][m] = look_i[k].visible && look_i[k].slot == 4'(m);
        owns_d[k][m] = selects_q[k][m];
        for (int front = 0; front < k; front++) if (selects_q[front][m]) owns_d[k][m] = 1'b0;
      end
    end
  end
  always_ff @(posedge clk_i) begin
    selects_q <= selects_d;
    owns_q <= owns_d;
    for (int k = 0; k < Layers; k++) owns_any_q[k] <= owns_q[k] != '0;
  end
  logic unused_look;
  assign unused_look = ^look_i;

  // ---- compute addresses and weights ----
  logic [Layers-1:0][Taps-1:0][AddressBits-1:0] at_q;
  for (genvar k = 0; k < Layers; k++) begin : gen_layer
    logic signed [WholeBits-1:0] column, row;
    assign column = $signed(s_i[k][CoordinateBits-1:CoordinateFraction]);
    assign row = $signed(t_i[k][CoordinateBits-1:CoordinateFraction]);

    if (Taps == 1) begin : gen_nearest
      logic [WholeBits-1:0] column_q, row_q;
      logic hidden_q, inside_q, in_texture;
      always_ff @(posedge clk_i) begin
        column_q <= column;
        row_q <= row;
        hidden_q <= hidden_i[k];
        // Compared as unsigned, a negative coordinate is also outside the texture.
        inside_q <= !hidden_q && column_q[WholeBits-1:WidthBits] == '0
            && row_q < WholeBits'(Height);
        at_q[k] <= AddressBits'({row_q, column_q[WidthBits-1:0]});
      end
      lipp_delay #(.Width(1), .Cycles(Latency - 3)) i_inside (
        .clk_i, .d_i(inside_q && owns_any_q[k]), .q_o(in_texture)
      );
      always_ff @(posedge clk_i) weight_o[k] <= in_texture ? Whole : '0;
      logic unused_fraction;
      assign unused_fraction = ^{
        s_i[k][CoordinateFraction-1:0], t_i[k][CoordinateFraction-1:0], row_q[WholeBits-1]
      };
    end else begin : gen_bilinear
      // The taps read two columns and two rows. Element [0] is half the even column (or row), and
      // element [1] is half the odd column (or row), rounded down.
      logic [1:0][WholeBits-2:0] column_q, row_q;
      logic [1:0] column_in_q, row_in_q, column_in, row_in;
      logic [CoordinateFraction:0] f_q, g_q, f_late, g_late;
      logic hidden_q;
      always_ff @(posedge clk_i) begin
        column_q[0] <= (WholeBits - 1)'((column + WholeBits'(1)) >>> 1);
        column_q[1] <= (WholeBits - 1)'(column >>> 1);
        row_q[0] <= (WholeBits - 1)'((row + WholeBits'(1)) >>> 1);
        row_q[1] <= (WholeBits - 1)'(row >>> 1);
        hidden_q <= hidden_i[k];
        // f_q, g_q: weights of even column and row; f_q is f if column i + 1 is even, else 256 - f.
        f_q <= column[0] ? {1'b0, s_i[k][7:0]} : 9'd256 - {1'b0, s_i[k][7:0]};
        g_q <= row[0] ? {1'b0, t_i[k][7:0]} : 9'd256 - {1'b0, t_i[k][7:0]};
        for (int n = 0; n < 2; n++) begin
          column_in_q[n] <= !hidden_q && column_q[n][WholeBits-2:WidthBits-1] == '0;
          row_in_q[n] <= row_q[n] < (WholeBits - 1)'(Height / 2);
        end
        for (int n = 0; n < 4; n++) begin
          at_q[k][n] <= AddressBits'({row_q[n/2], column_q[n%2][WidthBits-2:0]});
        end
      end

      // A product f_q g_q and three subtractions give the weights. Invalid weights are set to 0.
      localparam int ProductLatency = small_latency();
      localparam int Weights = Latency - ProductLatency - 2;  // clock in which the product starts
      logic [17:0] product;
      logic [1:0] column_shown, row_shown;
      logic [8:0] f_later, g_later;
      logic [3:0][ShareBits-1:0] weight_q;
      lipp_delay #(.Width(18), .Cycles(Weights - 1)) i_fractions (
        .clk_i, .d_i({f_q, g_q}), .q_o({f_late, g_late})
      );
      lipp_small_product #(.Wa(9)) i_product (
        .clk_i, .a_i(f_late), .b_i(g_late), .p_o(product)
      );
      lipp_delay #(.Width(18), .Cycles(ProductLatency)) i_later (
        .clk_i, .d_i({f_late, g_late}), .q_o({f_later, g_later})
      );
      assign {column_in, row_in} = {column_in_q & {2{owns_any_q[k]}}, row_in_q};
      lipp_delay #(.Width(4), .Cycles(Latency - 3)) i_inside (
        .clk_i, .d_i({column_in, row_in}), .q_o({column_shown, row_shown})
      );
      always_ff @(posedge clk_i) begin
        weight_q[0] <= product[ShareBits-1:0];
        weight_q[1] <= {g_later, 8'd0} - product[ShareBits-1:0];
        weight_q[2] <= {f_later, 8'd0} - product[ShareBits-1:0];
        weight_q[3] <= (Whole - {f_later, 8'd0}) - ({g_later, 8'd0} - product[ShareBits-1:0]);
        for (int n = 0; n < 4; n++) begin
          weight_o[k][n] <= column_shown[n%2] && row_shown[n/2] ? weight_q[n] : '0;
        end
      end
      logic unused_product;
      assign unused_product = ^product;
    end
  end

  // ---- read and write the slots ----
  logic [Slots-1:0][Taps-1:0][AddressBits-1:0] slot_at_d, slot_at_q;
  logic [Slots-1:0][Taps-1:0][EntryBits-1:0] slot_colour;
  logic [Layers-1:0][Taps-1:0][EntryBits-1:0] colour_d;
  logic write_q;
  logic [3:0] write_slot_q;
  logic [19:0] write_at_q;
  logic [7:0] write_data_q;
  logic [2:0][7:0] bytes_q;  // the three bytes written before write_data_q
  logic [EntryBits-1:0] entry;
  assign entry = {9'(write_data_q) + 9'(write_data_q[7]), bytes_q};
  always_comb begin
    slot_at_d = '0;
    colour_d = '0;
    for (int m = 0; m < Slots; m++) begin
      for (int k = 0; k < Layers; k++) begin
        if (owns_q[k][m]) begin
          slot_at_d[m] |= at_q[k];
          colour_d[k] |= slot_colour[m];
        end
      end
    end
  end
  always_ff @(posedge clk_i) begin
    slot_at_q <= slot_at_d;
    colour_o <= colour_d;
    write_q <= write_i;
    write_slot_q <= write_slot_i;
    write_at_q <= write_at_i;
    write_data_q <= write_data_i;
    if (write_q) bytes_q <= {write_data_q, bytes_q[2:1]};
  end
  for (genvar m = 0; m < Slots; m++) begin : gen_slot
    lipp_texel_slot #(.Scene(Built)) i_slot (
      .clk_i, .write_i(write_q && write_slot_q == 4'(m)), .write_at_i(write_at_q),
      .write_data_i(write_data_q), .entry_i(entry), .read_at_i(slot_at_q[m]),
      .colour_o(slot_colour[m])
    );
  end

endmodule

`default_nettype wire
