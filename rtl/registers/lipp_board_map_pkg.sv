// SPDX-License-Identifier: Apache-2.0
// Generated from rtl/registers.rdl by `make registers`; do not edit.
/// Byte addresses of the words that can be written, on a board with every block and layer.
package lipp_board_map_pkg;
  function automatic logic writable(logic [10:0] at);
    return at inside {
      [11'h018:11'h01C],
      [11'h20C:11'h20C],
      [11'h214:11'h214],
      [11'h240:11'h2D0],
      [11'h2E0:11'h3FC],
      [11'h40C:11'h424],
      [11'h600:11'h6FC]
    };
  endfunction
endpackage
