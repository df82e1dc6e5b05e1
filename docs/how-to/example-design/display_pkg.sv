// SPDX-License-Identifier: Apache-2.0
// Made by make_data.py from display.toml; do not edit.
package display_pkg;
  localparam lipp_optics_pkg::build_t Build = 16'h0010;
  localparam int F = 16;
  localparam int Columns = 32;
  localparam int Rows = 24;
  /// Register writes to the optics block: 9 bits of byte address, 32 bits of data.
  localparam int WriteCount = 42;
  localparam logic [40:0] Writes[WriteCount] = '{
    {9'h040, 32'h968c01e2},
    {9'h044, 32'h00000001},
    {9'h048, 32'h31eaed47},
    {9'h04c, 32'h00000000},
    {9'h050, 32'hce1512b9},
    {9'h054, 32'h00000007},
    {9'h058, 32'h968c01e2},
    {9'h05c, 32'h00000001},
    {9'h060, 32'h00800000},
    {9'h064, 32'h00000000},
    {9'h068, 32'h00800000},
    {9'h06c, 32'h00000000},
    {9'h070, 32'hffffb1a2},
    {9'h074, 32'hffffb1a2},
    {9'h078, 32'h00000000},
    {9'h07c, 32'h00000000},
    {9'h080, 32'h00000000},
    {9'h084, 32'h00000000},
    {9'h088, 32'h00000000},
    {9'h08c, 32'h00000000},
    {9'h090, 32'h00018000},
    {9'h094, 32'h00024000},
    {9'h098, 32'h00015555},
    {9'h09c, 32'h000071c7},
    {9'h0a0, 32'h00000000},
    {9'h0a4, 32'h00080000},
    {9'h0a8, 32'h00000000},
    {9'h0ac, 32'h00009b27},
    {9'h0b0, 32'h00009b27},
    {9'h0b4, 32'h00009b27},
    {9'h0b8, 32'h00009b27},
    {9'h0bc, 32'h00000000},
    {9'h0e0, 32'h00000000},
    {9'h0e4, 32'h00000000},
    {9'h0e8, 32'h00000000},
    {9'h0ec, 32'h00001fff},
    {9'h0f0, 32'h00000fff},
    {9'h0f4, 32'h00000000},
    {9'h0f8, 32'h00000000},
    {9'h0fc, 32'h00000000},
    {9'h014, 32'h00000001},
    {9'h00c, 32'h00000001}
  };
endpackage
