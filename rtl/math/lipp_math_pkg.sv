// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Widths and latencies of the modules that compute products and roots.
package lipp_math_pkg;
  // Each module uses only some of the parameters below.
  /* verilator lint_off UNUSEDPARAM */

  typedef enum int {
    RootReciprocal = 0,
    RootSquare = 1
  } root_e;

  /// Width of a signed operand of one hardware multiplier, in bits.
  localparam int MulBits = 18;
  /// Number of guard bits: extra fraction bits of intermediate results until the final rounding.
  localparam int Guard = 3;

  /// Slack: rounding errors can move a word beyond its range by up to 2^Slack units in the last
  /// place. SquareSlack is the Slack of clamped squares, which have F + 3 fraction bits.
  localparam int Slack = 6;
  localparam int SquareSlack = 9;

  /// Return the number of an operand's low bits that do not fit a hardware multiplier.
  function automatic int low_bits(int width);
    return width > MulBits ? width - MulBits : 0;
  endfunction

  /// Return the latency of `lipp_low_product`, a tree over digits of two bits. The latency is at
  /// least that of the multiplier cell that multiplies the operands' upper bits in parallel.
  function automatic int low_latency(int low);
    int tree;
    tree = 1 + $clog2((low + 1) / 2);
    return low == 0 ? 0 : tree > 3 ? tree : 3;
  endfunction

  /// Return the latency of `lipp_multiplier` in clocks.
  function automatic int mul_latency(int wa, int wb);
    int low;
    low = low_bits(wa) > low_bits(wb) ? low_bits(wa) : low_bits(wb);
    if (low == 0) return 4;
    return 2 + low_latency(low) + 1;
  endfunction

  /// Return the latency of `lipp_small_product` in clocks.
  function automatic int small_latency();
    return 2;
  endfunction

  /// Return the latency of `lipp_byte_square` in clocks.
  function automatic int byte_square_latency();
    return 2;
  endfunction

  /// Return the latency of `lipp_mult18` in clocks.
  function automatic int cell_latency();
    return 3;
  endfunction

  /// Return the latency of `lipp_row_multiplier`. The latency is that of a multiplier cell, plus
  /// one clock for a sum if an operand does not fit the cell.
  function automatic int row_latency(int wa, int wb);
    return cell_latency() + (low_bits(wa) > 0 || low_bits(wb) > 0 ? 1 : 0);
  endfunction

  /// Return log2 of the number of table segments that `lipp_quadratic` has per octave. An F that
  /// `lipp_quadratic` refuses gets a small table.
  function automatic int segment_bits(int f);
    return f < 14 ? 4 : f > 23 ? 7 : f / 3;
  endfunction

  /// Return the width of the position z within a table segment of `lipp_quadratic`, in bits.
  function automatic int place_bits(int f);
    return f + 2 - segment_bits(f) < MulBits ? f + 2 - segment_bits(f) : MulBits;
  endfunction

  /// Return the number of fraction bits of the polynomial's slope in `lipp_quadratic`.
  function automatic int slope_fraction(int f);
    // An illegal f also gets a legal width, so that elaboration reaches the error message.
    return f < 14 ? 18 : segment_bits(f) + 18 < f + 4 ? segment_bits(f) + 18 : f + 4;
  endfunction

  /// Return the latency of `lipp_quadratic`, which is 4 clocks for octave and table, 4 for each of
  /// the two products, and 1 for each of the two sums.
  function automatic int quadratic_latency();
    return 4 + 4 + 1 + 4 + 1;
  endfunction

  /// Return the latency of `lipp_rsqrt` in clocks.
  function automatic int rsqrt_latency();
    return quadratic_latency() + 1;
  endfunction

  /// Return the latency of `lipp_sqrt`, including the shifts that normalise its input and output.
  function automatic int sqrt_latency(bit normalise);
    return quadratic_latency() + 1 + (normalise ? 4 + 2 : 0);
  endfunction

  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
