// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// The ULX3S's clocks, all of one PLL, from its oscillator of 25 MHz.
///
///   VCO = 25 MHz / InputDiv * FeedbackDiv * (divider of the output that is fed back)
///
/// Feedback is that output: 0 shift, 1 system, 2 memory. Each output is VCO by its divider;
/// `lippmann.dev.pll` finds all of these. With PixelDiv = SystemDiv pixel_clk_o is system_clk_o.
///
/// lost_o is high from the first clock of clk_i on, two or three later, that finds the PLL not
/// locked after it was locked, until the FPGA is configured again.
module lipp_ulx3s_clocks #(
  parameter int InputDiv = 5,
  parameter int FeedbackDiv = 21,
  parameter int Feedback = 2,
  parameter int ShiftDiv = 5,
  parameter int SystemDiv = 25,
  parameter int MemoryDiv = 6,
  parameter int PixelDiv = 25
) (
  input  logic clk_i,
  output logic shift_clk_o,
  output logic system_clk_o,
  output logic memory_clk_o,
  output logic pixel_clk_o,
  output logic locked_o,
  output logic lost_o
);

  if (Feedback < 0 || Feedback > 2) begin : gen_illegal
    $fatal(1, "lipp_ulx3s_clocks: Feedback must be 0, 1 or 2");
  end

  // The output that is fed back is CLKOP, and shift takes its place.
  localparam int SwapDiv = Feedback == 1 ? SystemDiv : Feedback == 2 ? MemoryDiv : ShiftDiv;
  localparam int SecondDiv = Feedback == 1 ? ShiftDiv : SystemDiv;
  localparam int ThirdDiv = Feedback == 2 ? ShiftDiv : MemoryDiv;
  logic op, os, os2, os3;
  (* ICP_CURRENT = "12", LPF_RESISTOR = "8", MFG_ENABLE_FILTEROPAMP = "1", MFG_GMCREF_SEL = "2" *)
  EHXPLLL #(
    .FEEDBK_PATH("CLKOP"), .CLKI_DIV(InputDiv), .CLKFB_DIV(FeedbackDiv),
    .CLKOP_ENABLE("ENABLED"), .CLKOP_DIV(SwapDiv), .CLKOP_CPHASE(SwapDiv - 1),
    .CLKOS_ENABLE("ENABLED"), .CLKOS_DIV(SecondDiv), .CLKOS_CPHASE(SecondDiv - 1),
    .CLKOS2_ENABLE("ENABLED"), .CLKOS2_DIV(ThirdDiv), .CLKOS2_CPHASE(ThirdDiv - 1),
    .CLKOS3_ENABLE("ENABLED"), .CLKOS3_DIV(PixelDiv), .CLKOS3_CPHASE(PixelDiv - 1)
  ) i_pll (
    .CLKI(clk_i), .CLKFB(op), .RST(1'b0), .STDBY(1'b0), .PHASESEL0(1'b0), .PHASESEL1(1'b0),
    .PHASEDIR(1'b0), .PHASESTEP(1'b0), .PHASELOADREG(1'b0), .PLLWAKESYNC(1'b0), .ENCLKOP(1'b0),
    .ENCLKOS(1'b0), .ENCLKOS2(1'b0), .ENCLKOS3(1'b0), .CLKOP(op), .CLKOS(os), .CLKOS2(os2),
    .CLKOS3(os3), .LOCK(locked_o)
  );
  assign shift_clk_o = Feedback == 1 ? os : Feedback == 2 ? os2 : op;
  assign system_clk_o = Feedback == 1 ? op : os;
  assign memory_clk_o = Feedback == 2 ? op : os2;
  assign pixel_clk_o = PixelDiv == SystemDiv ? system_clk_o : os3;

  // No reset forgets it: it begins with the FPGA's configuration.
  (* async_reg = "true", keep = "true" *) logic [1:0] locked_q;
  logic seen_q, lost_q;
  initial {locked_q, seen_q, lost_q} = '0;
  always_ff @(posedge clk_i) begin
    locked_q <= {locked_q[0], locked_o};
    seen_q <= seen_q || locked_q[1];
    lost_q <= lost_q || (seen_q && !locked_q[1]);
  end
  assign lost_o = lost_q;

endmodule

`default_nettype wire
