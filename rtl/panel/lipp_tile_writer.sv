// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Decodes one tile from a packet and writes it into a buffer of the frame store.
///
/// Input start_i samples the tile's parameters, and is ignored while a tile is being written. The
/// bytes of the packet follow as a stream whose last byte is marked. If empty_i is high, the packet
/// has no bytes. At most one pixel is written per clock. The bytes of the codings are:
///
///   CodingRaw    R, G, B of each pixel.
///   CodingSolid  one R, G, B for all pixels.
///   CodingQoi    operations of QOI, except QOI_OP_RGBA, without header and end marker. Every
///                pixel's alpha is 255. QOI's previous pixel and index start as black.
///   CodingCopy   no bytes: the tile is copied from the other buffer.
///
/// Output done_o is a pulse after the last byte and the last write. If ok_o is high with done_o,
/// the data had exactly the tile's number of pixels, and crc_o is the CRC-32 of the pixels' bytes,
/// row by row. If ok_o is low with done_o, the data, the index of the tile or the coding were
/// invalid. The remaining bytes of an invalid packet are discarded, and the tile may be partly
/// written. No pixel outside the tile is ever written.
///
/// Each row of the tile is one request to the write client of the frame store. For CodingCopy, each
/// row is first requested from the read client. If invalid data end within a row, the row is filled
/// with arbitrary pixels. The write of a row is requested when its first pixel is known and the
/// previous row is written.
///
/// The number of clocks from start_i to done_o depends on the coding. Assume that the frame store
/// is always ready. Let h rows of w pixels form the tile, b be the number of bytes up to the first
/// pixel, and n = max(1, ceil(log2(rows of tiles on the panel))). The numbers of clocks are:
///
///   Raw tiles take 3 w h + n + 5 clocks.
///   Copied tiles take h (w + 4) + n + 2 clocks.
///   Solid tiles, and QOI tiles of a single run, take b + h (w + 3) + n + 2 clocks.
module lipp_tile_writer #(
  parameter int Width = 640,
  parameter int Height = 480,
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,

  input  logic                 start_i,
  input  logic [15:0]          tile_i,
  input  logic [7:0]           coding_i,
  input  logic                 buffer_i,
  input  logic                 empty_i,
  output logic                 done_o,
  output logic                 ok_o,
  output logic [31:0]          crc_o,

  input  logic                 valid_i,
  output logic                 ready_o,
  input  logic [7:0]           data_i,
  input  logic                 last_i,

  output logic                 write_valid_o,        // request of the frame store's client write
  input  logic                 write_ready_i,
  output logic                 write_buffer_o,
  output logic [PlaceBits-1:0] write_first_o,
  output logic [PlaceBits:0]   write_count_o,
  output logic                 write_pixel_valid_o,
  input  logic                 write_pixel_ready_i,
  output logic [23:0]          write_rgb_o,
  input  logic                 write_done_i,

  output logic                 read_valid_o,         // request of the frame store's client read
  input  logic                 read_ready_i,
  output logic                 read_buffer_o,
  output logic [PlaceBits-1:0] read_first_o,
  output logic [PlaceBits:0]   read_count_o,
  input  logic                 read_pixel_valid_i,
  output logic                 read_pixel_ready_o,
  input  logic [23:0]          read_rgb_i
);
  import lipp_panel_pkg::*;

  localparam int Columns = tiles(Width);
  localparam int Rows = tiles(Height);
  localparam int RowBits = Rows > 1 ? $clog2(Rows) : 1;
  localparam int SideBits = $clog2(Tile);
  localparam int RemainingBits = 2 * SideBits + 1;
  // Last pixel index along a side of a tile. Whole is for a complete tile, CutX for the last tile
  // of a row of tiles, CutY for the last tile of a column.
  localparam logic [SideBits-1:0] Whole = SideBits'(Tile - 1);
  localparam logic [SideBits-1:0] CutX = SideBits'((Width - 1) % Tile);
  localparam logic [SideBits-1:0] CutY = SideBits'((Height - 1) % Tile);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_tile_writer: Width and Height must be 1 to 16383");
  end
  if (Columns * Rows >= 1 << 16) begin : gen_illegal
    $fatal(1, "lipp_tile_writer: the panel must have fewer than 65536 tiles");
  end

  typedef enum logic [2:0] {Idle, Locate, Place, Decode, Finish} state_e;
  state_e state_q;
  coding_e coding_q;
  logic buffer_q, last_q, bad_q, full_q;
  logic start, take, emit;
  logic pixel_q;  // 1: rgb_q is a pixel of the tile that is still to be written
  logic copies_q; // 1: the pixels come from the other frame buffer
  logic into, into_valid, into_ready;  // into: a pixel moves to the skid buffer
  logic [23:0] into_rgb;
  assign start = start_i && state_q == Idle;
  assign take = valid_i && ready_o;

  // ---- find the tile's row and column by division, one bit per clock ----
  logic [15:0] column_q;   // index of the tile; after the division, its column
  logic [15:0] columns_q;  // number of tiles in 2^k rows of tiles, for bit k of the tile's row
  logic [PlaceBits-1:0] rows_q;  // address step of 2^k rows of tiles
  logic [SideBits-1:0] last_x_q;
  logic last_column, last_row_q;  // 1: the tile is in the last column or row of tiles
  logic [PlaceBits-1:0] row_at_q;
  logic missing, row_done;
  assign missing = int'(tile_i) >= Columns * Rows;
  assign last_column = column_q == 16'(Columns - 1);

  always_ff @(posedge clk_i) begin
    if (start) begin
      column_q <= tile_i;
      columns_q <= 16'(Columns << (RowBits - 1));
      rows_q <= PlaceBits'((Tile * Width) << (RowBits - 1));
      row_at_q <= '0;
      last_row_q <= int'(tile_i) >= Columns * (Rows - 1);
    end
    if (state_q == Locate) begin
      columns_q <= columns_q >> 1;
      rows_q <= rows_q >> 1;
      if (column_q >= columns_q) begin
        column_q <= column_q - columns_q;
        row_at_q <= row_at_q + rows_q;
      end
    end
    if (state_q == Place) begin
      last_x_q <= last_column ? CutX : Whole;
      row_at_q <= row_at_q + PlaceBits'({column_q, SideBits'(0)});
    end
    if (row_done) row_at_q <= row_at_q + PlaceBits'(Width);
  end

  // ---- store QOI's index of pixels, which always contains the previous pixel ----

  // The index is in distributed memory, because block memory's output is valid too late in a clock.
  (* ram_style = "distributed" *) logic [23:0] index[64];
  logic [63:0] index_valid_q;
  logic [23:0] rgb_q, indexed;
  logic [5:0] hash;            // hash of rgb_q: (3 r + 5 g + 7 b + 11 * 255) mod 64
  logic [5:0] hash_q, more_q;  // summands of the hash of rgb_q
  localparam logic [5:0] BlackHash = 6'(11 * 255);
  logic index_valid, previous;
  assign index_valid = index_valid_q[data_i[5:0]];
  assign hash = hash_q + more_q;
  assign previous = data_i[5:0] == hash;
  assign indexed = previous ? rgb_q : index_valid ? index[data_i[5:0]] : '0;
  always_ff @(posedge clk_i) begin
    if (start) index_valid_q <= '0;
    else if (pixel_q) begin
      index_valid_q[hash] <= 1'b1;
      index[hash] <= rgb_q;
    end
  end

  // ---- decode bytes to pixels ----
  logic [1:0] want_q, want_d;  // bytes of the current operation still to arrive
  logic [15:0] before_q;       // the two previous bytes
  logic luma_q, luma_d;
  logic [6:0] run_q, run_d;    // remaining repetitions of the pixel, minus 1
  logic fill_q, fill_d;        // 1: one colour or the copy fills the rest of the tile
  // number of pixels of the tile still to come, minus 2; negative at the last pixel
  logic [RemainingBits-1:0] remaining_q;
  logic draws, moves, wrong;   // draws: the byte completes a pixel; moves: first byte of LUMA
  logic step, repeats, bad, repeating, colour, look_up, open;  // open: a pixel can be produced
  logic [23:0] rgb, difference;
  logic [5:0] hash_d, more_d;

  assign repeating = !run_q[6] || fill_q;
  assign open = copies_q ? read_pixel_valid_i && into_ready : !pixel_q || into_ready;
  assign ready_o = state_q == Decode && !repeating && !last_q && open;

  // The next pixel is the current pixel plus a difference, black plus a difference, or a pixel of
  // the index. QOI_OP_LUMA takes two differences. The hash of the next pixel follows from the same
  // operation, because the hash 3 r + 5 g + 7 b (modulo 64) of a sum is the sum of the hashes. The
  // hash uses adders, because six bits need no multiplier cell.
  function automatic logic [5:0] hashed(logic [5:0] r, logic [5:0] g, logic [5:0] b);
    return (r + {r[4:0], 1'b0}) + (g + {g[3:0], 2'b0}) + ({b[2:0], 3'b0} - b);
  endfunction
  always_comb begin
    rgb = colour ? difference : {
      rgb_q[23:16] + difference[23:16], rgb_q[15:8] + difference[15:8], rgb_q[7:0] + difference[7:0]
    };
    {hash_d, more_d} = {colour ? BlackHash : hash,
        hashed(difference[21:16], difference[13:8], difference[5:0])};
    if (look_up) begin
      rgb = indexed;
      {hash_d, more_d} = {previous || index_valid ? data_i[5:0] : BlackHash, 6'd0};
    end
  end

  // The effect of the input byte is computed before the byte is accepted, for a short timing path.
  always_comb begin
    {draws, moves, wrong, colour, look_up, difference} = '0;
    {want_d, luma_d, run_d, fill_d} = {want_q, luma_q, run_q, fill_q};
    if (want_q != '0) begin
      want_d = want_q - 1'b1;
      if (want_q == 2'd1) begin
        draws = 1'b1;
        colour = !luma_q;
        difference = luma_q ? {4'd0, data_i[7:4], 8'd0, 4'd0, data_i[3:0]} : {before_q, data_i};
        luma_d = 1'b0;
        fill_d = coding_q == CodingSolid;
        if (coding_q == CodingRaw) want_d = 2'd3;
      end
    end else if (data_i == 8'hfe) begin  // QOI_OP_RGB
      want_d = 2'd3;
    end else if (data_i == 8'hff) begin  // QOI_OP_RGBA
      wrong = 1'b1;
    end else begin
      draws = 1'b1;
      unique case (data_i[7:6])
        2'b00: look_up = 1'b1;
        2'b01: difference = {
          {6'd0, data_i[5:4]} - 8'd2, {6'd0, data_i[3:2]} - 8'd2, {6'd0, data_i[1:0]} - 8'd2
        };
        2'b10: begin  // second byte: differences of red and blue
          {draws, moves, want_d, luma_d} = {1'b0, 1'b1, 2'd1, 1'b1};
          difference = {
            {2'd0, data_i[5:0]} - 8'd40, {2'd0, data_i[5:0]} - 8'd32, {2'd0, data_i[5:0]} - 8'd40
          };
        end
        2'b11: run_d = {1'b0, data_i[5:0]} - 7'd1;
      endcase
    end
  end
  assign repeats = state_q == Decode && repeating && open;
  assign step = take && !bad_q;
  assign emit = repeats || (step && draws);
  assign bad = (step && wrong) || (full_q && (take || emit));

  always_ff @(posedge clk_i) begin
    if (start) begin
      coding_q <= coding_e'(coding_i);
      buffer_q <= buffer_i;
      {rgb_q, hash_q, more_q} <= {24'd0, BlackHash, 6'd0};
      want_q <= coding_i == CodingQoi ? 2'd0 : 2'd3;
      {luma_q, run_q, full_q} <= {1'b0, -7'd1, 1'b0};
      {copies_q, fill_q} <= {2{coding_i == CodingCopy && empty_i && !missing}};
      last_q <= empty_i;
      bad_q <= missing || coding_i > CodingCopy || (coding_i == CodingCopy && !empty_i);
    end else begin
      if (step) {want_q, luma_q, run_q} <= {want_d, luma_d, run_d};
      else if (repeats && !run_q[6]) run_q <= run_q - 1'b1;
      fill_q <= (step ? fill_d : fill_q) && !(emit && remaining_q[RemainingBits-1]);
      if (step && (draws || moves)) {rgb_q, hash_q, more_q} <= {rgb, hash_d, more_d};
      if (take) before_q <= {before_q[7:0], data_i};
      if (take) last_q <= last_i;
      if (bad) bad_q <= 1'b1;
      if (emit) remaining_q <= remaining_q - 1'b1;
      if (emit && remaining_q[RemainingBits-1]) full_q <= 1'b1;
    end
    if (state_q == Place) begin
      unique case ({last_row_q, last_column})
        2'b00: remaining_q <= RemainingBits'(Tile * Tile - 2);
        2'b01: remaining_q <= RemainingBits'((int'(CutX) + 1) * Tile - 2);
        2'b10: remaining_q <= RemainingBits'(Tile * (int'(CutY) + 1) - 2);
        2'b11: remaining_q <= RemainingBits'((int'(CutX) + 1) * (int'(CutY) + 1) - 2);
      endcase
    end
  end

  // ---- buffer pixels, so that the ready path from the frame store ends here ----
  logic out_valid, out_ready;
  logic [23:0] out_rgb;
  assign into_valid = copies_q ? repeats : pixel_q;
  assign into_rgb = copies_q ? read_rgb_i : rgb_q;
  assign into = into_valid && into_ready;
  lipp_skid_buffer #(.Width(24)) i_buffer (
    .clk_i, .rst_ni, .clear_i(1'b0), .in_valid_i(into_valid), .in_ready_o(into_ready),
    .in_data_i(into_rgb), .out_valid_o(out_valid), .out_ready_i(out_ready), .out_data_o(out_rgb)
  );
  logic [31:0] crc_q;
  logic hash_valid_q;  // 1: hashed_q is a pixel that the CRC must include
  logic [23:0] hashed_q;
  assign crc_o = ~crc_q;
  always_ff @(posedge clk_i) begin
    if (start) crc_q <= lipp_link_pkg::CrcStart;
    else if (hash_valid_q) crc_q <= lipp_link_pkg::crc32_pixel(crc_q, hashed_q);
    hashed_q <= into_rgb;
  end

  // ---- for each row: request a copy, request a write, write, wait for the frame store ----
  typedef enum logic [1:0] {Ask, Offer, Fill, Settle} row_e;
  row_e row_q;
  logic fills, ended, pads, x_last;  // ended: the decoder produces no more pixels
  logic [SideBits-1:0] x_q;
  logic placed;  // 1: the tile's row and column are known
  assign placed = state_q == Decode || state_q == Finish;
  assign ended = state_q == Finish && !pixel_q && !out_valid;
  assign pads = row_q == Fill && ended;
  assign read_valid_o = placed && row_q == Ask && copies_q && fill_q;
  assign write_valid_o = row_q == Offer && out_valid;
  assign write_pixel_valid_o = row_q == Fill && (out_valid || ended);
  assign fills = write_pixel_valid_o && write_pixel_ready_i;
  assign out_ready = fills && !pads;
  assign x_last = x_q == last_x_q;
  assign row_done = row_q == Settle && write_done_i;
  assign {write_buffer_o, read_buffer_o} = {buffer_q, !buffer_q};
  assign {write_first_o, read_first_o} = {2{row_at_q}};
  assign {write_count_o, read_count_o} = {2{(PlaceBits + 1)'(last_x_q) + 1'b1}};
  assign write_rgb_o = out_rgb;
  assign read_pixel_ready_o = copies_q && state_q == Decode && repeating && into_ready;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      row_q <= Ask;
    end else begin
      unique case (row_q)
        Ask: if (placed && !ended && (read_valid_o ? read_ready_i : !copies_q)) row_q <= Offer;
        Offer: if (write_valid_o && write_ready_i) row_q <= Fill;
          else if (ended) row_q <= Ask;
        Fill: if (fills && x_last) row_q <= Settle;
        default: if (row_done) row_q <= Ask;  // Settle
      endcase
    end
  end
  always_ff @(posedge clk_i) begin
    if (row_q != Fill) x_q <= '0;
    else if (fills) x_q <= x_q + 1'b1;
  end

  assign done_o = ended && row_q == Ask && !hash_valid_q;
  assign ok_o = full_q && !bad_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Idle;
      {pixel_q, hash_valid_q} <= '0;
    end else begin
      hash_valid_q <= into;
      pixel_q <= (emit && !full_q && !copies_q) || (pixel_q && !into_ready);
      unique case (state_q)
        Idle: if (start_i) state_q <= Locate;
        Locate: if (columns_q == 16'(Columns)) state_q <= Place;
        Place: state_q <= Decode;
        Decode: if (last_q && !repeating) state_q <= Finish;
        default: if (done_o) state_q <= Idle;  // Finish
      endcase
    end
  end

endmodule

`default_nettype wire
