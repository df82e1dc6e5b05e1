// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// The protocol's numbers, and CRC-32 (IEEE, as zlib.crc32).
///
/// A packet before COBS, little-endian: type u8, seq u16, body, CRC-32 u32 of all before it. The
/// state of a CRC starts as all ones, and the CRC is the complement of the state.
package lipp_link_pkg;
  // Most modules use only some of these.
  /* verilator lint_off UNUSEDPARAM */

  /// Bytes of a packet before COBS, its CRC included.
  localparam int MinPacket = 7;
  localparam int MaxPacket = 3200;
  localparam int LengthBits = $clog2(MaxPacket + 2);  // MaxPacket + 1 fits too

  /// Words of a block of a scene's texels: 1024 bytes.
  localparam int BlockWords = 256;

  localparam logic [31:0] CrcStart = '1;
  /// The state after any bytes followed by their own CRC.
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
    RequestBlock = 8'h0b,  // these two: of boards with a scene
    RequestBlocks = 8'h0c
  } request_e;

  /// A reply's type is the request's with this bit set.
  localparam logic [7:0] ReplyBit = 8'h80;

  /// The result of a request: the first byte of a reply's body.
  typedef enum logic [7:0] {
    StatusOk = 8'd0,
    StatusUnknown = 8'd1,   // type of request
    StatusLength = 8'd2,    // wrong for the type
    StatusAddress = 8'd3,   // no such register
    StatusStale = 8'd4,     // epoch
    StatusTile = 8'd5,      // bad data
    StatusFrameCrc = 8'd6,  // differs from the back buffer's
    StatusNoTile = 8'd7,    // nor such a slot or block
    StatusVersion = 8'd8,   // of the protocol
    StatusOptics = 8'd9,    // refused by the optics block
    StatusBusy = 8'd10      // something else runs
  } reply_status_e;

  /// What runs, in a reply with StatusBusy.
  typedef enum logic [7:0] {
    RunsNothing = 8'd0,
    RunsFrame = 8'd1,  // started by a WRITE
    RunsSign = 8'd2,   // of another request
    RunsThis = 8'd3,   // the SIGN that is answered
    RunsScene = 8'd4,  // the optics draw the panel
    RunsSlot = 8'd5    // the slot is shown
  } runs_e;

  /// What a request wants of the optics block (ray_access).
  typedef enum logic [2:0] {OpClaim, OpTrace, OpSign, OpResult, OpAbort, OpDraw} ray_op_e;

  /// A request without its words or its data.
  typedef struct packed {
    request_e kind;
    logic [15:0] number;
    logic [5:0][7:0] arguments;  // bytes of the body
    logic [8:0] words;           // number of words collected
    logic odd;                   // bit 0 of the first of them
  } request_t;
  /* verilator lint_on UNUSEDPARAM */

  typedef logic [31:0][31:0] crc_rows_t;

  /// After a number of steps, each bit of the state is the parity of some bits of the old state:
  /// this returns which. Parities are shallow logic; 24 or 32 single steps would be a long chain.
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

  /// The state of a CRC after one more byte.
  function automatic logic [31:0] crc32_byte(logic [31:0] crc, logic [7:0] data);
    return crc_parities(crc ^ 32'(data), CrcRowsByte);
  endfunction

  /// The same after a pixel {r, g, b}, R first.
  function automatic logic [31:0] crc32_pixel(logic [31:0] crc, logic [23:0] rgb);
    return crc_parities(crc ^ 32'({rgb[7:0], rgb[15:8], rgb[23:16]}), CrcRowsPixel);
  endfunction

  /// The same after a word, its low byte first.
  function automatic logic [31:0] crc32_word(logic [31:0] crc, logic [31:0] w);
    return crc_parities(crc ^ w, CrcRowsWord);
  endfunction

endpackage

`default_nettype wire
