// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Widths and latencies of products and roots.
package lipp_math_pkg;
  // Most modules use only some of these.
  /* verilator lint_off UNUSEDPARAM */

  typedef enum int {
    RootReciprocal = 0,
    RootSquare = 1
  } root_e;

  /// Bits of an operand of one hardware multiplier: signed.
  localparam int MulBits = 18;
  /// Bits kept below the last place until the final rounding of a step.
  localparam int Guard = 3;

  /// Roundings may bring a saturated word, or a clamped square (F + 3 fraction bits), so many units
  /// beyond its range, as powers of two.
  localparam int Slack = 6;
  localparam int SquareSlack = 9;

  /// Number of an operand's bits beyond the width of a hardware multiplier.
  function automatic int low_bits(int width);
    return width > MulBits ? width - MulBits : 0;
  endfunction

  /// Latency of `lipp_low_product`: digits of two bits, summed in a tree; at least that of a
  /// multiplier cell.
  function automatic int low_latency(int low);
    int tree;
    tree = 1 + $clog2((low + 1) / 2);
    return low == 0 ? 0 : tree > 3 ? tree : 3;
  endfunction

  /// Latency of `lipp_multiplier`.
  function automatic int mul_latency(int wa, int wb);
    int low;
    low = low_bits(wa) > low_bits(wb) ? low_bits(wa) : low_bits(wb);
    if (low == 0) return 4;
    return 2 + low_latency(low) + 1;
  endfunction

  /// Latency of `lipp_small_product`.
  function automatic int small_latency();
    return 2;
  endfunction

  /// Latency of `lipp_byte_square`.
  function automatic int byte_square_latency();
    return 2;
  endfunction

  /// Latency of `lipp_mult18`.
  function automatic int cell_latency();
    return 3;
  endfunction

  /// Latency of `lipp_row_multiplier`: the cell, and a sum where a word is longer.
  function automatic int row_latency(int wa, int wb);
    return cell_latency() + (low_bits(wa) > 0 || low_bits(wb) > 0 ? 1 : 0);
  endfunction

  /// Segments of a root's table in each octave, as a power of two. An illegal F, which its module
  /// refuses, gets a small table.
  function automatic int segment_bits(int f);
    return f < 14 ? 4 : f > 23 ? 7 : f / 3;
  endfunction

  /// Bits of the position within a segment.
  function automatic int place_bits(int f);
    return f + 2 - segment_bits(f) < MulBits ? f + 2 - segment_bits(f) : MulBits;
  endfunction

  /// Fraction bits of a segment's slope.
  function automatic int slope_fraction(int f);
    // Of an f that is refused too, so that its message is reached.
    return f < 14 ? 18 : segment_bits(f) + 18 < f + 4 ? segment_bits(f) + 18 : f + 4;
  endfunction

  /// Latency of `lipp_quadratic`: octave, table (2), two products and two sums.
  function automatic int quadratic_latency();
    return 4 + 4 + 1 + 4 + 1;
  endfunction

  /// Latency of `lipp_rsqrt`.
  function automatic int rsqrt_latency();
    return quadratic_latency() + 1;
  endfunction

  /// Latency of `lipp_sqrt`, with the normalising shifts before and after the root.
  function automatic int sqrt_latency(bit normalise);
    return quadratic_latency() + 1 + (normalise ? 4 + 2 : 0);
  endfunction

  /* verilator lint_on UNUSEDPARAM */
endpackage

`default_nettype wire
