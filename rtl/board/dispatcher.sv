`default_nettype none

/// Receives requests, has them executed, and replies: one request at a time, one reply to each.
///
/// Packets are streams of bytes without their CRC (docs/reference/protocol.md). No request is
/// executed before its packet has passed the CRC: packet_fifo passes on whole, correct packets
/// only. The words of a WRITE and the rays of a TRACE are collected before the first is used, so
/// that a request of a wrong length has no effect, and neither has a WRITE to words that cannot be
/// written. WRITE and SIGN are executed once, in the order of their numbers (modulo 65536). If the
/// last one comes again, only its reply is sent again; an older one is refused.
///
/// A request is read at one byte a clock. Its reply starts when it is executed.
module dispatcher #(
  parameter int Width = 640,            // of the panel, in pixels
  parameter int Height = 480,
  parameter int ClockHz = 100_000_000
) (
  input  logic              clk_i,
  input  logic              rst_ni,
  input  logic [63:0]       identity_i,  // of panel and array
  input  logic [15:0]       epoch_i,

  input  logic              in_valid_i,
  output logic              in_ready_o,
  input  logic [7:0]        in_data_i,
  input  logic              in_last_i,
  output logic              out_valid_o,
  input  logic              out_ready_i,
  output logic [7:0]        out_data_o,
  output logic              out_last_o,

  // ---- registers: register_bus ----
  output logic              bus_start_o,
  output logic              bus_write_o,
  output logic [9:0]        bus_at_o,
  output logic [31:0]       bus_word_o,
  input  logic              bus_done_i,
  input  logic [31:0]       bus_word_i,
  input  logic              bus_error_i,

  // ---- tiles: tile_writer, tile_table ----
  output logic              tile_start_o,
  output logic [15:0]       tile_o,
  output logic [7:0]        tile_coding_o,
  output logic              tile_empty_o,
  output logic              tile_valid_o,
  input  logic              tile_ready_i,
  input  logic              tile_done_i,
  input  logic              tile_ok_i,
  output logic              stale_o,         // TILE or PRESENT of another epoch
  output logic              tile_bad_o,
  input  logic              table_busy_i,    // cleared after reset: no request is accepted
  output logic              table_front_o,   // buffer whose entry is read
  output logic [15:0]       table_at_o,
  input  logic [31:0]       table_crc_i,     // at most 3 clocks after table_at_o

  // ---- frames: presenter ----
  output logic              present_start_o,
  output logic [15:0]       present_epoch_o,
  output logic [31:0]       present_crc_o,
  input  logic              present_done_i,
  input  link_pkg::status_e present_status_i,

  // ---- rays: optics_block, ray_signature ----
  output logic              ray_valid_o,
  input  logic              ray_ready_i,
  output logic [3:0][31:0]  ray_o,           // u, v, a, b
  output logic              trace_o,         // exit rays go here, else to the signature
  input  logic              exit_valid_i,
  output logic              exit_ready_o,
  input  logic [8:0][31:0]  exit_i,
  output logic              sign_start_o,
  input  logic              sign_done_i,
  input  logic [31:0]       sign_rays_i,
  input  logic [31:0]       sign_crc_i
);
  import link_pkg::*;

  localparam int Columns = (Width + 31) / 32;
  localparam int Tiles = Columns * ((Height + 31) / 32);
  localparam logic [7:0] ProtocolVersion = 8'd1;
  localparam int ReplyBytes = 34;  // of the longest reply without words, that of HELLO
  localparam logic [9:0] AtOptics = 10'h200;
  localparam logic [9:0] AtBuild = AtOptics + 10'h008, AtControl = AtOptics + 10'h00C;
  localparam logic [9:0] AtStatus = AtOptics + 10'h010, AtSource = AtOptics + 10'h014;
  localparam logic [31:0] Apply = 32'd1, Start = 32'd2;

  typedef enum logic [4:0] {
    AtType, AtNumberLow, AtNumberHigh, AtArguments, AtWords, AtTile, Swallow, Execute,
    HelloBuild, ReadAsk, ReadWait, WriteCheck, WriteAsk, WriteWait, TileWait, PresentWait, TableWait,
    SourceWait, ApplyWait, StatusAsk, StatusWait, RayFetch, RayOffer, RayWait, SignWait, Answer,
    Words
  } state_e;
  state_e state_q, refused;
  // A refused request is read to its end.
  assign refused = in_last_i ? Answer : Swallow;

  // ---- the request: type, number, arguments ----
  request_e type_q;
  logic [15:0] number_q;
  logic [5:0][7:0] arguments_q;
  logic [2:0] argument_q;
  status_e status_q;
  logic take;
  assign in_ready_o = (state_q == AtType && !table_busy_i)
      || state_q inside {AtNumberLow, AtNumberHigh, AtArguments, AtWords, Swallow}
      || (state_q == AtTile && tile_ready_i);
  assign take = in_valid_i && in_ready_o;

  function automatic logic [2:0] arguments_of(request_e request);
    case (request)
      RequestHello, RequestTile, RequestTiles: return 3'd5;
      RequestRead: return 3'd3;
      RequestWrite: return 3'd2;
      RequestPresent: return 3'd6;
      default: return 3'd0;
    endcase
  endfunction

  // The arguments, once all have been received.
  logic [15:0] first, second;  // the first two words of 16 bits
  logic [31:0] long_word;      // bytes 1 to 4, or those after the first two
  assign first = arguments_q[1:0];
  assign second = arguments_q[3:2];
  assign long_word = type_q == RequestPresent ? arguments_q[5:2] : arguments_q[4:1];

  // ---- words of a WRITE or a TRACE, collected ----
  logic [31:0] words[256];
  logic [23:0] collected_q;  // the word's bytes so far
  logic [31:0] word_q;
  logic [8:0] words_q;       // number of collected words
  logic [1:0] byte_q;        // byte of the word being received
  logic [8:0] at_q;          // index of the word in use, or of a table's entry
  logic collect_word;
  assign collect_word = state_q == AtWords && take && byte_q == 2'd3 && !words_q[8];
  always_ff @(posedge clk_i) begin
    if (state_q == AtWords && take) collected_q <= {in_data_i, collected_q[23:8]};
    if (collect_word) words[words_q[7:0]] <= {in_data_i, collected_q};
    word_q <= words[at_q[7:0]];
  end

  // ---- the number executed last ----
  // It expires before the numbers wrap so far that newer ones would seem older.
  logic executed_q;
  request_e executed_type_q;
  logic [15:0] executed_number_q, newest_q, newest, after;
  logic forget;
  status_e executed_status_q;
  logic [31:0] nonce_q;         // of the session
  logic once, repeated, older;  // executed at most once; the last one again; older than it
  assign once = type_q == RequestWrite || type_q == RequestSign;
  assign after = number_q - executed_number_q;
  assign repeated = executed_q && executed_type_q == type_q && after == '0;
  assign older = executed_q && !repeated && (after == '0 || after >= 16'h8000);
  always_comb begin
    newest = newest_q;
    if (16'(number_q - newest_q) < 16'h8000) newest = number_q;
    forget = 16'(newest - executed_number_q) >= 16'h8000;
  end

  // ---- ranges ----
  // A range of registers is valid if it begins and ends in one block.
  logic [8:0] count;
  logic [16:0] behind;
  logic aligned, in_board, in_optics, addresses_ok, length_ok, tiles_ok;
  assign count = type_q == RequestRead ? {1'b0, arguments_q[2]} : words_q;
  assign behind = {1'b0, first} + {6'd0, count, 2'd0};
  assign aligned = first[1:0] == '0;
  assign in_board = behind <= 17'h100;
  assign in_optics = first >= 16'(AtOptics) && behind <= 17'h400;
  assign addresses_ok = aligned && (in_board || in_optics);
  logic [15:0] table_first, table_count;
  assign table_first = arguments_q[2:1];
  assign table_count = arguments_q[4:3];
  assign tiles_ok = {1'b0, table_first} + {1'b0, table_count} <= 17'(Tiles)
      && arguments_q[0] <= 8'd1;
  always_comb begin
    case (type_q)
      RequestRead: length_ok = count != '0 && count <= 9'd64;
      RequestWrite: length_ok = words_q != '0 && words_q <= 9'd64;
      RequestTiles: length_ok = table_count != '0 && table_count <= 16'd512;
      RequestTrace: length_ok = words_q != '0 && words_q[1:0] == '0;
      default: length_ok = 1'b1;
    endcase
  end

  // ---- replies ----
  logic load, load_last, reply_busy;
  logic [8*ReplyBytes-1:0] reply;
  logic [$clog2(ReplyBytes+1)-1:0] reply_bytes;
  logic [31:0] stream_word_q;  // word of a reply
  logic [9:0] left_q;          // remaining words of the reply
  logic [31:0] build_q;
  logic [31:0] head;
  assign head = {status_q, number_q, ReplyBit | type_q};
  always_comb begin
    reply = (8 * ReplyBytes)'(head);
    reply_bytes = 6'd4;
    load_last = 1'b1;
    if (state_q == Words) begin
      reply = (8 * ReplyBytes)'(stream_word_q);
      load_last = left_q == 10'd1;
    end else if (status_q == StatusOk) begin
      case (type_q)
        RequestHello: begin
          reply = {
            build_q, epoch_i, 32'(ClockHz), 16'(MaxPacket), 8'd32, 16'(Height), 16'(Width),
            identity_i, long_word, ProtocolVersion, head
          };
          reply_bytes = 6'd34;
        end
        RequestTile: begin
          reply = (8 * ReplyBytes)'({second, head});
          reply_bytes = 6'd6;
        end
        RequestPresent: begin
          reply = (8 * ReplyBytes)'({epoch_i, head});
          reply_bytes = 6'd6;
        end
        RequestTiles: begin
          reply = (8 * ReplyBytes)'({table_first, epoch_i, head});
          reply_bytes = 6'd8;
          load_last = 1'b0;
        end
        RequestSign: begin
          reply = (8 * ReplyBytes)'({sign_crc_i, sign_rays_i, head});
          reply_bytes = 6'd12;
        end
        RequestRead, RequestTrace: load_last = 1'b0;
        default: ;
      endcase
    end
  end
  assign load = (state_q == Answer || state_q == Words) && !reply_busy;
  reply_writer #(.Bytes(ReplyBytes)) i_reply_writer (
    .clk_i, .rst_ni, .load_i(load), .bytes_i(reply), .count_i(reply_bytes), .last_i(load_last),
    .busy_o(reply_busy), .valid_o(out_valid_o), .ready_i(out_ready_i), .data_o(out_data_o),
    .last_o(out_last_o)
  );

  // ---- outputs to other modules ----
  assign tile_o = second;
  assign tile_coding_o = arguments_q[4];
  assign tile_valid_o = state_q == AtTile && in_valid_i;
  assign table_front_o = arguments_q[0][0];
  assign table_at_o = table_first + 16'(at_q);
  assign present_epoch_o = first;
  assign present_crc_o = long_word;
  assign ray_valid_o = state_q == RayOffer;
  assign trace_o = type_q == RequestTrace;
  logic [3:0] exit_word_q;   // word of a traced ray: sent, or being sent
  logic [8:0][31:0] exit_q;
  assign exit_ready_o = state_q == RayWait;

  // ---- states ----
  logic [1:0] pause_q;  // clocks until a memory's answer
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= AtType;
      type_q <= RequestHello;
      executed_type_q <= RequestHello;
      {status_q, executed_status_q} <= {StatusOk, StatusOk};
      {number_q, arguments_q, argument_q, words_q, byte_q, at_q} <= '0;
      {executed_q, executed_number_q, newest_q, nonce_q} <= '0;
      {stream_word_q, left_q, build_q} <= '0;
      {tile_empty_o, exit_word_q, exit_q, ray_o, pause_q} <= '0;
      {bus_start_o, bus_write_o, bus_at_o, bus_word_o} <= '0;
      {tile_start_o, stale_o, tile_bad_o, present_start_o, sign_start_o} <= '0;
    end else begin
      bus_start_o <= 1'b0;
      tile_start_o <= 1'b0;
      stale_o <= 1'b0;
      tile_bad_o <= 1'b0;
      present_start_o <= 1'b0;
      sign_start_o <= 1'b0;
      if (pause_q != '0) pause_q <= pause_q - 1'b1;

      case (state_q)
        // ---- receiving the request ----
        AtType: if (take) begin
          type_q <= request_e'(in_data_i);
          status_q <= StatusOk;
          {argument_q, words_q, byte_q, at_q, exit_word_q} <= '0;
          state_q <= AtNumberLow;
        end
        AtNumberLow: if (take) begin
          number_q[7:0] <= in_data_i;
          state_q <= AtNumberHigh;
        end
        AtNumberHigh: if (take) begin
          number_q[15:8] <= in_data_i;
          if (!(type_q inside {RequestHello, RequestRead, RequestWrite, RequestTile, RequestPresent,
              RequestTiles, RequestTrace, RequestSign})) begin
            status_q <= StatusUnknown;
            state_q <= refused;
          end else if (in_last_i != (type_q == RequestSign)) begin
            status_q <= StatusLength;
            state_q <= refused;
          end else begin
            case (type_q)
              RequestSign: state_q <= Execute;
              RequestTrace: state_q <= AtWords;
              default: state_q <= AtArguments;
            endcase
          end
        end
        AtArguments: if (take) begin
          arguments_q[argument_q] <= in_data_i;
          argument_q <= argument_q + 1'b1;
          if (argument_q + 1'b1 != arguments_of(type_q)) begin
            if (in_last_i) begin
              status_q <= StatusLength;
              state_q <= refused;
            end
          end else if (type_q == RequestTile) begin
            tile_empty_o <= in_last_i;
            if (first != epoch_i) begin
              status_q <= StatusStale;
              stale_o <= 1'b1;
              state_q <= refused;
            end else if (second >= 16'(Tiles)) begin
              status_q <= StatusNoTile;
              state_q <= refused;
            end else begin
              tile_start_o <= 1'b1;
              state_q <= in_last_i ? TileWait : AtTile;
            end
          end else if (in_last_i == (type_q == RequestWrite)) begin
            status_q <= StatusLength;
            state_q <= refused;
          end else begin
            state_q <= type_q == RequestWrite ? AtWords : Execute;
          end
        end
        AtWords: if (take) begin
          byte_q <= byte_q + 1'b1;
          if (collect_word) words_q <= words_q + 1'b1;
          if (words_q[8] || (in_last_i && byte_q != 2'd3)) begin  // no room, or an incomplete word
            status_q <= StatusLength;
            state_q <= refused;
          end else if (in_last_i) begin
            state_q <= Execute;
          end
        end
        AtTile: if (take && in_last_i) state_q <= TileWait;
        Swallow: if (take && in_last_i) state_q <= Answer;

        // ---- executing it ----
        Execute: begin
          state_q <= Answer;
          if (!length_ok) begin
            status_q <= StatusLength;
          end else if (once && repeated) begin
            status_q <= executed_status_q;
          end else if (once && older) begin
            status_q <= StatusStale;
            stale_o <= 1'b1;
          end else begin
            case (type_q)
              RequestHello: begin
                if (arguments_q[0] != ProtocolVersion) begin
                  status_q <= StatusVersion;
                end else begin
                  if (long_word != nonce_q) begin
                    executed_q <= 1'b0;
                    newest_q <= number_q;
                    nonce_q <= long_word;
                  end
                  {bus_start_o, bus_write_o, bus_at_o} <= {1'b1, 1'b0, AtBuild};
                  state_q <= HelloBuild;
                end
              end
              RequestRead: begin
                left_q <= {1'b0, count};
                if (!addresses_ok) status_q <= StatusAddress;
              end
              RequestWrite: begin
                if (!addresses_ok) status_q <= StatusAddress;
                else state_q <= WriteCheck;
              end
              RequestPresent: begin
                present_start_o <= 1'b1;
                state_q <= PresentWait;
              end
              RequestTiles: begin
                left_q <= table_count[9:0];
                if (!tiles_ok) status_q <= StatusNoTile;
              end
              default: begin  // TRACE and SIGN: rays from the stream, or from the raster
                left_q <= {1'b0, words_q};
                {bus_start_o, bus_write_o, bus_at_o} <= {1'b1, 1'b1, AtSource};
                bus_word_o <= 32'(type_q == RequestTrace);
                state_q <= SourceWait;
              end
            endcase
          end
        end
        HelloBuild: if (bus_done_i) begin
          build_q <= bus_word_i;
          state_q <= Answer;
        end
        WriteCheck: begin
          at_q <= at_q + 1'b1;
          if (!board_map_pkg::writable(first[9:0] + {at_q[7:0], 2'd0})) begin
            status_q <= StatusAddress;
            state_q <= Answer;
          end else if (at_q + 1'b1 == words_q) begin
            at_q <= '0;
            pause_q <= 2'd1;
            state_q <= WriteAsk;
          end
        end
        WriteAsk: if (pause_q == '0) begin
          {bus_start_o, bus_write_o, bus_at_o} <= {1'b1, 1'b1, first[9:0] + {at_q[7:0], 2'd0}};
          bus_word_o <= word_q;
          at_q <= at_q + 1'b1;
          state_q <= WriteWait;
        end
        WriteWait: if (bus_done_i) begin
          if (bus_error_i) status_q <= StatusAddress;
          state_q <= at_q == words_q ? Answer : WriteAsk;
          pause_q <= 2'd1;
        end
        TileWait: if (tile_done_i) begin
          if (!tile_ok_i) status_q <= StatusTile;
          tile_bad_o <= !tile_ok_i;
          state_q <= Answer;
        end
        PresentWait: if (present_done_i) begin
          status_q <= present_status_i;
          stale_o <= present_status_i == StatusStale;
          state_q <= Answer;
        end
        SourceWait: if (bus_done_i) begin
          {bus_start_o, bus_write_o, bus_at_o, bus_word_o} <= {1'b1, 1'b1, AtControl, Apply};
          state_q <= ApplyWait;
        end
        ApplyWait: if (bus_done_i) state_q <= StatusAsk;
        StatusAsk: begin
          {bus_start_o, bus_write_o, bus_at_o} <= {1'b1, 1'b0, AtStatus};
          state_q <= StatusWait;
        end
        StatusWait: if (bus_done_i) begin
          if (bus_word_i[0]) begin  // busy: the new optics are not yet in effect
            state_q <= StatusAsk;
          end else if (type_q == RequestTrace) begin
            state_q <= Answer;
          end else begin
            sign_start_o <= 1'b1;
            {bus_start_o, bus_write_o, bus_at_o, bus_word_o} <= {1'b1, 1'b1, AtControl, Start};
            state_q <= SignWait;
          end
        end
        SignWait: if (bus_done_i) begin
          // The status is polled, since a refused frame gives no rays. The reply waits for the last
          // answer of the bus, which the next request would otherwise take for its own.
          if (!bus_write_o && (sign_done_i || bus_word_i[2])) begin
            if (!sign_done_i) status_q <= StatusOptics;
            state_q <= Answer;
          end else begin
            {bus_start_o, bus_write_o, bus_at_o} <= {1'b1, 1'b0, AtStatus};
          end
        end

        // ---- the reply ----
        Answer: if (!reply_busy) begin
          newest_q <= newest;
          if (once && status_q != StatusLength && !older) begin
            executed_q <= 16'(newest - number_q) < 16'h8000;
            {executed_type_q, executed_number_q} <= {type_q, number_q};
            executed_status_q <= status_q;
          end else if (forget) begin
            executed_q <= 1'b0;
          end
          at_q <= '0;
          pause_q <= 2'd3;
          state_q <= AtType;
          if (status_q == StatusOk) begin
            case (type_q)
              RequestRead: state_q <= ReadAsk;
              RequestTiles: state_q <= TableWait;
              RequestTrace: state_q <= RayFetch;
              default: ;
            endcase
          end
        end
        ReadAsk: begin
          {bus_start_o, bus_write_o, bus_at_o} <= {1'b1, 1'b0, first[9:0] + {at_q[7:0], 2'd0}};
          at_q <= at_q + 1'b1;
          state_q <= ReadWait;
        end
        ReadWait: if (bus_done_i) begin
          stream_word_q <= bus_error_i ? '0 : bus_word_i;  // 0 at an address without a register
          state_q <= Words;
        end
        TableWait: if (pause_q == '0) begin
          stream_word_q <= table_crc_i;
          at_q <= at_q + 1'b1;
          state_q <= Words;
        end
        RayFetch: if (pause_q == '0) begin
          ray_o <= {word_q, ray_o[3:1]};
          at_q <= at_q + 1'b1;
          pause_q <= 2'd1;
          if (at_q[1:0] == 2'd3) state_q <= RayOffer;
        end
        RayOffer: if (ray_ready_i) state_q <= RayWait;
        RayWait: if (exit_valid_i) begin
          {exit_q, stream_word_q} <= {32'd0, exit_i};
          exit_word_q <= 4'd9;
          // The words of earlier rays are sent; this ray's 9 and those of later rays are left.
          left_q <= at_q == words_q ? 10'd9 : 10'd10;
          state_q <= Words;
        end
        Words: if (!reply_busy) begin
          left_q <= left_q - 1'b1;
          pause_q <= 2'd3;
          exit_word_q <= exit_word_q - 1'b1;
          {exit_q, stream_word_q} <= {32'd0, exit_q};
          case (type_q)
            RequestRead: state_q <= ReadAsk;
            RequestTiles: state_q <= TableWait;
            default: if (exit_word_q == 4'd1) state_q <= RayFetch;
          endcase
          if (left_q == 10'd1) state_q <= AtType;
        end
        default: state_q <= AtType;
      endcase
    end
  end

endmodule

`default_nettype wire
