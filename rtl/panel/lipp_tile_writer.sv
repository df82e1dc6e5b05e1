// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Decodes one tile from a packet and writes it into a buffer of the frame store.
///
/// start_i copies the parameters; it is ignored while a tile is being written. The packet's data
/// follow as a stream with its last byte marked, unless empty_i is high: no data. A pixel is
/// written each clock, or as fast as the bytes arrive:
///
///   CodingRaw    R, G, B of each pixel
///   CodingSolid  R, G, B of all
///   CodingQoi    operations of QOI without its header and end marker, except QOI_OP_RGBA: every
///                pixel's alpha is 255; the previous pixel and the index start as black
///   CodingCopy   no data: the pixels at the same position of the other buffer
///
/// done_o is a pulse after the last byte and the last write. If ok_o is high with it, the data had
/// exactly the tile's number of pixels, and crc_o is the CRC-32 of their bytes, row by row.
/// Otherwise the data were invalid, or the panel has no such tile or coding; the rest of the packet
/// was discarded, and the tile may be partly written. Nothing outside of the tile is ever written.
///
/// From start_i to done_o: a clock for each byte, one for each pixel without a byte of its own, and
/// ReadLatency + 4 + ceil(log2(rows of tiles)) more. A single row of tiles takes ReadLatency + 5.
module lipp_tile_writer #(
  parameter int Width = 640,
  parameter int Height = 480,
  parameter int ReadLatency = 2,  // 1 or more
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

  output logic                 write_o,
  output logic                 write_buffer_o,
  output logic [PlaceBits-1:0] write_at_o,
  output logic [23:0]          write_rgb_o,

  output logic                 copy_buffer_o,
  output logic [PlaceBits-1:0] copy_at_o,
  input  logic [23:0]          copy_rgb_i   // ReadLatency clocks after its address
);
  import lipp_panel_pkg::*;

  localparam int Columns = tiles(Width);
  localparam int Rows = tiles(Height);
  localparam int RowBits = Rows > 1 ? $clog2(Rows) : 1;
  localparam int SideBits = $clog2(Tile);
  localparam int LeftBits = 2 * SideBits + 1;
  // Last index along a side of a tile: for the last tile of a row or column, and for the others.
  localparam logic [SideBits-1:0] Whole = SideBits'(Tile - 1);
  localparam logic [SideBits-1:0] CutX = SideBits'((Width - 1) % Tile);
  localparam logic [SideBits-1:0] CutY = SideBits'((Height - 1) % Tile);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_tile_writer: Width and Height must be 1 to 16383");
  end
  if (ReadLatency < 1) begin : gen_illegal_latency
    $fatal(1, "lipp_tile_writer: ReadLatency must be 1 or more");
  end
  if (Columns * Rows >= 1 << 16) begin : gen_illegal
    $fatal(1, "lipp_tile_writer: the panel must have fewer than 65536 tiles");
  end

  typedef enum logic [2:0] {Idle, Locate, Place, Decode, Finish} state_e;
  state_e state_q;
  coding_e coding_q;
  logic buffer_q, last_q, bad_q, full_q;
  logic start, take, emit;
  logic [ReadLatency:0] write_q;  // a pixel was decoded, clocks ago less one
  assign start = start_i && state_q == Idle;
  assign take = valid_i && ready_o;

  // ---- the tile's position: its row by division, one bit a clock ----
  logic [15:0] rest_q;     // the tile's number, in the end its column
  logic [15:0] columns_q;  // 2^k rows of tiles, in tiles
  logic [PlaceBits-1:0] rows_q;  // the same as an address in the store
  logic [SideBits-1:0] x_q, last_x_q;
  logic last_column, last_row_q;  // of tiles
  logic [PlaceBits-1:0] row_at_q, at_q, tile_at, next_row_at;
  logic end_of_row, missing;
  assign missing = int'(tile_i) >= Columns * Rows;
  assign tile_at = row_at_q + PlaceBits'({rest_q, SideBits'(0)});
  assign last_column = rest_q == 16'(Columns - 1);
  assign end_of_row = x_q == last_x_q;
  assign next_row_at = row_at_q + PlaceBits'(Width);

  always_ff @(posedge clk_i) begin
    if (start) begin
      rest_q <= tile_i;
      columns_q <= 16'(Columns << (RowBits - 1));
      rows_q <= PlaceBits'((Tile * Width) << (RowBits - 1));
      row_at_q <= '0;
      last_row_q <= int'(tile_i) >= Columns * (Rows - 1);
      x_q <= '0;
    end
    if (state_q == Locate) begin
      columns_q <= columns_q >> 1;
      rows_q <= rows_q >> 1;
      if (rest_q >= columns_q) begin
        rest_q <= rest_q - columns_q;
        row_at_q <= row_at_q + rows_q;
      end
    end
    if (state_q == Place) begin
      last_x_q <= last_column ? CutX : Whole;
      row_at_q <= tile_at;
      at_q <= tile_at;
    end
    if (write_q[0]) begin
      x_q <= end_of_row ? '0 : x_q + 1'b1;
      at_q <= end_of_row ? next_row_at : at_q + 1'b1;
      if (end_of_row) row_at_q <= next_row_at;
    end
  end

  // ---- QOI's index of pixels; it always contains the previous pixel ----
  // A block memory's output comes late in the clock.
  (* ram_style = "distributed" *) logic [23:0] index[64];
  logic [63:0] known_q;
  logic [23:0] rgb_q, indexed;
  logic [5:0] hash;            // of rgb_q: (3 r + 5 g + 7 b + 11 * 255) mod 64
  logic [5:0] hash_q, more_q;  // its two summands
  localparam logic [5:0] BlackHash = 6'(11 * 255);
  logic known, previous;
  assign known = known_q[data_i[5:0]];
  assign hash = hash_q + more_q;
  assign previous = data_i[5:0] == hash;
  assign indexed = previous ? rgb_q : known ? index[data_i[5:0]] : '0;
  always_ff @(posedge clk_i) begin
    if (start) known_q <= '0;
    else if (write_q[0]) begin  // rgb_q is a pixel
      known_q[hash] <= 1'b1;
      index[hash] <= rgb_q;
    end
  end

  // ---- bytes to pixels ----
  logic [1:0] want_q, want_d;  // remaining bytes of the operation
  logic [15:0] before_q;       // the two previous bytes
  logic luma_q, luma_d;
  logic [6:0] run_q, run_d;    // remaining repetitions of the pixel less 1: none if negative
  logic fill_q, fill_d;        // the pixel, or the copy, continues to the tile's end
  logic [LeftBits-1:0] left_q; // pixels of the tile to come, less 2: negative at the last
  logic draws, moves, wrong;   // of a byte: a pixel, a part of one, none that QOI has here
  logic step, repeats, bad, repeating, colour, look_up;
  logic [23:0] rgb, difference;
  logic [5:0] hash_d, more_d;

  assign repeating = !run_q[6] || fill_q;
  assign ready_o = state_q == Decode && !repeating && !last_q;

  // The next pixel is this one plus a difference, black plus a difference, or one of the index. Its
  // hash follows from the same operation, since the hash of a sum is a sum: 3 r + 5 g + 7 b, modulo
  // 64, in sums, for six bits are too few for multiplier cells. QOI_OP_LUMA moves the pixel twice.
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
      {hash_d, more_d} = {previous || known ? data_i[5:0] : BlackHash, 6'd0};
    end
  end

  // What the byte at the input does, should it be taken: the choice does not wait for that.
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
        2'b10: begin  // the rest of the differences of red and blue comes with the second byte
          {draws, moves, want_d, luma_d} = {1'b0, 1'b1, 2'd1, 1'b1};
          difference = {
            {2'd0, data_i[5:0]} - 8'd40, {2'd0, data_i[5:0]} - 8'd32, {2'd0, data_i[5:0]} - 8'd40
          };
        end
        2'b11: run_d = {1'b0, data_i[5:0]} - 7'd1;
      endcase
    end
  end
  assign repeats = state_q == Decode && repeating;
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
      fill_q <= coding_i == CodingCopy && empty_i && !missing;
      last_q <= empty_i;
      bad_q <= missing || coding_i > CodingCopy || (coding_i == CodingCopy && !empty_i);
    end else begin
      if (step) {want_q, luma_q, run_q} <= {want_d, luma_d, run_d};
      else if (repeats && !run_q[6]) run_q <= run_q - 1'b1;
      fill_q <= (step ? fill_d : fill_q) && !(emit && left_q[LeftBits-1]);
      if (step && (draws || moves)) {rgb_q, hash_q, more_q} <= {rgb, hash_d, more_d};
      if (take) before_q <= {before_q[7:0], data_i};
      if (take) last_q <= last_i;
      if (bad) bad_q <= 1'b1;
      if (emit) left_q <= left_q - 1'b1;
      if (emit && left_q[LeftBits-1]) full_q <= 1'b1;
    end
    if (state_q == Place) begin
      unique case ({last_row_q, last_column})
        2'b00: left_q <= LeftBits'(Tile * Tile - 2);
        2'b01: left_q <= LeftBits'((int'(CutX) + 1) * Tile - 2);
        2'b10: left_q <= LeftBits'(Tile * (int'(CutY) + 1) - 2);
        2'b11: left_q <= LeftBits'((int'(CutX) + 1) * (int'(CutY) + 1) - 2);
      endcase
    end
  end

  // ---- pixels to the store, ReadLatency clocks later: a copied pixel has arrived by then ----
  logic [ReadLatency:1][PlaceBits-1:0] write_at_q;
  logic [ReadLatency:1][23:0] written_q;
  logic [31:0] crc_q;
  logic hash_valid_q;  // a pixel of the CRC, a clock after the store's
  logic [23:0] hashed_q;
  assign copy_buffer_o = !buffer_q;
  assign copy_at_o = at_q;
  assign write_o = write_q[ReadLatency];
  assign write_buffer_o = buffer_q;
  assign write_at_o = write_at_q[ReadLatency];
  assign write_rgb_o = coding_q == CodingCopy ? copy_rgb_i : written_q[ReadLatency];
  assign crc_o = ~crc_q;
  always_ff @(posedge clk_i) begin
    write_at_q <= (ReadLatency * PlaceBits)'({write_at_q, at_q});
    written_q <= (24 * ReadLatency)'({written_q, rgb_q});
    if (start) crc_q <= lipp_link_pkg::CrcStart;
    else if (hash_valid_q) crc_q <= lipp_link_pkg::crc32_pixel(crc_q, hashed_q);
    hashed_q <= write_rgb_o;
  end

  assign done_o = state_q == Finish && write_q == '0 && !hash_valid_q;
  assign ok_o = full_q && !bad_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Idle;
      {write_q, hash_valid_q} <= '0;
    end else begin
      hash_valid_q <= write_o;
      write_q <= (ReadLatency + 1)'({write_q, emit && !full_q});
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
