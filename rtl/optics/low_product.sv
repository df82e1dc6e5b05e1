/// Product of a signed word and a few unsigned bits, in logic: p(t) = a(t - L) * low(t - L).
///
/// Latency L = 1 + ceil(log2(ceil(Low / 2))): digits of two bits, summed pairwise in a tree.
module low_product #(
  parameter int Low = 2,                            // bits of the unsigned factor, 1 or more
  parameter int Latency = optics_pkg::low_latency(Low)  // may be raised to match a sibling
) (
  input  logic                                clk_i,
  input  logic signed [optics_pkg::MulBits-1:0] a_i,
  input  logic        [Low-1:0]               low_i,
  output logic signed [optics_pkg::MulBits+Low-1:0] p_o
);
  import optics_pkg::*;

  localparam int Digits = (Low + 1) / 2;
  localparam int Own = low_latency(Low);

  if (Digits == 1) begin : gen_digit
    logic signed [MulBits+Low-1:0] p_q;
    always_ff @(posedge clk_i) p_q <= (MulBits + Low)'(a_i * $signed({1'b0, low_i}));
    delay #(.Width(MulBits + Low), .Cycles(Latency - Own)) i_match (
      .clk_i, .d_i(p_q), .q_o(p_o)
    );
  end else begin : gen_tree
    // The lower branch takes the largest power of two of digits below their number.
    localparam int LowerDigits = 1 << ($clog2(Digits) - 1);
    localparam int Split = 2 * LowerDigits;
    logic signed [MulBits+Split-1:0]     lower;
    logic signed [MulBits+Low-Split-1:0] upper;
    logic signed [MulBits+Low-1:0]       p_q;
    low_product #(.Low(Split), .Latency(Own - 1)) i_lower (
      .clk_i, .a_i, .low_i(low_i[Split-1:0]), .p_o(lower)
    );
    low_product #(.Low(Low - Split), .Latency(Own - 1)) i_upper (
      .clk_i, .a_i, .low_i(low_i[Low-1:Split]), .p_o(upper)
    );
    always_ff @(posedge clk_i) begin
      p_q <= (MulBits + Low)'(lower) + $signed({upper, Split'(0)});
    end
    delay #(.Width(MulBits + Low), .Cycles(Latency - Own)) i_match (
      .clk_i, .d_i(p_q), .q_o(p_o)
    );
  end

endmodule
