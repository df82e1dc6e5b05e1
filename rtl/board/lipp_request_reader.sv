// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Reads a request from a stream of bytes: its type, number and arguments.
///
/// The words of WRITE, TRACE and BLOCK are collected in a memory. The data of a TILE go through one
/// register to tile_writer, because a whole tile does not fit into the memory of this module. The
/// reader also reads a refused request to its last byte. A TRACE is refused with StatusLength if
/// its pixel (u, v) does not fit into PixelBits bits.
///
/// Output done_o is high from two clocks after the last byte until next_i, and no byte is accepted
/// while done_o is high. Output status_o is valid while done_o is high. Output request_o is valid
/// from one clock before done_o. Each request has 3 bytes or more: packet_fifo drops shorter
/// packets.
module lipp_request_reader #(
  parameter int Width = 640,   // the panel's width in pixels
  parameter int Height = 480,  // the panel's height in pixels
  parameter bit Scene = 1'b0   // 1: the requests BLOCK and BLOCKS are supported
) (
  input  logic               clk_i,
  input  logic               rst_ni,
  input  logic [15:0]        epoch_i,
  input  logic               open_i,        // 1: the first byte of a request may be accepted

  input  logic               in_valid_i,
  output logic               in_ready_o,
  input  logic [7:0]         in_data_i,
  input  logic               in_last_i,

  output logic                         done_o,
  input  logic                         next_i,
  output lipp_link_pkg::request_t      request_o,
  // StatusOk, or the reason why the request is refused
  output lipp_link_pkg::reply_status_e status_o,
  input  logic [7:0]                   word_at_i,  // index of the collected word to read
  output logic [31:0]                  word_o,     // collected word at word_at_i, two clocks later

  output logic               tile_start_o,  // pulse: a TILE starts; request_o describes it
  output logic               tile_empty_o,  // with tile_start_o, 1: the tile has no data bytes
  output logic               tile_valid_o,
  input  logic               tile_ready_i,
  output logic [7:0]         tile_data_o,
  output logic               tile_last_o
);
  import lipp_link_pkg::*;
  import lipp_optics_pkg::PixelBits, lipp_optics_pkg::beyond_bits;

  localparam int Tiles = lipp_panel_pkg::tiles(Width) * lipp_panel_pkg::tiles(Height);

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_request_reader: Width and Height must be 1 to 16383");
  end

  typedef enum logic [2:0] {
    Kind, NumberLow, NumberHigh, Arguments, Words, Tile, Rest, Done
  } state_e;
  state_e state_q, refused;
  assign refused = in_last_i ? Done : Rest;

  request_t request_q;
  reply_status_e status_q;
  logic tile_step, done_q, length_ok, length_ok_q;
  assign done_o = done_q;
  assign request_o = request_q;
  assign in_ready_o = (state_q == Kind && open_i)
      || state_q inside {NumberLow, NumberHigh, Arguments, Words, Rest}
      || (state_q == Tile && tile_step);

  function automatic logic [2:0] arguments_of(request_e kind);
    case (kind)
      RequestHello, RequestTile, RequestTiles: return 3'd5;
      RequestRead, RequestBlocks: return 3'd3;
      RequestWrite, RequestBlock: return 3'd2;
      RequestPresent: return 3'd6;
      default: return 3'd0;
    endcase
  endfunction

  // ---- collect bytes into words ----
  logic [31:0] words[256];
  logic [31:0] read_q;       // output register of the block RAM, for a faster clock
  logic [23:0] collected_q;  // bytes of the current word received so far
  logic [1:0] byte_q;        // index of the byte being received within its word
  logic [31:0] word;
  logic wide_q;              // 1: u or v of a TRACE exceeds PixelBits bits
  assign word = {in_data_i, collected_q};
  logic collect_word, full;
  assign full = request_q.words[8];
  assign collect_word = state_q == Words && in_valid_i && byte_q == 2'd3 && !full;
  always_ff @(posedge clk_i) begin
    if (state_q == Words && in_valid_i) collected_q <= {in_data_i, collected_q[23:8]};
    if (collect_word) words[request_q.words[7:0]] <= word;
    read_q <= words[word_at_i];
    word_o <= read_q;
  end

  // ---- count the bytes of the request ----
  logic [15:0] table_count;
  assign table_count = request_q.arguments[4:3];
  always_comb begin
    case (request_q.kind)
      RequestRead:
        length_ok = request_q.arguments[2] != '0 && request_q.arguments[2] <= 8'd64;
      RequestWrite: length_ok = request_q.words != '0 && request_q.words <= 9'd64;
      RequestBlock: length_ok = request_q.words == 9'(BlockWords);
      RequestBlocks: length_ok = request_q.arguments[2] != '0;
      RequestTiles: length_ok = table_count != '0 && table_count <= 16'd512;
      RequestTrace: length_ok = request_q.words != '0 && request_q.words[1:0] == '0 && !wide_q;
      default: length_ok = 1'b1;
    endcase
  end
  always_ff @(posedge clk_i) length_ok_q <= length_ok;
  assign status_o = status_q == StatusOk && !length_ok_q ? StatusLength : status_q;

  // ---- forward the data bytes of a TILE ----
  assign tile_step = !tile_valid_o || tile_ready_i;
  always_ff @(posedge clk_i) if (tile_step) {tile_last_o, tile_data_o} <= {in_last_i, in_data_i};
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) tile_valid_o <= 1'b0;
    else if (tile_step) tile_valid_o <= state_q == Tile && in_valid_i;
  end

  // ---- read the type, the number and the arguments ----
  logic [2:0] argument_q;
  logic [15:0] first, second;
  assign first = request_q.arguments[1:0];
  assign second = request_q.arguments[3:2];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Kind;
      request_q <= '{kind: RequestHello, number: '0, arguments: '0, words: '0, odd: 1'b0};
      status_q <= StatusOk;
      {argument_q, byte_q, wide_q, tile_start_o, tile_empty_o, done_q} <= '0;
    end else begin
      tile_start_o <= 1'b0;
      done_q <= state_q == Done && !next_i;
      case (state_q)
        Kind: if (in_valid_i && open_i) begin
          request_q.kind <= request_e'(in_data_i);
          request_q.words <= '0;
          status_q <= StatusOk;
          {argument_q, byte_q, wide_q} <= '0;
          state_q <= NumberLow;
        end
        NumberLow: if (in_valid_i) begin
          request_q.number[7:0] <= in_data_i;
          state_q <= NumberHigh;
        end
        NumberHigh: if (in_valid_i) begin
          request_q.number[15:8] <= in_data_i;
          if (!(request_q.kind inside {[RequestHello:RequestReset]} || (Scene
              && request_q.kind inside {RequestBlock, RequestBlocks}))) begin
            status_q <= StatusUnknown;
            state_q <= refused;
          end else if (in_last_i != (request_q.kind inside {[RequestSign:RequestReset]})) begin
            status_q <= StatusLength;
            state_q <= refused;
          end else if (in_last_i) begin
            state_q <= Done;
          end else begin
            state_q <= request_q.kind == RequestTrace ? Words : Arguments;
          end
        end
        Arguments: if (in_valid_i) begin
          request_q.arguments[argument_q] <= in_data_i;
          argument_q <= argument_q + 1'b1;
          if (argument_q + 1'b1 != arguments_of(request_q.kind)) begin
            if (in_last_i) begin
              status_q <= StatusLength;
              state_q <= Done;
            end
          end else if (request_q.kind == RequestTile) begin
            tile_empty_o <= in_last_i;
            if (first != epoch_i) begin
              status_q <= StatusStale;
              state_q <= refused;
            end else if (second >= 16'(Tiles)) begin
              status_q <= StatusNoTile;
              state_q <= refused;
            end else begin
              tile_start_o <= 1'b1;
              state_q <= in_last_i ? Done : Tile;
            end
          end else if (in_last_i == (request_q.kind inside {RequestWrite, RequestBlock})) begin
            status_q <= StatusLength;
            state_q <= refused;
          end else begin
            state_q <= in_last_i ? Done : Words;
          end
        end
        Words: if (in_valid_i) begin
          byte_q <= byte_q + 1'b1;
          if (collect_word) begin
            request_q.words <= request_q.words + 1'b1;
            if (request_q.words == '0) request_q.odd <= word[0];
            if (!request_q.words[1]) wide_q <= wide_q || beyond_bits(word, PixelBits);
          end
          // 1: the memory of words is full, or the last word is incomplete
          if (full || (in_last_i && byte_q != 2'd3)) begin
            status_q <= StatusLength;
            state_q <= refused;
          end else if (in_last_i) begin
            state_q <= Done;
          end
        end
        Tile: if (in_valid_i && tile_step && in_last_i) state_q <= Done;
        Rest: if (in_valid_i && in_last_i) state_q <= Done;
        default: if (next_i) state_q <= Kind;  // Done
      endcase
    end
  end

endmodule

`default_nettype wire
