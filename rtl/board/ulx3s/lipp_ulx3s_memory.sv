// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Connects the memory ports of the board to the pads of the ULX3S's SDRAM, with one register at
/// each pad in both directions.
///
/// With registers at the pads, `lipp_sdram_controller` needs PadClocks = 2. The SDRAM's clock is
/// clk_i inverted, so commands and data reach the SDRAM in the middle of its clock period.
///
/// Read data are captured four clocks after the READ command left the pads. Let T be the clock
/// period. Let d be the round-trip delay of output register, traces and input pad. The SDRAM's
/// clock is delayed by T / 2. With a CAS latency of 3, the read word is valid from 2.5 T + d + tAC
/// to 3.5 T + d + tOH. Grade -75 has tAC = 5.4 ns and tOH = 2.7 ns, so T / 2 - 2.7 ns <= d <= 1.5 T
/// - 5.4 ns. The permitted range of d is 1.3 to 6.6 ns at 125 MHz, 2.3 to 9.6 ns at 100 MHz.
module lipp_ulx3s_memory (
  input  logic        clk_i,
  input  logic        cke_i,
  input  logic        cs_ni,
  input  logic        ras_ni,
  input  logic        cas_ni,
  input  logic        we_ni,
  input  logic [1:0]  ba_i,
  input  logic [12:0] a_i,
  input  logic [1:0]  dqm_i,
  input  logic [15:0] dq_i,
  input  logic        dq_oe_i,
  output logic [15:0] dq_o,

  output logic        sdram_clk,
  output logic        sdram_cke,
  output logic        sdram_csn,
  output logic        sdram_rasn,
  output logic        sdram_casn,
  output logic        sdram_wen,
  output logic [1:0]  sdram_ba,
  output logic [12:0] sdram_a,
  output logic [1:0]  sdram_dqm,
  inout  wire  [15:0] sdram_d
);

  ODDRX1F i_clock (.SCLK(clk_i), .RST(1'b0), .D0(1'b0), .D1(1'b1), .Q(sdram_clk));

  // Before clk_i runs, the pad cells' initial values deselect the SDRAM and release its data pins.
  logic [5:0] high, high_pad;
  logic [15:0] low, low_pad;
  assign high = {cs_ni, ras_ni, cas_ni, we_ni, dqm_i};
  assign {sdram_csn, sdram_rasn, sdram_casn, sdram_wen, sdram_dqm} = high_pad;
  assign low = {cke_i, ba_i, a_i};
  assign {sdram_cke, sdram_ba, sdram_a} = low_pad;
  for (genvar k = 0; k < 6; k++) begin : gen_high
    OFS1P3BX i_out (.SCLK(clk_i), .SP(1'b1), .PD(1'b0), .D(high[k]), .Q(high_pad[k]));
  end
  for (genvar k = 0; k < 16; k++) begin : gen_low
    OFS1P3DX i_out (.SCLK(clk_i), .SP(1'b1), .CD(1'b0), .D(low[k]), .Q(low_pad[k]));
  end

  logic [15:0] data, released, pad;
  for (genvar k = 0; k < 16; k++) begin : gen_data
    OFS1P3DX i_out (.SCLK(clk_i), .SP(1'b1), .CD(1'b0), .D(dq_i[k]), .Q(data[k]));
    OFS1P3BX i_release (.SCLK(clk_i), .SP(1'b1), .PD(1'b0), .D(!dq_oe_i), .Q(released[k]));
    BB i_pad (.B(sdram_d[k]), .I(data[k]), .T(released[k]), .O(pad[k]));
    IFS1P3DX i_in (.SCLK(clk_i), .SP(1'b1), .CD(1'b0), .D(pad[k]), .Q(dq_o[k]));
  end

endmodule

`default_nettype wire
