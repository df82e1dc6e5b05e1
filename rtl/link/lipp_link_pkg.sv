// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Constants of the serial link's protocol, and functions for its CRC-32 (that of zlib.crc32).
///
/// Before COBS encoding, a packet consists of its type (8 bits), its request number (16 bits), the
/// body, and the CRC-32 (32 bits) of all these bytes, each little-endian. The initial state of the
/// CRC is all ones. The CRC is the bitwise complement of the final state.
package lipp_link_pkg;
  // Most modules use only some of these constants.
  /* verilator lint_off UNUSEDPARAM */

  /// Minimum number of bytes of a packet before COBS encoding, including its CRC.
  localparam int MinPacket = 7;
  /// Maximum number of bytes of a packet before COBS encoding, including its CRC.
  localparam int MaxPacket = 3200;
  localparam int LengthBits = $clog2(MaxPacket + 2);  // width that fits MaxPacket + 1

  /// Number of 32-bit words in a block of 1024 bytes of a texture slot.
  localparam int BlockWords = 256;

  localparam logic [31:0] CrcStart = '1;
  /// State of the CRC register after any bytes followed by the CRC of these bytes.
  localparam logic [31:0] CrcResidue = 32'hdebb_20e3;

  typedef enum logic [7:0] {
    RequestHello = 8'h01,
    RequestRead = 8'h02,
    RequestWrite = 8'h03,
    RequestTile = 8'h04,
    RequestPresent = 8'h05,
    RequestTiles = 8'h06,
    RequestTrace = 8'h07,
    RequestSign = 8'h08,
    RequestAbort = 8'h09,
    RequestReset = 8'h0a,
    RequestBlock = 8'h0b,  // BLOCK, BLOCKS: only boards with a scene
    RequestBlocks = 8'h0c
  } request_e;

  /// Bit that marks a reply: the type of a reply is the type of its request with this bit set.
  localparam logic [7:0] ReplyBit = 8'h80;

  /// Status of a request, the first byte of a reply's body.
  typedef enum logic [7:0] {
    StatusOk = 8'd0,
    StatusUnknown = 8'd1,   // unknown type of request
    StatusLength = 8'd2,    // packet length does not match the request's type
    StatusAddress = 8'd3,   // no register has this address
    StatusStale = 8'd4,     // epoch or request number is outdated
    StatusTile = 8'd5,      // tile data are invalid
    StatusFrameCrc = 8'd6,  // requested CRC is not the back buffer's CRC
    StatusNoTile = 8'd7,    // tile, slot or block does not exist
    StatusVersion = 8'd8,   // unsupported protocol version
    StatusOptics = 8'd9,    // the optics block refused the request
    StatusBusy = 8'd10      // another task is running
  } reply_status_e;

  /// Running task, as named in a reply with StatusBusy.
  typedef enum logic [7:0] {
    RunsNothing = 8'd0,
    RunsFrame = 8'd1,  // raster frame started by a WRITE request
    RunsSign = 8'd2,   // signature started by another SIGN request
    RunsThis = 8'd3,   // signature of the SIGN request that is answered
    RunsScene = 8'd4,  // the optics draw the scene on the panel
    RunsSlot = 8'd5    // the panel shows the slot to load
  } runs_e;

  /// Operation that the dispatcher starts in the module ray_access.
  typedef enum logic [2:0] {OpClaim, OpTrace, OpSign, OpResult, OpAbort, OpDraw} ray_op_e;

  /// Fields of a request, without its data words and tile data.
  typedef struct packed {
    request_e kind;
    logic [15:0] number;
    logic [5:0][7:0] arguments;  // first 6 bytes of the request's body
    logic [8:0] words;           // number of collected words of the request
    logic odd;                   // bit 0 of the first data word
  } request_t;
  /* verilator lint_on UNUSEDPARAM */

  typedef logic [31:0][31:0] crc_rows_t;

  /// Return the matrix that advances the CRC state by a number of single-bit steps. Each bit of the
  /// new state is the parity of some bits of the old state; row k of the matrix selects the old
  /// bits for new bit k. Parities need few logic levels; 32 single steps would be a long chain.
  function automatic crc_rows_t crc_rows(int steps);
    for (int from = 0; from < 32; from++) begin
      logic [31:0] state;
      state = 32'h1 << from;
      for (int k = 0; k < steps; k++) state = (state >> 1) ^ (state[0] ? 32'hedb8_8320 : 32'h0);
      for (int to = 0; to < 32; to++) crc_rows[to][from] = state[to];
    end
  endfunction

  function automatic logic [31:0] crc_parities(logic [31:0] state, crc_rows_t rows);
    for (int to = 0; to < 32; to++) crc_parities[to] = ^(state & rows[to]);
  endfunction

  localparam crc_rows_t CrcRowsByte = crc_rows(8);
  localparam crc_rows_t CrcRowsPixel = crc_rows(24);
  localparam crc_rows_t CrcRowsWord = crc_rows(32);

  /// Return the CRC state after one more byte.
  function automatic logic [31:0] crc32_byte(logic [31:0] crc, logic [7:0] data);
    return crc_parities(crc ^ 32'(data), CrcRowsByte);
  endfunction

  /// Return the CRC state after the bytes r, g, b of one more pixel, red first.
  function automatic logic [31:0] crc32_pixel(logic [31:0] crc, logic [23:0] rgb);
    return crc_parities(crc ^ 32'({rgb[7:0], rgb[15:8], rgb[23:16]}), CrcRowsPixel);
  endfunction

  /// Return the CRC state after the four bytes of one more word, the low byte first.
  function automatic logic [31:0] crc32_word(logic [31:0] crc, logic [31:0] w);
    return crc_parities(crc ^ w, CrcRowsWord);
  endfunction

endpackage

`default_nettype wire
