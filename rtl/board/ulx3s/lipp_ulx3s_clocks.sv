// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Makes the clocks of the ULX3S with one PLL from the board's oscillator of 25 MHz.
///
/// The frequency of each output clock is the VCO's frequency divided by that output's divider. The
/// output whose divider is BackDiv is fed back to the PLL. Each pixel lasts one clock of output
/// system_clk_o. The Python program `tools.pll` finds the dividers.
///
/// Output lost_o rises two or three clocks of clk_i after the PLL loses a lock that lasted for 256
/// clocks or more. Output lost_o stays high until the FPGA is configured again. A stopped
/// oscillator is not detected, because lost_o needs clk_i.
///
///   VCO = 25 MHz / InputDiv * BackDiv
module lipp_ulx3s_clocks #(
  parameter int InputDiv = 1,
  parameter int BackDiv = 20,
  parameter int ShiftDiv = 4,
  parameter int SystemDiv = 20,
  parameter int MemoryDiv = 4
) (
  input  logic clk_i,
  output logic shift_clk_o,
  output logic system_clk_o,
  output logic memory_clk_o,
  output logic locked_o,
  output logic lost_o
);

  logic back;
  (* ICP_CURRENT = "12", LPF_RESISTOR = "8", MFG_ENABLE_FILTEROPAMP = "1", MFG_GMCREF_SEL = "2" *)
  EHXPLLL #(
    .FEEDBK_PATH("CLKOP"), .CLKI_DIV(InputDiv), .CLKFB_DIV(1),
    .CLKOP_ENABLE("ENABLED"), .CLKOP_DIV(BackDiv), .CLKOP_CPHASE(BackDiv - 1),
    .CLKOS_ENABLE("ENABLED"), .CLKOS_DIV(ShiftDiv), .CLKOS_CPHASE(ShiftDiv - 1),
    .CLKOS2_ENABLE("ENABLED"), .CLKOS2_DIV(SystemDiv), .CLKOS2_CPHASE(SystemDiv - 1),
    .CLKOS3_ENABLE("ENABLED"), .CLKOS3_DIV(MemoryDiv), .CLKOS3_CPHASE(MemoryDiv - 1)
  ) i_pll (
    .CLKI(clk_i), .CLKFB(back), .RST(1'b0), .STDBY(1'b0), .PHASESEL0(1'b0), .PHASESEL1(1'b0),
    .PHASEDIR(1'b0), .PHASESTEP(1'b0), .PHASELOADREG(1'b0), .PLLWAKESYNC(1'b0), .ENCLKOP(1'b0),
    .ENCLKOS(1'b0), .ENCLKOS2(1'b0), .ENCLKOS3(1'b0), .CLKOP(back), .CLKOS(shift_clk_o),
    .CLKOS2(system_clk_o), .CLKOS3(memory_clk_o), .LOCK(locked_o)
  );

  // These registers have no reset: the FPGA's configuration sets their initial values.
  /* verilator lint_off PROCASSINIT */
  (* async_reg = "true", keep = "true" *) logic [1:0] locked_q = '0;
  logic was_locked_q = 1'b0, lost_q = 1'b0;
  // counts clocks with lock, because the lock signal of a PLL may toggle at first
  logic [7:0] steady_q = '0;
  /* verilator lint_on PROCASSINIT */
  always_ff @(posedge clk_i) begin
    locked_q <= {locked_q[0], locked_o};
    steady_q <= locked_q[1] ? steady_q + 1'b1 : '0;
    was_locked_q <= was_locked_q || steady_q == '1;
    lost_q <= lost_q || (was_locked_q && !locked_q[1]);
  end
  assign lost_o = lost_q;

endmodule

`default_nettype wire
