/// Products as they are simulated and as they are placed: `--engine rtl` simulates `lipp_multiplier`
/// with CrossCells, an ECP5 gets `ecp5_multiplier` (the same in ECP5's cells), mostly without. All
/// pairs of widths; the three must agree in each clock.
module products #(
  parameter int Clocks = 8000
) (
  input logic clk_i
);

  localparam int Count = 11;
  localparam int Widths[Count] = '{12, 18, 19, 20, 22, 24, 25, 26, 27, 28, 31};
  int clock_q = 0;
  for (genvar j = 0; j < Count; j++) begin : gen_a
    for (genvar k = 0; k <= Count; k++) begin : gen_b
      // The last one squares.
      localparam int Wa = Widths[j], Wb = k == Count ? Wa : Widths[k % Count];
      localparam int Low = lipp_math_pkg::low_bits(Wa) + lipp_math_pkg::low_bits(Wb);
      product_pair #(.Wa(Wa), .Wb(Wb), .Drop(Low + (3 * j + k) % 5), .Square(k == Count)) i_pair (
        .clk_i, .clock_i(clock_q)
      );
    end
  end
  always_ff @(posedge clk_i) begin
    clock_q <= clock_q + 1;
    if (clock_q == Clocks - 1) $display("products %0d", Count * (Count + 1) * Clocks);
  end

endmodule

/// Operands of one pair of widths: all pairs of eight extreme words each, then random ones.
module product_pair #(
  parameter int Wa = 18,
  parameter int Wb = 18,
  parameter int Drop = 0,
  parameter bit Square = 1'b0
) (
  input logic clk_i,
  input int   clock_i
);

  localparam int Wp = Wa + Wb - Drop;

  function automatic logic [31:0] word(int width, int which);
    logic [31:0] low, least;
    low = (32'd1 << lipp_math_pkg::low_bits(width)) - 32'd1;
    least = 32'd1 << (width - 1);
    case (which)
      0: return least;
      1: return ~least;
      2: return 32'd0;
      3: return 32'd1;
      4: return '1;
      5: return low;
      6: return ~low;
      7: return least | low;
      default: return $urandom;
    endcase
  endfunction

  logic signed [Wa-1:0] a_q;
  logic signed [Wb-1:0] b_d, b_q;
  logic signed [Wp-1:0] simulated, in_logic, in_cells;
  assign b_d = Wb'(word(Wb, clock_i < 64 ? clock_i / 8 : 8));
  always_ff @(posedge clk_i) begin
    a_q <= Wa'(word(Wa, clock_i < 64 ? clock_i % 8 : 8));
    b_q <= b_d;
  end
  logic signed [Wb-1:0] b;
  assign b = Square ? Wb'(a_q) : b_q;

  lipp_multiplier #(
    .Wa(Wa), .Wb(Wb), .Drop(Drop), .Square(Square), .CrossCells(1'b1)
  ) i_simulated (.clk_i, .a_i(a_q), .b_i(b), .p_o(simulated));
  ecp5_multiplier #(
    .Wa(Wa), .Wb(Wb), .Drop(Drop), .Square(Square)
  ) i_logic (.clk_i, .a_i(a_q), .b_i(b), .p_o(in_logic));
  ecp5_multiplier #(
    .Wa(Wa), .Wb(Wb), .Drop(Drop), .Square(Square), .CrossCells(1'b1)
  ) i_cells (.clk_i, .a_i(a_q), .b_i(b), .p_o(in_cells));

  always_ff @(posedge clk_i) begin
    if (clock_i > lipp_math_pkg::mul_latency(Wa, Wb) + 1
        && (simulated != in_logic || simulated != in_cells)) begin
      $display("%0d x %0d >> %0d: simulated %0d, placed in logic %0d, in cells %0d", Wa, Wb, Drop,
               simulated, in_logic, in_cells);
      $stop;
    end
  end

endmodule
