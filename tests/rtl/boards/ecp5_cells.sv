// SPDX-License-Identifier: Apache-2.0
`default_nettype none

// ECP5's cells of a board's pins and clocks, after the library's description of them.

/// CLKI is the VCO here: main.cpp drives it. Outputs rise together, and divide both edges of it.
module EHXPLLL #(
  parameter FEEDBK_PATH = "CLKOP",
  parameter CLKI_DIV = 1, CLKFB_DIV = 1,
  parameter CLKOP_ENABLE = "ENABLED", CLKOS_ENABLE = "DISABLED", CLKOS2_ENABLE = "DISABLED",
  parameter CLKOS3_ENABLE = "DISABLED",
  parameter int CLKOP_DIV = 8, CLKOS_DIV = 8, CLKOS2_DIV = 8, CLKOS3_DIV = 8,
  parameter int CLKOP_CPHASE = 0, CLKOS_CPHASE = 0, CLKOS2_CPHASE = 0, CLKOS3_CPHASE = 0
) (
  input  logic CLKI, CLKFB, RST, STDBY, PHASESEL0, PHASESEL1, PHASEDIR, PHASESTEP, PHASELOADREG,
    PLLWAKESYNC, ENCLKOP, ENCLKOS, ENCLKOS2, ENCLKOS3,
  output logic CLKOP, CLKOS, CLKOS2, CLKOS3,
  output logic LOCK
);
  localparam real Vco = 25.0 / CLKI_DIV * CLKFB_DIV * CLKOP_DIV;
  if (Vco < 400.0 || Vco > 800.0 || 25.0 / CLKI_DIV < 10.0) begin : gen_illegal
    $fatal(1, "EHXPLLL: out of the data sheet's limits");
  end
  logic lock /* verilator public_flat_rw */;
  initial LOCK = 1'b1;  // a reset begins with its edge, before the first rising one of CLKI
  always @(CLKI) LOCK <= lock;
  localparam int Div[4] = '{CLKOP_DIV, CLKOS_DIV, CLKOS2_DIV, CLKOS3_DIV};
  logic [3:0] out = '0;
  int left[4] = '{3, 3, 3, 3};  // LOCK falls before they begin
  assign {CLKOS3, CLKOS2, CLKOS, CLKOP} = out;
  always @(CLKI) begin
    for (int k = 0; k < 4; k++) begin
      if (left[k] == 1) begin
        left[k] <= Div[k];
        out[k] <= !out[k];
      end else left[k] <= left[k] - 1;
    end
  end
endmodule

/// D0 and D1 are taken with a rising edge; D0 is sent while the clock is high, then D1.
module ODDRX1F (input logic SCLK, RST, D0, D1, output logic Q);
  logic first, second, second_low;
  always_ff @(posedge SCLK) {first, second} <= {D0, D1};
  always_ff @(negedge SCLK) second_low <= second;
  assign Q = SCLK ? first : second_low;
endmodule

module OFS1P3BX (input logic SCLK, SP, PD, D, output logic Q = 1'b1);
  always_ff @(posedge SCLK or posedge PD) if (PD) Q <= 1'b1; else if (SP) Q <= D;
endmodule

module OFS1P3DX (input logic SCLK, SP, CD, D, output logic Q = 1'b0);
  always_ff @(posedge SCLK or posedge CD) if (CD) Q <= 1'b0; else if (SP) Q <= D;
endmodule

module IFS1P3DX (input logic SCLK, SP, CD, D, output logic Q = 1'b0);
  always_ff @(posedge SCLK or posedge CD) if (CD) Q <= 1'b0; else if (SP) Q <= D;
endmodule

module BB (input logic I, T, output logic O, inout wire B);
  assign B = T ? 1'bz : I;
  assign O = B;
endmodule

`default_nettype wire
