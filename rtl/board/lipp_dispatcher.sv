// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Receives requests, starts the module that executes each request, and sends a reply to each.
///
/// The dispatcher executes one request at a time. Packets are byte streams without their CRC, as
/// described in docs/reference/protocol.md. Each request arrives with a checked CRC, because
/// packet_fifo forwards only complete, correct packets. A request of a wrong length has no effect.
/// The requests WRITE, SIGN, ABORT and RESET are executed once, in the order of their numbers. If
/// the host repeats the last executed request, the dispatcher only sends the reply again. A WRITE,
/// SIGN, ABORT or RESET with an older number is refused.
///
/// Every request gets a reply. No request waits forever: each module answers within the number of
/// clocks that its header states, and replies wait only for the serial line. A long task, such as a
/// frame of the raster, runs while further requests are answered.
///
/// A board that draws scenes (Layers > 0) implements version 3 of the protocol. With Layers = 0 the
/// board implements version 2. Output update_o is high while a WRITE changes the scene's registers,
/// because the registers are then inconsistent. Before a WRITE sets the scene's register `source`
/// to 1, the dispatcher switches the source of the optics from the raster to the stream.
///
/// The request reader accepts one byte per clock. The first byte of the reply is sent after the
/// request has been executed.
///
/// The dispatcher uses the following modules:
///
///   request_reader -> dispatcher -> reply_builder
///                      |  request_order: detects repeated requests
///                      |  register_access: READ, WRITE, HELLO
///                      |  ray_access: TRACE, SIGN, ABORT; permits a WRITE to the optics
///                      |  table_reader: TILES, BLOCKS
///                      +- tile_writer, presenter, slot_loader: TILE, PRESENT, BLOCK
module lipp_dispatcher #(
  parameter int Width = 640,   // the panel's width in pixels
  parameter int Height = 480,  // the panel's height in pixels
  parameter int ClockHz = 100_000_000,
  parameter int Layers = 0, // number of layers of the scene; 0: no scene
  parameter int Slots = 1,  // number of texture slots of the scene
  parameter int Blocks = 1  // number of 1024-byte blocks per texture slot
) (
  input  logic              clk_i,
  input  logic              rst_ni,
  input  logic [63:0]       identity_i,  // hash that identifies the panel and its lenslet array
  input  logic [15:0]       epoch_i,
  output logic              reset_o,     // high for 8 clocks: resets all but the link

  input  logic              in_valid_i,
  output logic              in_ready_o,
  input  logic [7:0]        in_data_i,
  input  logic              in_last_i,
  output logic              out_valid_o,
  input  logic              out_ready_i,
  output logic [7:0]        out_data_o,
  output logic              out_last_o,

  // ---- ports to register_bus: access one register ----
  output logic              bus_start_o,
  output logic              bus_write_o,
  output logic [10:0]       bus_at_o,
  output logic [31:0]       bus_word_o,
  input  logic              bus_done_i,
  input  logic [31:0]       bus_word_i,
  input  logic              bus_error_i,

  // ---- ports to tile_writer and tile_table: write a tile, read its CRC ----
  output logic              tile_start_o,
  output logic [15:0]       tile_o,
  output logic [7:0]        tile_coding_o,
  output logic              tile_empty_o,
  output logic              tile_valid_o,
  input  logic              tile_ready_i,
  output logic [7:0]        tile_data_o,
  output logic              tile_last_o,
  input  logic              tile_done_i,
  input  logic              tile_ok_i,
  output logic              stale_o,  // pulse: a request was refused as outdated (StatusStale)
  output logic              tile_bad_o,
  input  logic              table_busy_i,  // 1: reset is clearing the tile table
  output logic              table_front_o,   // 1: table_crc_i belongs to the front buffer
  output logic [15:0]       table_at_o,
  input  logic [31:0]       table_crc_i,     // entry at table_at_o, within 3 clocks

  // ---- ports to presenter: show a frame ----
  output logic                         present_start_o,
  output logic [15:0]                  present_epoch_o,
  output logic [31:0]                  present_crc_o,
  input  logic                         present_done_i,
  input  lipp_link_pkg::reply_status_e present_status_i,

  // ---- ports to optics_block and ray_signature: trace and sign rays ----
  output logic              ray_valid_o,
  input  logic              ray_ready_i,
  output logic [3:0][31:0]  ray_o,           // ray to trace; words u, v, a, b in [0] to [3]
  output logic              trace_o,         // 1: exit rays go to the dispatcher
  input  logic              exit_valid_i,
  output logic              exit_ready_o,
  input  logic [8:0][31:0]  exit_i,
  output logic              sign_o,          // 1: exit rays go to ray_signature
  output logic              sign_start_o,
  input  logic              sign_done_i,
  input  logic [31:0]       sign_rays_i,
  input  logic [31:0]       sign_crc_i,

  // ---- ports to draw_frame and slot_loader: load texture slots ----
  input  logic              drawn_i,         // 1: the optics draw the scene on the panel
  output logic              update_o,
  input  logic [15:0]       slots_i,         // bit k: slot k is shown or will be shown
  output logic              block_start_o,
  output logic [3:0]        block_slot_o,
  output logic [7:0]        block_o,
  input  logic [7:0]        block_word_at_i,
  output logic [31:0]       block_word_o,    // data word block_word_at_i, two clocks later
  input  logic              block_done_i,
  input  logic              blocks_busy_i,   // 1: reset is clearing the block table
  output logic [3:0]        blocks_slot_o,   // slot of the block table's entry to read
  output logic [7:0]        blocks_at_o,
  input  logic [31:0]       blocks_crc_i     // entry at blocks_at_o, within 3 clocks
);
  import lipp_link_pkg::*;

  localparam int Tiles = lipp_panel_pkg::tiles(Width) * lipp_panel_pkg::tiles(Height);
  localparam bit Scene = Layers > 0;
  localparam logic [7:0] ProtocolVersion = Scene ? 8'd3 : 8'd2;
  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_dispatcher: Width and Height must be 1 to 16383");
  end
  if (ClockHz < 1) begin : gen_illegal_clock
    $fatal(1, "lipp_dispatcher: ClockHz must be 1 or more");
  end
  if (Layers < 0 || Layers > 8 || Slots < 1
      || Slots > 15 || Blocks < 1 || Blocks > 256) begin : gen_illegal_scene
    $fatal(1, "lipp_dispatcher: Layers must be 0 to 8, Slots 1 to 15, and Blocks 1 to 256");
  end

  localparam int CurveBlocks = 8; // number of 1024-byte blocks of slot 15, the panel's curve
  localparam int HeadBytes = 34;  // number of bytes of the longest reply head, that of HELLO
  localparam logic [15:0] AtOptics = 16'h200, AtBuild = 16'h208, AtScene = 16'h400,
      AtDraw = 16'h40C;

  typedef enum logic [2:0] {Receive, Judge, Execute, Reply, Words} state_e;
  state_e state_q;
  reply_status_e status_q;
  logic executed_q;                    // 1: the request was executed, so i_order must remember it
  logic answer, reply_ready, reply_q;  // reply_q: the head of the reply is registered
  assign answer = state_q == Reply && reply_q && reply_ready;

  // ---- read the next request ----
  logic blocks_busy;
  request_t request;
  reply_status_e read_status;
  logic read_done, next;
  logic [7:0] word_at, register_word_at, ray_word_at;
  logic [31:0] word;
  lipp_request_reader #(.Width(Width), .Height(Height), .Scene(Scene)) i_reader (
    .clk_i, .rst_ni, .epoch_i, .open_i(!table_busy_i && !blocks_busy), .in_valid_i, .in_ready_o,
    .in_data_i,
    .in_last_i, .done_o(read_done), .next_i(next), .request_o(request), .status_o(read_status),
    .word_at_i(word_at), .word_o(word), .tile_start_o, .tile_empty_o, .tile_valid_o, .tile_ready_i,
    .tile_data_o, .tile_last_o
  );
  logic [15:0] first, second, table_first, table_count;
  logic [31:0] nonce;
  logic once;  // 1: a repeated request is not executed again
  assign {second, first} = request.arguments[3:0];
  assign {table_count, table_first} = request.arguments[4:1];
  assign nonce = request.arguments[4:1];
  assign once = request.kind inside {RequestWrite, [RequestSign:RequestReset]};
  always_comb begin
    case (request.kind)
      RequestTrace: word_at = ray_word_at;
      RequestBlock: word_at = Scene ? block_word_at_i : register_word_at;
      default: word_at = register_word_at;
    endcase
  end

  // ---- check if the request, which is stable from two clocks before state Judge, is legal ----
  logic no_block;  // 1: the requested slot or block does not exist
  logic no_tile, version, no_block_q, no_tile_q, version_q;
  // slot_in_use_q: the slot to load is on the panel or selected for it. Only a WRITE can select a
  // slot, and the dispatcher executes no WRITE while it checks a BLOCK.
  logic slot_in_use_q;
  reply_status_e refusal, refusal_q;
  assign version = request.arguments[0] == ProtocolVersion;
  assign no_tile = {1'b0, table_first} + {1'b0, table_count} > 17'(Tiles)
      || request.arguments[0] > 8'd1;
  always_comb begin
    refusal = StatusOk;
    case (request.kind)
      RequestHello: if (!version_q) refusal = StatusVersion;
      RequestTiles: if (no_tile_q) refusal = StatusNoTile;
      RequestBlock, RequestBlocks: if (no_block_q) refusal = StatusNoTile;
      default: ;
    endcase
    if (read_status != StatusOk) refusal = read_status;
  end
  always_ff @(posedge clk_i) begin
    {version_q, no_tile_q, no_block_q} <= {version, no_tile, no_block};
    slot_in_use_q <= slots_i[request.arguments[0][3:0]];
    refusal_q <= refusal;
  end

  // ---- find a request that was executed before ----
  logic repeated, older, hello;
  reply_status_e executed_status;
  lipp_request_order i_order (
    .clk_i, .rst_ni, .kind_i(request.kind), .number_i(request.number), .repeated_o(repeated),
    .older_o(older), .status_o(executed_status), .hello_i(hello), .nonce_i(nonce),
    .answer_i(answer), .executed_i(executed_q), .status_i(status_q)
  );

  // ---- access registers for READ, WRITE and HELLO ----
  logic register_start, register_done, register_valid, register_ready;
  logic register_bus_start, register_bus_write;
  logic [10:0] register_bus_at;
  logic [31:0] register_word, register_bus_word;
  reply_status_e register_status;
  logic is_hello, is_write;
  assign is_hello = request.kind == RequestHello;
  assign is_write = request.kind == RequestWrite;
  // on_optics, on_scene: the request is a WRITE to the optics block's or the scene's registers.
  // draws: the WRITE makes the panel show the scene.
  logic on_optics, on_scene, draws;
  assign on_optics = is_write && first >= AtOptics && (!Scene || first < AtScene);
  assign on_scene = Scene && is_write && first >= AtScene;
  // Register `source` is the first writable scene register, so a WRITE of `source` begins here.
  assign draws = on_scene && first == AtDraw && request.odd;
  // update_o rises one clock after state Execute begins, which is before the first register
  // changes. update_o falls after the last register has changed.
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) update_o <= 1'b0;
    else update_o <= on_scene && state_q == Execute;
  end
  lipp_register_access #(.Layers(Layers)) i_registers (
    .clk_i, .rst_ni, .start_i(register_start), .write_i(is_write),
    .first_i(is_hello ? AtBuild : first),
    .count_i(is_hello ? 9'd1 : is_write ? request.words : {1'b0, request.arguments[2]}),
    .done_o(register_done), .status_o(register_status),
    .word_at_o(register_word_at), .word_i(word), .word_valid_o(register_valid),
    .word_ready_i(register_ready), .word_o(register_word),
    .bus_start_o(register_bus_start), .bus_write_o(register_bus_write),
    .bus_at_o(register_bus_at), .bus_word_o(register_bus_word), .bus_done_i, .bus_word_i,
    .bus_error_i
  );

  // ---- trace or sign rays for TRACE, SIGN and ABORT ----
  logic ray_start, ray_done, ray_denied, exit_word_valid, exit_word_ready;
  logic ray_bus_start, ray_bus_write;
  logic [10:0] ray_bus_at;
  logic [31:0] exit_word, ray_bus_word;
  reply_status_e ray_status;
  runs_e runs;
  ray_op_e op;
  always_comb begin
    case (request.kind)
      RequestTrace: op = OpTrace;
      RequestSign: op = repeated ? OpResult : OpSign;
      RequestAbort: op = OpAbort;
      default: op = draws ? OpDraw : OpClaim;
    endcase
  end
  lipp_ray_access i_rays (
    .clk_i, .rst_ni, .clear_i(reset_o), .drawn_i(Scene && drawn_i), .start_i(ray_start), .op_i(op),
    .count_i(request.words),
    .done_o(ray_done), .status_o(ray_status), .runs_o(runs), .denied_o(ray_denied),
    .word_at_o(ray_word_at),
    .word_i(word), .word_valid_o(exit_word_valid), .word_ready_i(exit_word_ready),
    .word_o(exit_word), .bus_start_o(ray_bus_start), .bus_write_o(ray_bus_write),
    .bus_at_o(ray_bus_at), .bus_word_o(ray_bus_word), .bus_done_i, .bus_word_i,
    .ray_valid_o, .ray_ready_i, .ray_o, .trace_o, .exit_valid_i, .exit_ready_o, .exit_i,
    .sign_o, .sign_start_o, .sign_done_i
  );
  // Modules register_access and ray_access never use the register bus at the same time.
  assign bus_start_o = register_bus_start || ray_bus_start;
  assign {bus_write_o, bus_at_o, bus_word_o} = ray_bus_start ?
      {ray_bus_write, ray_bus_at, ray_bus_word} :
      {register_bus_write, register_bus_at, register_bus_word};

  // ---- read CRCs from the tile table or the block table ----
  logic table_start, table_valid, table_ready;
  logic [31:0] table_word;
  logic is_blocks;
  assign is_blocks = Scene && request.kind == RequestBlocks;
  lipp_table_reader i_table (
    .clk_i, .rst_ni, .start_i(table_start),
    .first_i(is_blocks ? {8'd0, request.arguments[1]} : table_first),
    .count_i(is_blocks ? {2'd0, request.arguments[2]} : table_count[9:0]),
    .word_valid_o(table_valid), .word_ready_i(table_ready), .word_o(table_word), .table_at_o,
    .table_crc_i(is_blocks ? blocks_crc_i : table_crc_i)
  );
  assign table_front_o = request.arguments[0][0];
  assign {blocks_slot_o, blocks_at_o} = {request.arguments[0][3:0], table_at_o[7:0]};

  // ---- load blocks of texels into the scene's slots ----
  logic block_start, slot_there;
  // slot_blocks: number of blocks of the slot. blocks_end: index after the last requested block.
  logic [8:0] slot_blocks, blocks_end;
  assign {block_start_o, block_slot_o, block_o} =
      {block_start, request.arguments[0][3:0], request.arguments[1]};
  assign block_word_o = word;
  assign blocks_busy = Scene && blocks_busy_i;
  assign slot_there = request.arguments[0] < 8'(Slots) || request.arguments[0] == 8'd15;
  assign slot_blocks = request.arguments[0][3:0] == 4'd15 ? 9'(CurveBlocks) : 9'(Blocks);
  assign blocks_end = {1'b0, request.arguments[1]}
      + (request.kind == RequestBlock ? 9'd1 : {1'b0, request.arguments[2]});
  assign no_block = !slot_there || blocks_end > slot_blocks;

  // ---- start tile_writer and presenter ----
  assign tile_o = second;
  assign tile_coding_o = request.arguments[4];
  assign present_epoch_o = first;
  assign present_crc_o = request.arguments[5:2];
  logic tile_done_q, tile_ok_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) {tile_done_q, tile_ok_q} <= '0;
    else if (tile_start_o || tile_done_i) {tile_done_q, tile_ok_q} <= {tile_done_i, tile_ok_i};
  end

  // ---- build the reply ----
  logic word_valid, word_ready, words_done;
  logic [8*HeadBytes-1:0] head, head_q;
  logic [5:0] head_bytes, head_bytes_q;
  logic [9:0] words, words_q;
  logic [31:0] common, build_q, reply_word;
  runs_e runs_now;
  assign runs_now = Scene && request.kind == RequestBlock ? RunsSlot : runs;
  assign common = {status_q, request.number, ReplyBit | request.kind};
  always_comb begin
    head = (8 * HeadBytes)'(common);
    head_bytes = 6'd4;
    words = '0;
    if (status_q == StatusBusy) begin
      head = (8 * HeadBytes)'({
        runs_now inside {RunsSign, RunsThis} ? sign_rays_i : '0, runs_now, common
      });
      head_bytes = 6'd9;
    end else if (status_q == StatusOk) begin
      case (request.kind)
        RequestHello: begin
          head = {
            build_q, epoch_i, 32'(ClockHz), 16'(MaxPacket), 8'd32, 16'(Height), 16'(Width),
            identity_i, nonce, ProtocolVersion, common
          };
          head_bytes = 6'd34;
        end
        RequestTile: {head, head_bytes} = {(8 * HeadBytes)'({second, common}), 6'd6};
        RequestPresent: {head, head_bytes} = {(8 * HeadBytes)'({epoch_i, common}), 6'd6};
        RequestTiles: begin
          {head, head_bytes} = {(8 * HeadBytes)'({table_first, epoch_i, common}), 6'd8};
          words = table_count[9:0];
        end
        RequestSign: begin
          {head, head_bytes} = {(8 * HeadBytes)'({sign_crc_i, sign_rays_i, common}), 6'd12};
        end
        RequestBlock: {head, head_bytes} = {
          (8 * HeadBytes)'({request.arguments[1], request.arguments[0], common}), 6'd6
        };
        RequestBlocks: begin
          {head, head_bytes} = {
            (8 * HeadBytes)'({request.arguments[1], request.arguments[0], common}), 6'd6
          };
          words = {2'd0, request.arguments[2]};
        end
        RequestRead: words = {2'd0, request.arguments[2]};
        // a reply to TRACE has 9 words per ray
        RequestTrace: words = {request.words[8:2], 3'd0} + 10'(request.words[8:2]);
        default: ;
      endcase
    end
  end
  // The head of the reply is registered, so that it is stable while it is sent.
  always_ff @(posedge clk_i) begin
    if (reply_ready) {head_q, head_bytes_q, words_q} <= {head, head_bytes, words};
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) reply_q <= 1'b0;
    else reply_q <= state_q == Reply && reply_ready && !answer;
  end
  // These flags select the module that supplies the words of the reply. The reply to HELLO has no
  // words: its head contains the word that HELLO reads.
  logic from_table_q, from_rays_q, keeps_word_q;
  always_ff @(posedge clk_i) begin
    from_table_q <= request.kind inside {RequestTiles, RequestBlocks};
    from_rays_q <= request.kind == RequestTrace;
    keeps_word_q <= is_hello;
  end
  always_comb begin
    {word_valid, reply_word} = {register_valid && !keeps_word_q, register_word};
    if (from_table_q) {word_valid, reply_word} = {table_valid, table_word};
    if (from_rays_q) {word_valid, reply_word} = {exit_word_valid, exit_word};
  end
  assign register_ready = word_ready || keeps_word_q;
  assign {table_ready, exit_word_ready} = {2{word_ready}};
  lipp_reply_builder #(.HeadBytes(HeadBytes)) i_reply (
    .clk_i, .rst_ni, .start_i(state_q == Reply && reply_q), .ready_o(reply_ready), .head_i(head_q),
    .bytes_i(head_bytes_q), .words_i(words_q), .word_valid_i(word_valid), .word_ready_o(word_ready),
    .word_i(reply_word), .words_done_o(words_done), .out_valid_o, .out_ready_i, .out_data_o,
    .out_last_o
  );
  assign next = (answer && words_q == '0) || words_done;
  always_ff @(posedge clk_i) if (register_valid && keeps_word_q) build_q <= register_word;

  // ---- control: receive, check, execute and answer each request ----
  logic [3:0] reset_q;  // clocks until RESET ends; reset_o is high in the first 8
  assign reset_o = reset_q[3];
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Receive;
      status_q <= StatusOk;
      {executed_q, reset_q, register_start, ray_start, table_start, hello, block_start} <= '0;
      {present_start_o, stale_o, tile_bad_o} <= '0;
    end else begin
      {register_start, ray_start, table_start, present_start_o, hello, block_start} <= '0;
      stale_o <= answer && status_q == StatusStale;
      tile_bad_o <= answer && status_q == StatusTile;
      if (reset_q != '0) reset_q <= reset_q - 1'b1;
      case (state_q)
        Receive: begin
          executed_q <= 1'b0;
          if (read_done) state_q <= Judge;
        end
        Judge: begin
          status_q <= StatusOk;
          state_q <= Reply;
          if (refusal_q != StatusOk) begin
            status_q <= refusal_q;
          end else if (once && repeated && request.kind != RequestSign) begin
            status_q <= executed_status;
          end else if (once && older) begin
            status_q <= StatusStale;
          end else begin
            executed_q <= once;
            case (request.kind)
              RequestHello: begin
                {hello, register_start} <= 2'b11;
                state_q <= Execute;
              end
              RequestTiles, RequestBlocks: table_start <= 1'b1;
              RequestBlock: begin
                if (slot_in_use_q) begin
                  status_q <= StatusBusy;
                end else begin
                  block_start <= Scene;
                  state_q <= Execute;
                end
              end
              default: begin
                register_start <= request.kind == RequestRead
                    || (is_write && !on_optics && !draws);
                ray_start <= request.kind inside {RequestTrace, RequestSign, RequestAbort}
                    || on_optics || draws;
                present_start_o <= request.kind == RequestPresent;
                if (request.kind == RequestReset) reset_q <= '1;
                state_q <= Execute;
              end
            endcase
          end
        end
        Execute: begin
          case (request.kind)
            RequestHello: if (register_valid) state_q <= Reply;
            RequestRead: if (register_done) {status_q, state_q} <= {register_status, Reply};
            RequestTile: if (tile_done_q) begin
              {status_q, state_q} <= {tile_ok_q ? StatusOk : StatusTile, Reply};
            end
            RequestPresent: if (present_done_i) {status_q, state_q} <= {present_status_i, Reply};
            RequestReset: if (reset_q == '0 && !table_busy_i && !blocks_busy) state_q <= Reply;
            RequestBlock: if (block_done_i) state_q <= Reply;
            default: begin  // requests WRITE, TRACE, SIGN, ABORT
              if (register_done) {status_q, state_q} <= {register_status, Reply};
              if (ray_done) begin
                status_q <= ray_status;
                if (is_write && ray_status == StatusOk) begin
                  register_start <= 1'b1;
                end else begin
                  state_q <= Reply;
                  // A request refused because the optics are busy is executed when repeated.
                  if (ray_denied) executed_q <= 1'b0;
                end
              end
            end
          endcase
        end
        Reply: if (answer) state_q <= words_q == '0 ? Receive : Words;
        default: if (words_done) state_q <= Receive;  // Words
      endcase
    end
  end

endmodule

`default_nettype wire
