// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Contains the scene's registers. The scene takes the registers' values between two frames.
///
/// Input take_i is high in the clock in which the scene takes the values. From a write until
/// take_i, the register field `status.waits` is 1. Output slots_o has a bit for each slot that is
/// shown or will be shown. A slot is shown if shown_i is high and a visible layer selects it in the
/// values taken last. A slot will be shown if source_o is high and a visible layer selects it in
/// the written registers. Bit 15 belongs to the panel's curve, which every scene needs.
///
/// The register port is APB4. A write changes the bytes whose strobe is set. An access to a layer
/// takes three clocks, because its word is selected in two steps: within each layer, then among
/// layers. The file rtl/registers.rdl defines the registers. A build has registers only for its own
/// layers.
module lipp_scene_block #(
  parameter lipp_scene_pkg::scene_build_t Scene = lipp_scene_pkg::FourLayers
) (
  input  logic                          clk_i,
  input  logic                          rst_ni,

  input  logic                          s_apb_psel,
  input  logic                          s_apb_penable,
  input  logic                          s_apb_pwrite,
  input  logic [2:0]                    s_apb_pprot,
  input  logic [9:0]                    s_apb_paddr,  // byte address of a register
  input  logic [31:0]                   s_apb_pwdata,
  input  logic [3:0]                    s_apb_pstrb,
  output logic                          s_apb_pready,
  output logic [31:0]                   s_apb_prdata,
  output logic                          s_apb_pslverr,  // error: illegal address or access

  output lipp_scene_pkg::scene_config_t config_o,  // registers as written
  output logic                          source_o,  // 1: software requests to show the scene
  input  logic                          take_i,
  input  logic                          shown_i,
  output logic [15:0]                   slots_o,
  input  logic                          drawn_i,   // pulse: a frame was drawn
  input  logic                          underflow_i
);
  import lipp_scene_pkg::*;

  localparam int Layers = int'(Scene.layers);
  localparam int Words = 8 * Layers;
  localparam logic [31:0] LookBits = 32'h0001_FFF3;

  if (!legal(Scene)) begin : gen_illegal
    $fatal(1, "lipp_scene_block: Scene must be a legal build");
  end

  // ---- decode addresses: common registers, layers, or neither ----
  logic common, layers, looked_q, there_q, other_q, layers_q, write, ready, error;
  logic [31:0] word;
  assign common = s_apb_paddr[9:6] == '0;
  assign layers = s_apb_paddr[9] && int'(s_apb_paddr[8:2]) < Words;

  lipp_scene_registers_pkg::scene_registers__in_t hwif_in;
  lipp_scene_registers_pkg::scene_registers__out_t hwif_out;
  lipp_scene_registers i_registers (
    .clk(clk_i), .arst_n(rst_ni),
    .s_apb_psel(s_apb_psel && common), .s_apb_penable, .s_apb_pwrite, .s_apb_pprot,
    .s_apb_paddr(s_apb_paddr[5:0]), .s_apb_pwdata, .s_apb_pstrb, .s_apb_pready(ready),
    .s_apb_prdata(word), .s_apb_pslverr(error), .hwif_in, .hwif_out
  );

  // ---- access the registers of the layers ----
  logic [Words-1:0][31:0] words_q;
  logic [Layers-1:0][31:0] own_word_q;
  logic [Layers-1:0] addressed_q;  // one-hot: the layer that the address selects
  logic [31:0] layer_word_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {looked_q, there_q, other_q, layers_q} <= '0;
      words_q <= '0;
    end else begin
      looked_q <= s_apb_psel && !s_apb_penable && !common;
      there_q <= s_apb_psel && !s_apb_penable && layers;
      {other_q, layers_q} <= {looked_q, there_q};
      for (int k = 0; k < Words; k++) begin
        for (int part = 0; part < 4; part++) begin
          if (write && int'(s_apb_paddr[8:2]) == k && s_apb_pstrb[part]) begin
            words_q[k][8*part+:8] <=
                s_apb_pwdata[8*part+:8] & (k % 8 == 7 ? LookBits[8*part+:8] : '1);
          end
        end
      end
    end
  end
  assign write = layers_q && s_apb_pwrite;
  logic [31:0] layer_word;
  always_comb begin
    layer_word = '0;
    for (int layer = 0; layer < Layers; layer++) begin
      layer_word |= own_word_q[layer] & {32{addressed_q[layer]}};
    end
  end
  always_ff @(posedge clk_i) begin
    layer_word_q <= layer_word;
    for (int layer = 0; layer < Layers; layer++) begin
      own_word_q[layer] <= words_q[8*layer+int'(s_apb_paddr[4:2])];
      addressed_q[layer] <= int'(s_apb_paddr[8:5]) == layer;
    end
  end
  assign s_apb_pready = ready || other_q;
  assign s_apb_prdata = other_q ? layer_word_q : word;
  assign s_apb_pslverr = (ready && error) || (other_q && !layers_q);

  // ---- collect the configuration as written ----
  always_comb begin
    config_o = '0;
    config_o.lattice_xi = hwif_out.lattice.xi.value.value;
    config_o.lattice_xj = hwif_out.lattice.xj.value.value;
    config_o.lattice_yj = hwif_out.lattice.yj.value.value;
    config_o.background = {
      hwif_out.background.red.value.value, hwif_out.background.green.value.value,
      hwif_out.background.blue.value.value
    };
    for (int layer = 0; layer < Layers; layer++) begin
      config_o.layers[layer] = '{
        s0: words_q[8*layer], t0: words_q[8*layer+1], depth: words_q[8*layer+2],
        a: words_q[8*layer+3], b: words_q[8*layer+4], c: words_q[8*layer+5],
        d: words_q[8*layer+6], look: words_q[8*layer+7]
      };
    end
  end
  assign source_o = hwif_out.source.scene.value;

  // ---- find the slots that must not be written ----
  logic [15:0] slots_d, slots_taken_q;
  always_comb begin
    slots_d = '0;
    for (int layer = 0; layer < Layers; layer++) begin
      if (config_o.layers[layer].look.visible) slots_d[config_o.layers[layer].look.slot] = 1'b1;
    end
    slots_d[CurveSlot] = 1'b1;
  end
  always_ff @(posedge clk_i) begin
    if (take_i) slots_taken_q <= slots_d;
    slots_o <= (source_o ? slots_d : '0) | (shown_i ? slots_taken_q : '0);
  end

  // ---- report the state in the register `status` ----
  logic waits_q, accessed;
  assign accessed = s_apb_psel && s_apb_penable && s_apb_pwrite && s_apb_pready;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) waits_q <= 1'b0;
    else waits_q <= (accessed && !s_apb_pslverr) || (waits_q && !take_i);
  end
  assign {
    hwif_in.build.samples_bits.next, hwif_in.build.bilinear.next, hwif_in.build.height.next,
    hwif_in.build.width_bits.next, hwif_in.build.slots.next, hwif_in.build.layers.next
  } = Scene;
  assign hwif_in.status.shown.next = shown_i;
  assign hwif_in.status.waits.next = waits_q;
  assign hwif_in.status.slots.next = slots_o;
  assign hwif_in.frames.count.incr = drawn_i;
  assign hwif_in.underflows.count.incr = underflow_i;

endmodule

`default_nettype wire
