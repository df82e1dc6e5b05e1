// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Computes a root of x in [1, 4) by piecewise quadratic interpolation in a coefficient table.
///
/// The parameter Root selects the root. The result y is in (1/2, 1]:
///
///   RootReciprocal   y = 1 / sqrt(x)
///   RootSquare       y = sqrt(x) / 2.
///
/// The input x_i is unsigned with I = F + 1 fraction bits. The mantissa is m = x for x < 2 (lower
/// octave) and m = x / 2 for x >= 2 (upper octave). The mantissa has I + 1 fraction bits. The
/// octave and the top A = segment_bits(F) fraction bits of m select a segment of the table. The
/// next D = place_bits(F) bits of m are the position z in [-1/2, 1/2) within the segment, and the
/// lower bits of m are truncated. The polynomial is
///
///   slope = c1 + floor(c2 z 2^s1 + 1/2) / 2^s1,   s1 = slope_fraction(F)
///   y     = c0 + floor(slope z 2^(F + 4)) / 2^(F + 4).
///
/// The polynomial interpolates the root at the segment's Chebyshev nodes z = 0 and z = +-sqrt(3)/4.
/// The interpolation error is at most |y'''| w^3 / 192 for a segment of width w. Coefficient c0 is
/// rounded to F + 4 fraction bits, c1 to s1 bits, c2 to s1 + 2 bits. The output y_o is unsigned
/// with F + 4 fraction bits. The latency is quadratic_latency() clocks.
module lipp_quadratic #(
  parameter int F = 23,
  parameter int Root = lipp_math_pkg::RootReciprocal
) (
  input  logic         clk_i,
  input  logic [F+2:0] x_i,
  output logic [F+4:0] y_o
);
  import lipp_math_pkg::*;

  localparam int A = segment_bits(F);
  localparam int D = place_bits(F);
  localparam int S1 = slope_fraction(F);
  localparam int W0 = F + 5;               // width of coefficient c0, unsigned
  localparam int W1 = S1 - A;              // width of coefficient c1, signed: |c1| < 2^-(A + 1)
  localparam int W2 = S1 + 3 - 2 * A;      // width of coefficient c2, signed: |c2| < 2^-2A
  localparam int Entries = 1 << (A + 1);

  localparam int Wt = W0 + W1 + W2;
  typedef logic [Entries-1:0][Wt-1:0] table_t;  // entry: coefficients {c0, c1, c2}

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_quadratic: F must be 14 to 23");
  end
  if (Root != RootReciprocal && Root != RootSquare) begin : gen_illegal_root
    $fatal(1, "lipp_quadratic: Root must be RootReciprocal or RootSquare");
  end

  /// Return the root at position z of a segment. A segment of the upper octave is twice as wide as
  /// a segment of the lower octave.
  function automatic real root_at(int segment, real z);
    real mantissa, square;
    mantissa = 1.0 + (real'(segment % (1 << A)) + 0.5 + z) / real'(1 << A);
    square = segment < (1 << A) ? mantissa : 2.0 * mantissa;
    return Root == RootReciprocal ? 1.0 / $sqrt(square) : 0.5 * $sqrt(square);
  endfunction

  function automatic int nearest(real value);
    return value < 0.0 ? -$rtoi(0.5 - value) : $rtoi(value + 0.5);
  endfunction

  function automatic table_t make_table();
    real node, middle, right, left;
    node = $sqrt(3.0) / 4.0;
    for (int k = 0; k < Entries; k++) begin
      middle = root_at(k, 0.0);
      right = root_at(k, node);
      left = root_at(k, -node);
      make_table[k] = {
        W0'(nearest(middle * real'(1 << (F + 4)))),
        W1'(nearest((right - left) / (2.0 * node) * real'(1 << S1))),
        W2'(nearest((right + left - 2.0 * middle) * (8.0 / 3.0) * real'(1 << (S1 + 2))))
      };
    end
  endfunction

  localparam table_t Table = make_table();

  // ---- find the octave, and give the fraction the same format in both octaves ----
  logic [F+1:0] fraction_q;
  logic octave_q;
  logic [A:0] segment;
  logic signed [D-1:0] place_q;
  assign segment = {octave_q, fraction_q[F+1-:A]};
  always_ff @(posedge clk_i) begin
    octave_q <= x_i[F+2];
    fraction_q <= x_i[F+2] ? x_i[F+1:0] : {x_i[F:0], 1'b0};
    // Inverting the top bit of the position subtracts half a segment, which makes z signed.
    place_q <= {~fraction_q[F+1-A], fraction_q[F-A-:D-1]};
  end

  // The table of coefficients is read as eight parts. Each part has its own address, which is 0
  // while another part is selected. One common address would drive the whole table over long wires
  // and limit the clock frequency. A part that is not selected outputs 0, so an OR of all parts
  // replaces a multiplexer.
  localparam int Parts = 8;
  localparam int Part = Entries / Parts;
  logic [Parts-1:0][Wt-1:0] entry_q;
  logic signed [W2-1:0] c2_q;
  logic signed [W1-1:0] c1_q;
  logic [W0-1:0] c0_q;
  for (genvar k = 0; k < Parts; k++) begin : gen_part
    (* rom_style = "logic" *) logic [Wt-1:0] entries[Part];
    initial for (int n = 0; n < Part; n++) entries[n] = Table[k*Part+n];
    logic selected_q;
    logic [A-3:0] at_q;
    always_ff @(posedge clk_i) begin
      selected_q <= segment[A-:3] == 3'(k);
      at_q <= segment[A-:3] == 3'(k) ? segment[A-3:0] : '0;
      entry_q[k] <= selected_q ? entries[at_q] : '0;
    end
  end
  always_ff @(posedge clk_i) begin
    {c0_q, c1_q, c2_q} <= ((entry_q[0] | entry_q[1]) | (entry_q[2] | entry_q[3]))
        | ((entry_q[4] | entry_q[5]) | (entry_q[6] | entry_q[7]));
  end

  // The slope is c1 + round(c2 z). Coefficient c2 has S1 + 2 fraction bits, c1 has S1, and z has D.
  localparam int MulLatency = mul_latency(MulBits, MulBits);
  logic signed [D-1:0] place_early, place_late;
  logic signed [W2-1:0] bend;
  logic signed [W2-2:0] turn;  // product c2 z, with S1 + 1 fraction bits
  logic signed [W1-1:0] c1_late;
  logic signed [W1-1:0] slope_q;
  lipp_delay #(.Width(D), .Cycles(2)) i_place_early (.clk_i, .d_i(place_q), .q_o(place_early));
  assign bend = c2_q;
  lipp_multiplier #(.Wa(W2), .Wb(D), .Drop(D + 1)) i_turn (
    .clk_i, .a_i(bend), .b_i(place_early), .p_o(turn)
  );
  lipp_delay #(.Width(W1), .Cycles(MulLatency)) i_c1 (.clk_i, .d_i(c1_q), .q_o(c1_late));
  // A single adder computes c1 + floor((turn + 1) / 2).
  always_ff @(posedge clk_i) slope_q <= W1'(($signed({c1_late, 1'b1}) + (W1 + 1)'(turn)) >>> 1);

  // The root is y = c0 + slope z.
  localparam int Wr = W1 + D - (S1 + D - (F + 4));
  logic signed [Wr-1:0] rise;
  logic [W0-1:0] c0_late;
  lipp_delay #(.Width(D), .Cycles(MulLatency + 1)) i_place_late (
    .clk_i, .d_i(place_early), .q_o(place_late)
  );
  lipp_multiplier #(.Wa(W1), .Wb(D), .Drop(S1 + D - (F + 4))) i_rise (
    .clk_i, .a_i(slope_q), .b_i(place_late), .p_o(rise)
  );
  lipp_delay #(.Width(W0), .Cycles(2 * MulLatency + 1)) i_c0 (.clk_i, .d_i(c0_q), .q_o(c0_late));
  always_ff @(posedge clk_i) y_o <= c0_late + W0'(rise);

endmodule

`default_nettype wire
