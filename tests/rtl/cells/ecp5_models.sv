/// The carry cell of ECP5 as its data sheet tells of it, for the use that rtl/ecp5 makes of it.
///
/// Written apart from the modules under test: what they do not use is refused.

/* verilator lint_off UNUSEDSIGNAL */

/// Two bits of a carry chain. Each has a table of four inputs, whose output is added to the carry; where it is 0, the
/// table's entry of A and B alone (C and D low) is the carry that follows, otherwise the carry passes.
module CCU2C #(
  parameter [15:0] INIT0 = 16'h0000,
  parameter [15:0] INIT1 = 16'h0000,
  parameter INJECT1_0 = "YES",
  parameter INJECT1_1 = "YES"
) (
  input CIN, A0, B0, C0, D0, A1, B1, C1, D1,
  output S0, S1, COUT
);

  logic adds_0, adds_1, middle;
  initial begin
    if (INJECT1_0 != "NO" || INJECT1_1 != "NO") $fatal(1, "CCU2C: not modelled");
  end
  assign adds_0 = INIT0[{D0, C0, B0, A0}];
  assign adds_1 = INIT1[{D1, C1, B1, A1}];
  assign middle = adds_0 ? CIN : INIT0[{2'b00, B0, A0}];
  assign COUT = adds_1 ? middle : INIT1[{2'b00, B1, A1}];
  assign S0 = adds_0 ^ CIN;
  assign S1 = adds_1 ^ middle;

endmodule
