// SPDX-License-Identifier: Apache-2.0
// Generated from rtl/registers.rdl by `make registers`; do not edit.
/// Which words of the board can be written, byte addresses.
package lipp_board_map_pkg;
  function automatic logic writable(logic [9:0] at);
    return at inside {
      [10'h018:10'h01C],
      [10'h20C:10'h20C],
      [10'h214:10'h214],
      [10'h240:10'h2D0],
      [10'h2E0:10'h3FC]
    };
  endfunction
endpackage
