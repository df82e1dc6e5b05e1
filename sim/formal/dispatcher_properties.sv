// SPDX-License-Identifier: Apache-2.0
/// Proves that `lipp_dispatcher` answers every request.
///
/// The proof assumes that the modules around the dispatcher answer within Slow clocks, as their
/// headers state. Otherwise, these modules and the serial line behave arbitrarily. The proof shows
/// that an event happens within Bound clocks, unless the serial line neither sends nor accepts
/// bytes. An event is a byte in or out, a bus access, a byte of a tile, the end of a tile, of a
/// block or of a frame, or a ray. A request causes a bounded number of events of each kind. The
/// dispatcher reads the status of the optics at most three times before another event. Bytes of a
/// request are accepted only when the replies to all earlier requests are at the output.
module dispatcher_properties #(
  parameter int Slow = 2,
  parameter int Bound = 31,
  parameter int Layers = 0,   // number of layers of the scene; 0: no scene
  parameter bit Guide = 1'b0  // 1: every request is an ABORT, and no module waits
) (
  input logic             clk_i,
  input logic             rst_ni,
  input logic [15:0]      epoch_i,
  input logic             in_valid_i,
  input logic [7:0]       in_data_i,
  input logic             in_last_i,
  input logic             out_ready_i,
  input logic             bus_done_i,
  input logic [31:0]      bus_word_i,
  input logic             bus_error_i,
  input logic             tile_ready_i,
  input logic             tile_done_i,
  input logic             tile_ok_i,
  input logic             table_busy_i,
  input logic [31:0]      table_crc_i,
  input logic             present_done_i,
  input logic [7:0]       present_status_i,
  input logic             ray_ready_i,
  input logic             exit_valid_i,
  input logic [8:0][31:0] exit_i,
  input logic             sign_done_i,
  input logic [31:0]      sign_rays_i,
  input logic [31:0]      sign_crc_i,
  input logic             drawn_i,
  input logic [15:0]      slots_i,
  input logic             block_done_i,
  input logic             blocks_busy_i,
  input logic [31:0]      blocks_crc_i
);
  import lipp_link_pkg::*;

  logic in_ready, out_valid, out_last, reset, bus_start, bus_write, tile_start, tile_empty;
  logic tile_valid, tile_last, present_start, ray_valid, trace, exit_ready, sign, sign_start;
  logic [7:0] out_data;
  logic [10:0] bus_at;
  logic [31:0] bus_word;
  logic block_start;
  lipp_dispatcher #(.Width(64), .Height(64), .Layers(Layers)) i_dut (
    .clk_i, .rst_ni, .identity_i(64'd0), .epoch_i, .reset_o(reset), .in_valid_i,
    .in_ready_o(in_ready), .in_data_i, .in_last_i, .out_valid_o(out_valid), .out_ready_i,
    .out_data_o(out_data), .out_last_o(out_last), .bus_start_o(bus_start),
    .bus_write_o(bus_write), .bus_at_o(bus_at), .bus_word_o(bus_word), .bus_done_i, .bus_word_i,
    .bus_error_i, .tile_start_o(tile_start), .tile_o(), .tile_coding_o(),
    .tile_empty_o(tile_empty), .tile_valid_o(tile_valid), .tile_ready_i, .tile_data_o(),
    .tile_last_o(tile_last), .tile_done_i, .tile_ok_i, .stale_o(), .tile_bad_o(), .table_busy_i,
    .table_front_o(), .table_at_o(), .table_crc_i, .present_start_o(present_start),
    .present_epoch_o(), .present_crc_o(), .present_done_i,
    .present_status_i(reply_status_e'(present_status_i)), .ray_valid_o(ray_valid), .ray_ready_i,
    .ray_o(), .trace_o(trace), .exit_valid_i, .exit_ready_o(exit_ready), .exit_i, .sign_o(sign),
    .sign_start_o(sign_start), .sign_done_i, .sign_rays_i, .sign_crc_i, .drawn_i, .update_o(),
    .slots_i,
    .block_start_o(block_start), .block_slot_o(), .block_o(), .block_word_at_i(8'd0),
    .block_word_o(), .block_done_i, .blocks_busy_i, .blocks_slot_o(), .blocks_at_o(), .blocks_crc_i
  );

  logic started_q = 1'b0;
  always_ff @(posedge clk_i) started_q <= 1'b1;
  always_comb if (!started_q) assume (!rst_ni);

  wire in_take = in_valid_i && in_ready;
  wire out_take = out_valid && out_ready_i;
  wire tile_take = tile_valid && tile_ready_i;
  wire ray_take = ray_valid && ray_ready_i;
  wire exit_take = trace && exit_valid_i && exit_ready;

  wire blocks_busy = Layers > 0 && blocks_busy_i;

  // ---- model the modules around the dispatcher: the state of each, and its age in clocks ----
  logic [1:0] byte_q;                      // bytes of the request read so far, counted to 3
  logic bus_q, tile_open_q, tile_end_q, present_q, block_q, ray_q;
  logic [2:0] bus_for_q, tile_for_q, tile_shut_q, present_for_q, ray_shut_q, ray_for_q, table_for_q;
  logic [2:0] block_for_q;
  logic table_q;                           // 1: the tile and block tables are being cleared
  logic [1:0] looks_q;                     // number of status reads of the optics since a write
  logic running_q;                         // 1: a frame may be running
  logic look_q;
  logic [2:0] polls_q;  // status reads of one operation since its last write
  logic signed_q;       // 1: the last signature is complete
  localparam logic [2:0] Late = 3'(Slow);
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {byte_q, bus_q, tile_open_q, tile_end_q, present_q, ray_q, looks_q, running_q} <= '0;
      {block_q, block_for_q} <= '0;
      {bus_for_q, tile_for_q, tile_shut_q, present_for_q, ray_shut_q, ray_for_q, look_q,
          polls_q} <= '0;
      {table_q, table_for_q, signed_q} <= {1'b1, 3'd0, 1'b0};
    end else begin
      if (in_take) byte_q <= in_last_i ? 2'd0 : byte_q == 2'd3 ? 2'd3 : byte_q + 2'd1;
      // ---- rules for the register bus ----
      bus_q <= bus_start || (bus_q && !bus_done_i);
      bus_for_q <= bus_start ? 3'd0 : bus_for_q + 3'd1;
      if (bus_start) look_q <= !bus_write && bus_at == 11'h210;
      if (bus_start && bus_write) looks_q <= '0;
      else if (bus_start && bus_at == 11'h210 && looks_q != 2'd3) looks_q <= looks_q + 2'd1;
      if (bus_start && bus_write && bus_at == 11'h20c) begin
        running_q <= bus_word[1] || (running_q && !bus_word[2]);
      end else if (bus_done_i && look_q && !bus_word_i[1]) begin
        running_q <= 1'b0;
      end
      if (i_dut.ray_start || (bus_start && bus_write)) polls_q <= '0;
      else if (bus_start && i_dut.i_rays.on_bus) polls_q <= polls_q + 3'd1;
      // ---- rules for the tile writer ----
      if (tile_start) {tile_open_q, tile_end_q} <= {!tile_empty, tile_empty};
      else if (tile_take && tile_last) {tile_open_q, tile_end_q} <= 2'b01;
      else if (tile_done_i) tile_end_q <= 1'b0;
      tile_for_q <= tile_end_q && !tile_done_i ? tile_for_q + 3'd1 : 3'd0;
      tile_shut_q <= tile_valid && !tile_ready_i ? tile_shut_q + 3'd1 : 3'd0;
      // ---- rules for the presenter ----
      present_q <= present_start || (present_q && !present_done_i);
      present_for_q <= present_start ? 3'd0 : present_for_q + 3'd1;
      // ---- rules for the slot loader ----
      block_q <= block_start || (block_q && !block_done_i);
      block_for_q <= block_start ? 3'd0 : block_for_q + 3'd1;
      // ---- rules for the optics ----
      ray_q <= ray_take || (ray_q && !exit_take);
      ray_shut_q <= ray_valid && !ray_ready_i ? ray_shut_q + 3'd1 : 3'd0;
      ray_for_q <= ray_take ? 3'd0 : ray_for_q + 3'd1;
      signed_q <= sign_done_i && !sign_start && !reset;
      // ---- rules for the tile and block tables ----
      table_q <= reset || (table_q && (table_busy_i || blocks_busy));
      table_for_q <= reset || !table_q ? 3'd0 : table_for_q + 3'd1;
    end
  end
  always_comb begin
    assume (!in_take || !in_last_i || byte_q >= 2'd2);
    assume (!bus_done_i || bus_q);
    assume (!bus_q || bus_for_q < Late || bus_done_i);
    // At the third read of the status, an apply is done, and after an abort all rays have left.
    assume (!(bus_done_i && look_q && bus_word_i[1]) || running_q);
    assume (!(bus_done_i && look_q && looks_q == 2'd3 && !bus_word_i[1])
        || (!bus_word_i[0] && !bus_word_i[3]));
    assume (!(tile_valid && tile_open_q) || tile_shut_q < Late || tile_ready_i);
    assume (!tile_done_i || tile_end_q);
    assume (!tile_end_q || tile_for_q < Late || tile_done_i);
    assume (!present_done_i || present_q);
    assume (!present_q || present_for_q < Late || present_done_i);
    assume (!block_done_i || block_q);
    assume (!block_q || block_for_q < Late || block_done_i);
    assume (!ray_valid || ray_shut_q < Late || ray_ready_i);
    assume (!(trace && exit_valid_i) || ray_q);
    assume (!(trace && ray_q) || ray_for_q < Late || exit_valid_i);
    assume (!signed_q || sign_done_i);
    assume (!(table_busy_i || blocks_busy) || table_q);
    assume (table_q || !reset);
    assume (!table_q || table_for_q < Late || !(table_busy_i || blocks_busy));
  end

  if (Guide) begin : gen_guide
    always_comb begin
      assume (rst_ni == started_q && in_valid_i && out_ready_i && bus_done_i == bus_q);
      assume (in_data_i == (byte_q == 2'd0 ? RequestAbort : 8'd5) && in_last_i == (byte_q == 2'd2));
    end
  end

  // ---- properties to prove ----
  logic [4:0] idle_q;     // clocks without an event, although an event was possible
  logic [1:0] unsent_q;   // received requests whose reply is not completely sent
  wire [5:0] head_left = i_dut.i_reply.head_left_q;
  wire sends = out_valid || head_left != '0;
  wire gap = sends && !out_valid;  // 1: between two parts of the head of a reply
  wire moves = in_take || out_take || bus_done_i || tile_take || tile_done_i || present_done_i
      // state 2: register_access checks the address of a word
      || block_done_i || ray_take || exit_take || reset || i_dut.i_registers.state_q == 3'd2;
  wire line_waits = (in_ready && !in_valid_i) || (out_valid && !out_ready_i) || table_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {idle_q, unsent_q} <= '0;
    end else begin
      idle_q <= moves || line_waits ? 5'd0 : idle_q + 5'd1;
      unsent_q <= unsent_q + 2'(in_take && in_last_i) - 2'(out_take && out_last);
    end
  end
  always_ff @(posedge clk_i) begin
    if (rst_ni) begin
      answered: assert (idle_q < 5'(Bound));
      no_reply_unasked: assert (!out_valid || unsent_q != '0);
      one_at_a_time: assert (!in_ready || unsent_q == 2'(sends));
      never_three: assert (unsent_q != 2'd3);
      few_looks: assert (polls_q <= 3'd3);
      one_access: assert (!bus_start || !bus_q || bus_done_i);
      one_tile: assert (!tile_start || !(tile_open_q || tile_end_q));
      one_frame: assert (!present_start || !present_q);
      one_block: assert (!block_start || !block_q);
      rays_for_one: assert (!(trace && sign));
    end
  end

  // ---- invariants of each part in each state; state numbers are values of enumerations ----
  localparam int Receive = 0, Judge = 1, Execute = 2, Reply = 3, Words = 4;
  localparam int ReaderTile = 5, ReaderDone = 7;
  localparam int RegIdle = 0, RegRange = 1, RegCheck = 2, RegAsk = 5, RegWait = 6, RegWord = 7;
  localparam int RayClaim = 0, RayTakenOver = 3, RayBegun = 5, RayEnd = 6, RayEnded = 7,
      RayIdle = 8;
  localparam int RaySettle = 9, RayPlace = 10, RayPlaced = 11, RayFetch = 12, RayOffer = 13;
  localparam int RayExit = 14, RayWords = 15;
  wire [2:0] state = i_dut.state_q;
  wire [2:0] reader = i_dut.i_reader.state_q;
  wire [2:0] regs = i_dut.i_registers.state_q;
  wire [3:0] rays = i_dut.i_rays.state_q;
  wire read_done = i_dut.read_done;
  wire [7:0] kind = i_dut.request.kind;
  wire ok = i_dut.status_q == StatusOk;
  wire [9:0] reply_left = i_dut.i_reply.remaining_q;
  wire [9:0] table_left = i_dut.i_table.remaining_q;
  wire [9:0] reg_left = 10'(i_dut.i_registers.remaining_q);
  wire [8:0] ray_left = i_dut.i_rays.remaining_q;
  wire [1:0] ray_at = i_dut.i_rays.at_q[1:0];
  wire bus_pending = i_dut.i_rays.bus_pending_q;
  wire reg_write = i_dut.i_registers.write_q;
  wire regs_idle = regs == RegIdle && !i_dut.register_start && !i_dut.register_done;
  wire rays_idle = rays == RayIdle && !i_dut.ray_start && !i_dut.ray_done;
  wire table_idle = table_left == '0 && !i_dut.table_start && !i_dut.table_valid;
  wire tile_busy = tile_start || tile_open_q || tile_end_q;
  localparam logic [7:0] Last = Layers > 0 ? RequestBlocks : RequestReset;
  wire legal_kind = kind inside {[RequestHello:Last]};
  wire lists = kind inside {RequestTiles, RequestBlocks};
  // 1: a WRITE to the optics, which ray_access must permit
  wire on_optics = i_dut.on_optics || i_dut.draws;
  // These flags tell which modules the current request uses while it is executed.
  wire uses_regs = kind inside {RequestHello, RequestRead, RequestWrite};
  wire uses_rays = kind inside {RequestTrace, RequestSign, RequestAbort} || on_optics;
  wire reg_reads = regs inside {RegAsk, RegWait, RegWord} && !reg_write;
  wire ray_looks = rays inside {RayClaim, RayTakenOver, RayBegun, RayEnded};
  wire ray_list = rays inside {[RayPlace:RayWords]};
  wire restoring = i_dut.i_rays.restore_q;
  wire [9:0] rays_left = 10'(ray_left[8:2]) + 10'(rays inside {[RayPlace:RayFetch]} && ray_at != '0)
      + 10'(rays inside {RayOffer, RayExit});
  wire [9:0] exit_left = 10'(i_dut.i_rays.exit_left_q);
  wire [9:0] ray_words = 10'd8 * rays_left + rays_left
      + (rays == RayWords || restoring ? exit_left : '0);
  logic reg_part, ray_part;
  always_comb begin
    case (kind)
      RequestHello: reg_part = (i_dut.register_start && regs == RegIdle)
          || (!reg_write && reg_left == 10'd1
          && ((regs == RegRange && i_dut.i_registers.optics_q) || regs
              inside {RegAsk, RegWait, RegWord}));
      RequestRead: reg_part = (i_dut.register_start && regs == RegIdle)
          || (!reg_write && regs == RegRange && reg_left == 10'(i_dut.request.arguments[2]))
          || (i_dut.register_done && (i_dut.register_status == StatusOk ?
              regs == RegAsk && !reg_write && reg_left == 10'(i_dut.request.arguments[2])
              : regs == RegIdle));
      default: reg_part = (i_dut.register_start && regs == RegIdle)
          || (reg_write && regs inside {[RegRange:RegWait]} && reg_left != '0)
          || (i_dut.register_done && regs == RegIdle);
    endcase
    case (i_dut.op)
      OpClaim: ray_part = rays == RayClaim || (i_dut.ray_done && rays == RayIdle);
      OpTrace: ray_part = (rays <= RayTakenOver && ray_left == i_dut.request.words && ray_at == '0)
          || (i_dut.ray_done && (i_dut.ray_status == StatusOk ?
              rays == RayPlace && ray_left == i_dut.request.words && ray_at == '0
              : rays == RayIdle));
      OpDraw: ray_part = rays <= RayTakenOver || (i_dut.ray_done && rays == RayIdle);
      OpSign: ray_part = rays <= RayBegun || rays == RaySettle
          || (i_dut.ray_done && rays == RayIdle);
      OpResult: ray_part = i_dut.ray_done && rays == RayIdle;
      default: ray_part = rays inside {RayEnd, RayEnded} || (i_dut.ray_done && rays == RayIdle);
    endcase
    ray_part = ray_part || (i_dut.ray_start && rays == RayIdle);
  end
  // Bound on the number of clocks until the next event; the bound falls while a module is busy.
  logic [5:0] todo;
  always_comb begin
    todo = 6'd10;
    case (state)
      Receive: todo = reader == ReaderDone ? 6'd28 - read_done : reader == ReaderTile ? 6'd17
          - tile_shut_q : 6'd1;
      Judge: todo = 6'd26;
      Execute: begin
        todo = 6'd12;
        if (i_dut.ray_start) todo = 6'd25;
        else if (i_dut.register_start) todo = 6'd23;
        else if (i_dut.ray_done) todo = on_optics ? 6'd24 : 6'd12;
        else if (i_dut.register_done && kind != RequestHello) todo = 6'd12;
        else if (regs == RegWait) todo = 6'd17 - bus_for_q;
        else if (regs == RegWord) todo = 6'd12;
        else if (regs != RegIdle) todo = 6'd23 - regs;
        else if (rays <= RayEnded) todo = bus_pending ? 6'd17 - bus_for_q : 6'd18;
        else if (rays == RaySettle) todo = 6'd19 + i_dut.i_rays.pause_q;
        else if (kind == RequestTile && !i_dut.tile_done_q)
          todo = tile_start ? 6'd18 : tile_open_q ? 6'd17 - tile_shut_q : 6'd16 - tile_for_q;
        else if (kind == RequestPresent) todo = present_start ? 6'd18 : 6'd17 - present_for_q;
        else if (kind == RequestBlock) todo = block_start ? 6'd18 : 6'd17 - block_for_q;
        else if (kind == RequestReset) todo = 6'd13 + i_dut.reset_q;
      end
      Reply: todo = i_dut.reply_q ? 6'd11 : i_dut.reply_ready ? 6'd12 : 6'd13;
      default: begin
        if (sends) todo = 6'd1;
        else if (kind == RequestRead) todo = regs == RegAsk ? 6'd8 : regs == RegWait ? 6'd7
            - bus_for_q : 6'd3;
        else if (lists) todo = i_dut.table_valid ? 6'd2 : 6'd4 + i_dut.i_table.pause_q;
        else if (restoring) todo = bus_pending ? 6'd7 - bus_for_q : 6'd8;
        else if (rays inside {[RayPlace:RayFetch]}) todo = 6'd32 - rays - 6'd3 * ray_at;
        else todo = rays == RayOffer ? 6'd10 - ray_shut_q : rays == RayExit ? 6'd7 - ray_for_q
            : 6'd2 + 6'(i_dut.i_rays.moves_q);
      end
    endcase
    // Number of clocks until the head of the reply is registered and the previous reply has ended.
    if (state inside {Judge, Execute} || (state == Receive && reader == ReaderDone)) todo = todo
        + 6'd2;
    if (state == Words && !sends && !i_dut.word_ready) todo = todo + 6'd1;
    if (gap) todo = todo + 6'd1;
  end
  always_ff @(posedge clk_i) begin
    if (rst_ni) begin
      in_todo: assert (6'(idle_q) + todo <= 6'd31);
      in_late: assert ((!bus_q || bus_for_q <= Late) && (!present_q || present_for_q <= Late)
          && (!block_q || block_for_q <= Late)
          && (!ray_q || ray_for_q <= Late || !exit_ready) && tile_for_q <= Late
              && tile_shut_q <= Late
          && ray_shut_q <= Late);
      in_states: assert (state <= Words);
      in_reader: assert (state == Receive || reader == ReaderDone);
      in_length: assert (!(state == Execute || (state inside {Reply, Words} && ok
          && (kind inside {RequestRead, RequestTrace} || lists)))
          || (i_dut.i_reader.length_ok && legal_kind));
      in_reply_ready: assert (!i_dut.reply_ready || (!sends && reply_left == '0));
      in_word_ready: assert (!i_dut.word_ready || (!sends && reply_left != '0));
      in_source: assert (state == Receive || (i_dut.from_rays_q == (kind == RequestTrace)
          && i_dut.from_table_q == (kind inside {RequestTiles, RequestBlocks}) && i_dut.keeps_word_q
              == (kind == RequestHello)));
      in_done: assert (!read_done || (reader == ReaderDone && i_dut.i_reader.length_ok_q
          == i_dut.i_reader.length_ok
          && i_dut.version_q == i_dut.version && i_dut.no_tile_q == i_dut.no_tile
          && i_dut.no_block_q == i_dut.no_block));
      in_still: assert (state == Receive || read_done);
      in_judge: assert (state != Judge || i_dut.refusal_q == i_dut.refusal);
      in_unsent: assert (unsent_q == 2'(reader == ReaderDone && state != Words)
          + 2'(state == Words || sends));
      in_last: assert (!out_valid || i_dut.i_reply.i_writer.last_q
          == (state != Words && head_left == '0));
      in_out: assert (!out_valid || i_dut.i_reply.i_writer.remaining_q <= 3'd4);
      in_head: assert (!i_dut.reply_q || (state == Reply && i_dut.reply_ready && i_dut.words_q
          == i_dut.words
          && i_dut.head_bytes_q inside {[6'd4:6'd34]}));
      in_reply: assert ((state == Words) == (reply_left != '0));
      in_head_left: assert (head_left <= 6'd34);
      in_order: assert (!(state inside {Judge, Execute}) || kind == RequestHello
          || i_dut.i_order.repeated_o == (i_dut.i_order.newest_valid_q && i_dut.i_order.same));
      in_passed: assert (!i_dut.i_order.passed_q || state == Words
          || (state == Receive && reader == 3'd0));
      in_hello: assert (!i_dut.hello || (state == Execute && kind == RequestHello));
      in_rest: assert (!(state inside {Receive, Judge}) || (regs_idle && rays_idle && table_idle));
      in_present: assert ((present_start || present_q)
          == (state == Execute && kind == RequestPresent));
      in_load: assert ((block_start || block_q) == (state == Execute && kind == RequestBlock));
      in_reset: assert (i_dut.reset_q == '0 || (state == Execute && kind == RequestReset));
      in_execute: assert (state != Execute || !lists);
      in_ray_start: assert (!i_dut.ray_start || (rays == RayIdle && !i_dut.ray_done && state
          == Execute));
      in_reg_start: assert (!i_dut.register_start
          || (regs == RegIdle && !i_dut.register_done && state == Execute));
      in_reader_words: assert (reader != 3'd4 || kind inside {RequestWrite, RequestTrace}
          || (legal_kind && kind == RequestBlock));
      in_reader_rest: assert (reader != 3'd6 || i_dut.i_reader.status_q != StatusOk);
      in_reader_arguments: assert (reader != 3'd3 || kind inside {[RequestHello:RequestTiles]}
          || (legal_kind && kind inside {RequestBlock, RequestBlocks}));
      in_reader_kind: assert (reader != ReaderDone || i_dut.i_reader.status_q != StatusOk
          || legal_kind);
      in_reader_fine: assert (!(reader inside {[3'd1:3'd5]}) || i_dut.i_reader.status_q
          == StatusOk);
      in_tile_start: assert (!tile_start || state == Receive);
      in_bytes: assert (byte_q == (reader == ReaderDone ? 2'd0 : reader > 3'd3 ? 2'd3
          : reader[1:0]));
      in_ray_done: assert (!i_dut.ray_done || rays inside {RayIdle, RayPlace});
      in_reg_done: assert (!i_dut.register_done || regs == RegIdle
          || (regs == RegAsk && !reg_write));
      in_words_few: assert (i_dut.request.words <= 9'd256);
      in_part: assert (state != Execute
          || (on_optics ? (ray_part && regs_idle) || (reg_part && rays_idle)
          : (uses_regs ? reg_part : regs_idle) && (uses_rays ? ray_part : rays_idle)));
      in_range: assert (!(state inside {Judge, Execute}) || (i_dut.i_registers.behind_q ==
          {1'b0, i_dut.i_registers.first_i} + {6'd0, i_dut.i_registers.count_i, 2'd0}
          && i_dut.i_registers.aligned_q == (i_dut.i_registers.first_i[1:0] == '0)
          && i_dut.i_registers.high_q == (i_dut.i_registers.first_i >= 16'h200)
          && i_dut.i_registers.top_q == (Layers > 0 && i_dut.i_registers.first_i >= 16'h400)));
      in_block: assert (state != Execute || (i_dut.i_registers.board_q ==
          (i_dut.i_registers.aligned_q && i_dut.i_registers.behind_q <= 17'h100)
          && i_dut.i_registers.optics_q == (i_dut.i_registers.aligned_q && i_dut.i_registers.high_q
          && i_dut.i_registers.behind_q <= 17'h400)
          && i_dut.i_registers.scene_q == (i_dut.i_registers.aligned_q && i_dut.i_registers.top_q
          && i_dut.i_registers.behind_q <= 17'h800)));
      in_table: assert (state != Execute || table_idle);
      in_read: assert (!(state inside {Reply, Words}) || (kind == RequestRead && ok ? reg_reads
          && reg_left == (state == Words ? reply_left : i_dut.words) : regs == RegIdle
              && !i_dut.register_start));
      in_trace: assert (!(state inside {Reply, Words})
          || (kind == RequestTrace && ok ? (ray_list || restoring)
          && ray_words == (state == Words ? reply_left : i_dut.words) : rays_idle));
      in_tiles: assert (!(state inside {Reply, Words}) || (lists && ok ?
          (state == Reply && i_dut.table_start && table_left == '0 && !i_dut.table_valid)
          || (!i_dut.table_start && table_left == (state == Words ? reply_left : i_dut.words))
              : table_idle));
      in_words: assert (state != Words || (ok
          && (kind inside {RequestRead, RequestTrace} || lists)));
      in_kind: assert (!(state inside {Reply, Words}) || !ok || legal_kind);
      in_list_few: assert (!ray_list || ray_left <= 9'd256);
      in_ray_status: assert (rays == RayIdle || i_dut.ray_status == StatusOk);
      in_reg_status: assert (regs == RegIdle || reg_write || i_dut.register_status == StatusOk);
      in_list: assert (!(rays inside {[RayPlace:RayFetch]}) || (ray_left != '0
          && 2'(ray_left[1:0] + ray_at) == '0));
      in_ray: assert (!(rays inside {[RayOffer:RayWords]})
          || (ray_left[1:0] == '0 && ray_at == '0));
      in_exit: assert (rays != RayWords || (exit_left != '0 && exit_left <= 10'd9));
      in_restore: assert (!restoring || (state inside {Reply, Words} && kind == RequestTrace && ok
          && !trace
          && rays inside {[1:RayTakenOver]} && ray_left == '0 && ray_at == '0 && exit_left
              == 10'd9));
      in_traced: assert (ray_q == (rays == RayExit));
      in_trace_o: assert (!trace || ray_list);
      in_trace_off: assert (rays != RayWords || trace == (ray_left != '0));
      in_trace_on: assert (!(rays inside {[RayPlace:RayExit]}) || trace);
      in_sign: assert (!(rays inside {[1:3]} || ray_list || trace) || !sign);
      in_sign_start: assert (!sign_start || rays == 4'd4);
      in_bus: assert (bus_q == (regs == RegWait || bus_pending));
      in_asked: assert (!bus_pending || (rays <= RayEnded && regs == RegIdle));
      in_tile: assert (!tile_busy || (kind == RequestTile && i_dut.i_reader.status_q == StatusOk
          && (reader == ReaderTile
          || (reader == ReaderDone && state inside {Receive, Judge, Execute}))));
      in_tile_reader: assert (reader != ReaderTile
          || (kind == RequestTile && (tile_start || tile_open_q) && !tile_end_q));
      in_tile_empty: assert (!tile_start || (tile_empty == (reader == ReaderDone) && !tile_valid));
      in_tile_data: assert (!tile_valid || (tile_open_q && tile_last == (reader == ReaderDone)));
      in_tile_open: assert (!tile_open_q || reader == ReaderTile || tile_valid);
      in_tile_one: assert (!(tile_open_q && tile_end_q)
          && !(tile_start && (tile_open_q || tile_end_q)));
      in_tile_done: assert (!i_dut.tile_done_q || !(tile_open_q || tile_end_q));
      in_tile_executed: assert (!(kind == RequestTile && reader == ReaderDone
          && i_dut.i_reader.status_q == StatusOk && state inside {Receive, Judge, Execute})
          || tile_busy || i_dut.tile_done_q);
      in_tile_state: assert (state != Execute || kind != RequestTile || i_dut.i_reader.status_q
          == StatusOk);
      in_polls: assert (!ray_looks || bus_pending || polls_q <= 3'd2);
      in_polls_new: assert (!((bus_pending && !ray_looks) || rays == RaySettle) || polls_q == '0);
      in_looks: assert (polls_q <= 3'(looks_q));
      in_look: assert (!bus_pending || look_q == ray_looks);
      in_running: assert (!(ray_list || rays inside {[4'd1:RayTakenOver], RayEnded}
          || (rays == RayEnd && bus_pending))
          || !running_q);
    end
  end

  // ---- cover statements: events that the proof must reach ----
  logic [1:0] replies_q;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) replies_q <= '0;
    else if (out_take && out_last && replies_q != 2'd3) replies_q <= replies_q + 2'd1;
  end
  always_ff @(posedge clk_i) begin
    if (rst_ni) begin
      cover_answered: cover (out_take && out_last);
      cover_again: cover (replies_q == 2'd1 && i_dut.repeated && out_take && out_last);
    end
  end

endmodule
