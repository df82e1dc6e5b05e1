// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// The design of a board: it receives packets over a serial line, drives a panel, and traces rays.
///
/// If Scene.layers > 0, the board also draws a scene on the panel. The host loads the textures and
/// registers of the scene over the serial line. Each pixel of the panel lasts 2^Scene.samples_bits
/// clocks, and pixel_o marks the first clock of each pixel.
///
/// The request RESET resets all modules except the serial link, so that no byte is lost.
///
/// The frame store is an external memory behind the ports show_*, write_* and read_*. The frame
/// store has two buffers of Width * Height pixels (14.7 Mbit at 640 x 480) and must use the
/// handshakes of `lipp_sdram_store`. Output store_rst_no resets the frame store, so that RESET
/// cancels pending requests to it. `lipp_board_with_store` connects a frame store in block RAM, for
/// small panels and for simulation. `lipp_board_with_sdram` connects a frame store in SDRAM.
///
/// A push button on the board sets input pattern_i, the number of a test pattern. If pattern_i is
/// not 0, pattern_i overrides the register that selects the test pattern. Output packet_o pulses
/// for each received packet. Output error_o pulses for each lost byte, dropped packet, late pixel
/// and lost frame. Output shown_o is high while a frame or a scene is on the panel.
///
/// With ByteLink = 1, a byte stream replaces the UART, for a USB FIFO or a fast simulation. Output
/// in_ready_o is low until the clock after the registers have left reset, so that no byte is lost.
/// The file docs/reference/protocol.md describes the protocol, and
/// docs/generated/board-registers.md describes the registers.
///
/// Data flow of requests, frames and rays through the modules:
///
///   uart_rx -> cobs_decoder -> packet_fifo -> dispatcher -> tile_writer -> store -> scan_out
///                                              |  |  |
///                    presenter, frame_check <--+  |  +--> register_bus -> board_registers
///                                                 v                    -> optics_block
///   uart_tx <- packet_out <- dispatcher      ray_signature
///
/// Data flow of a drawn scene through the modules:
///
///   draw_frame -> optics_block -> scene -> draw_frame -> scan_out
///                   slot_loader ---^
module lipp_board #(
  parameter bit ByteLink = 1'b0,
  parameter int ClockHz = 148_500_000,
  parameter int Width = 1920,
  parameter int Height = 1080,
  parameter int HFront = 88,
  parameter int HSync = 44,
  parameter int HBack = 148,
  parameter int VFront = 4,
  parameter int VSync = 5,
  parameter int VBack = 36,
  parameter bit HPositive = 1'b1,  // 1: the horizontal sync is active high
  parameter bit VPositive = 1'b1,  // 1: the vertical sync is active high
  // Build parameters of the optics. Field `aims` must be 0, because a board traces only chief rays.
  parameter lipp_optics_pkg::build_t Build = '{
    fraction_bits: 5'd16, model: 2'(lipp_optics_pkg::ModelExact), default: '0
  },
  // Build parameters of the scene. With layers = 0 no module that draws a scene is generated.
  parameter lipp_scene_pkg::scene_build_t Scene = '0,
  localparam int F = int'(Build.fraction_bits),
  localparam int PlaceBits = $clog2(Width * Height)
) (
  input  logic        clk_i,
  input  logic        rst_ni,       // asynchronous reset, active low
  input  logic [63:0] identity_i,   // hash that identifies the panel and its lenslet array

  input  logic [15:0] step_i,       // UART baud rate / clock frequency, times 65536
  input  logic        rx_i,
  output logic        tx_o,

  input  logic        in_valid_i,   // in_* and out_*: byte stream, if ByteLink = 1
  output logic        in_ready_o,
  input  logic [7:0]  in_data_i,
  output logic        out_valid_o,
  input  logic        out_ready_i,
  output logic [7:0]  out_data_o,

  output logic                 store_rst_no,
  output logic                 show_valid_o,
  input  logic                 show_ready_i,
  output logic                 show_buffer_o,
  output logic [PlaceBits-1:0] show_first_o,
  output logic [PlaceBits:0]   show_count_o,
  input  logic                 show_pixel_valid_i,
  output logic                 show_pixel_ready_o,
  input  logic [23:0]          show_rgb_i,
  output logic                 write_valid_o,
  input  logic                 write_ready_i,
  output logic                 write_buffer_o,
  output logic [PlaceBits-1:0] write_first_o,
  output logic [PlaceBits:0]   write_count_o,
  output logic                 write_pixel_valid_o,
  input  logic                 write_pixel_ready_i,
  output logic [23:0]          write_rgb_o,
  input  logic                 write_done_i,
  output logic                 read_valid_o,
  input  logic                 read_ready_i,
  output logic                 read_buffer_o,
  output logic [PlaceBits-1:0] read_first_o,
  output logic [PlaceBits:0]   read_count_o,
  input  logic                 read_pixel_valid_i,
  output logic                 read_pixel_ready_o,
  input  logic [23:0]          read_rgb_i,

  input  logic [2:0]  pattern_i,    // test pattern; if 0, the register sets it
  input  logic        clock_lost_i, // 1: a clock has failed since power-up
  output logic        packet_o,
  output logic        shown_o,
  output logic        error_o,

  output logic        pixel_o,
  output logic        de_o,
  output logic        hsync_o,
  output logic        vsync_o,
  output logic [23:0] rgb_o
);
  import lipp_optics_pkg::IndexBits, lipp_optics_pkg::PixelBits;

  if (Width < 1 || Width > 16383 || Height < 1 || Height > 16383) begin : gen_illegal_panel
    $fatal(1, "lipp_board: Width and Height must be 1 to 16383");
  end
  if (
      lipp_panel_pkg::tiles(Width) * lipp_panel_pkg::tiles(Height) >= 1 << 16
  ) begin : gen_illegal_tiles
    $fatal(1, "lipp_board: the panel must have fewer than 65536 tiles");
  end
  if (HFront < 0 || HSync < 1 || HBack < 0
      || VFront < 1 || VSync < 1 || VBack < 0) begin : gen_illegal_timing
    $fatal(1, "lipp_board: porches must be 0 or more, and syncs and VFront 1 or more");
  end
  if (ClockHz < 1) begin : gen_illegal_clock
    $fatal(1, "lipp_board: ClockHz must be 1 or more");
  end
  if (Build.aims) begin : gen_illegal_aims
    $fatal(1, "lipp_board: Build.aims must be 0: a board traces chief rays");
  end

  localparam bit Draws = Scene.layers != '0;
  localparam int ClocksPerPixel = Draws ? 1 << Scene.samples_bits : 1;
  if (Draws && !lipp_scene_pkg::legal(Scene)) begin : gen_illegal_scene
    $fatal(1, "lipp_board: Scene must be a legal build or have 0 layers");
  end

  logic rst_n;
  lipp_reset_sync i_reset (.clk_i, .rst_ni, .rst_no(rst_n));

  // ---- receive and send bytes over the serial link ----
  logic rx_valid, rx_ready, tx_valid, tx_ready, framing_error, overflow;
  logic [7:0] rx_data, tx_data;
  if (ByteLink) begin : gen_bytes
    // The registers leave reset some clocks after rst_ni rises. A byte that arrives earlier waits.
    logic open_q;
    always_ff @(posedge clk_i or negedge rst_n) begin
      if (!rst_n) open_q <= 1'b0;
      else open_q <= 1'b1;
    end
    assign {rx_valid, rx_data, in_ready_o} = {in_valid_i && open_q, in_data_i, rx_ready && open_q};
    assign {out_valid_o, out_data_o, tx_ready} = {tx_valid, tx_data, out_ready_i};
    assign tx_o = 1'b1;
    assign {framing_error, overflow} = '0;
    logic unused_wires;
    assign unused_wires = ^{rx_i, step_i};
  end else begin : gen_wires
    lipp_uart_rx i_uart_rx (
      .clk_i, .rst_ni(rst_n), .step_i, .rx_i, .valid_o(rx_valid), .ready_i(rx_ready),
      .data_o(rx_data), .framing_error_o(framing_error), .overflow_o(overflow)
    );
    lipp_uart_tx i_uart_tx (
      .clk_i, .rst_ni(rst_n), .step_i, .valid_i(tx_valid), .ready_o(tx_ready), .data_i(tx_data),
      .tx_o
    );
    assign in_ready_o = 1'b0;
    assign {out_valid_o, out_data_o} = '0;
    logic unused_bytes;
    assign unused_bytes = ^{in_valid_i, in_data_i, out_ready_i};
  end

  // ---- decode received packets, and encode the packets of replies ----
  logic decoded_valid, decoded_ready, decoded_end, decoded_bad;
  logic [7:0] decoded_data;
  lipp_cobs_decoder i_cobs_decoder (
    .clk_i, .rst_ni(rst_n), .in_valid_i(rx_valid), .in_ready_o(rx_ready), .in_data_i(rx_data),
    .out_valid_o(decoded_valid), .out_ready_i(decoded_ready), .out_data_o(decoded_data),
    .out_end_o(decoded_end), .out_bad_o(decoded_bad)
  );
  logic packet_valid, packet_ready, packet_last, request_valid, request_ready, request_last;
  logic [7:0] packet_data, request_data;
  logic accepted, dropped_long, dropped_cobs, dropped_short, dropped_crc;
  lipp_packet_fifo i_packet_fifo (
    .clk_i, .rst_ni(rst_n), .in_valid_i(decoded_valid), .in_ready_o(decoded_ready),
    .in_data_i(decoded_data), .in_end_i(decoded_end), .in_bad_i(decoded_bad),
    .out_valid_o(packet_valid), .out_ready_i(packet_ready), .out_data_o(packet_data),
    .out_last_o(packet_last), .accepted_o(accepted), .dropped_long_o(dropped_long),
    .dropped_cobs_o(dropped_cobs), .dropped_short_o(dropped_short), .dropped_crc_o(dropped_crc)
  );
  // Requests and replies cross long wires, and their ready signals come from deep logic. Skid
  // buffers register both directions and so break the combinational paths of requests and replies.
  lipp_skid_buffer #(.Width(9)) i_request_buffer (
    .clk_i, .rst_ni(rst_n), .clear_i('0), .in_valid_i(packet_valid), .in_ready_o(packet_ready),
    .in_data_i({packet_last, packet_data}), .out_valid_o(request_valid),
    .out_ready_i(request_ready), .out_data_o({request_last, request_data})
  );
  logic answer_valid, answer_ready, answer_last, reply_valid, reply_ready, reply_last;
  logic [7:0] answer_data, reply_data;
  lipp_skid_buffer #(.Width(9)) i_reply_buffer (
    .clk_i, .rst_ni(rst_n), .clear_i('0), .in_valid_i(answer_valid), .in_ready_o(answer_ready),
    .in_data_i({answer_last, answer_data}), .out_valid_o(reply_valid), .out_ready_i(reply_ready),
    .out_data_o({reply_last, reply_data})
  );
  lipp_packet_out i_packet_out (
    .clk_i, .rst_ni(rst_n), .in_valid_i(reply_valid), .in_ready_o(reply_ready),
    .in_data_i(reply_data), .in_last_i(reply_last), .out_valid_o(tx_valid),
    .out_ready_i(tx_ready), .out_data_o(tx_data)
  );

  // ---- reset all modules except the serial link ----

  // core_reset_q is active high, because many FPGA cells have an active-high reset.
  logic reset, core_reset_q, core_rst_n;
  always_ff @(posedge clk_i or negedge rst_n) begin
    if (!rst_n) core_reset_q <= 1'b1;
    else core_reset_q <= reset;
  end
  assign core_rst_n = !core_reset_q;

  // ---- execute requests ----
  logic bus_start, bus_write, bus_done, bus_error;
  logic [10:0] bus_at;
  logic [31:0] bus_word, bus_answer;
  logic tile_start, tile_empty, tile_valid, tile_ready, tile_done, tile_ok, stale, tile_bad;
  logic tile_last, part_valid, part_ready, part_last;  // part_*: tile data before the skid buffer
  logic [15:0] tile, table_at, epoch, present_epoch;
  logic [7:0] tile_coding, tile_data, part_data;
  logic [31:0] tile_crc, table_crc, present_crc;
  logic table_busy, table_front, present_start, present_done, frame_bad;
  lipp_link_pkg::reply_status_e present_status;
  logic ray_valid, ray_ready, trace, sign, exit_valid, exit_ready, trace_ready, sign_ready;
  logic [3:0][31:0] ray;
  logic [8:0][31:0] exit_words;
  logic sign_start, sign_done;
  logic [31:0] sign_rays, sign_crc;
  logic scene_late;     // 1: a scene pixel came too late for the video output
  // drawn: the optics draw the scene on the panel. update: a WRITE changes the scene's registers.
  logic drawn, update;
  logic [15:0] shown_slots;
  logic block_start, block_done, blocks_busy;
  logic [3:0] block_slot, blocks_slot;
  logic [7:0] block, block_word_at, blocks_at;
  logic [31:0] block_word, blocks_crc;
  lipp_dispatcher #(
    .Width(Width), .Height(Height), .ClockHz(ClockHz), .Layers(int'(Scene.layers)),
    .Slots(Draws ? int'(Scene.slots) : 1),
    .Blocks(Draws ? lipp_scene_pkg::blocks(Scene) : 1)
  ) i_dispatcher (
    .clk_i, .rst_ni(rst_n), .identity_i, .epoch_i(epoch), .reset_o(reset),
    .in_valid_i(request_valid), .in_ready_o(request_ready), .in_data_i(request_data),
    .in_last_i(request_last), .out_valid_o(answer_valid), .out_ready_i(answer_ready),
    .out_data_o(answer_data), .out_last_o(answer_last),
    .bus_start_o(bus_start), .bus_write_o(bus_write), .bus_at_o(bus_at), .bus_word_o(bus_word),
    .bus_done_i(bus_done), .bus_word_i(bus_answer), .bus_error_i(bus_error),
    .tile_start_o(tile_start), .tile_o(tile), .tile_coding_o(tile_coding),
    .tile_empty_o(tile_empty), .tile_valid_o(part_valid), .tile_ready_i(part_ready),
    .tile_data_o(part_data), .tile_last_o(part_last), .tile_done_i(tile_done),
    .tile_ok_i(tile_ok), .stale_o(stale), .tile_bad_o(tile_bad),
    .table_busy_i(table_busy), .table_front_o(table_front), .table_at_o(table_at),
    .table_crc_i(table_crc),
    .present_start_o(present_start), .present_epoch_o(present_epoch),
    .present_crc_o(present_crc), .present_done_i(present_done), .present_status_i(present_status),
    .ray_valid_o(ray_valid), .ray_ready_i(ray_ready), .ray_o(ray), .trace_o(trace),
    .exit_valid_i(exit_valid), .exit_ready_o(trace_ready), .exit_i(exit_words),
    .sign_o(sign), .sign_start_o(sign_start), .sign_done_i(sign_done),
    .sign_rays_i(sign_rays), .sign_crc_i(sign_crc), .drawn_i(drawn), .update_o(update),
    .slots_i(shown_slots), .block_start_o(block_start), .block_slot_o(block_slot), .block_o(block),
    .block_word_at_i(block_word_at), .block_word_o(block_word), .block_done_i(block_done),
    .blocks_busy_i(blocks_busy), .blocks_slot_o(blocks_slot), .blocks_at_o(blocks_at),
    .blocks_crc_i(blocks_crc)
  );

  // ---- connect the board's registers to the register bus ----
  logic late, frame_lost, frame_lost_q;
  lipp_board_registers_pkg::board_registers__in_t hwif_in;
  lipp_board_registers_pkg::board_registers__out_t hwif_out;
  logic psel_board, psel_optics, psel_scene, penable, pwrite;
  logic pready_board, pready_optics, pready_scene, pslverr_board, pslverr_optics, pslverr_scene;
  logic [2:0] pprot;
  logic [9:0] paddr;
  logic [3:0] pstrb;
  logic [31:0] pwdata, prdata_board, prdata_optics, prdata_scene;
  lipp_register_bus #(.Scene(Draws)) i_register_bus (
    .clk_i, .rst_ni(core_rst_n), .start_i(bus_start), .write_i(bus_write), .at_i(bus_at),
    .word_i(bus_word), .done_o(bus_done), .word_o(bus_answer), .error_o(bus_error),
    .m_apb_psel_board(psel_board), .m_apb_psel_optics(psel_optics),
    .m_apb_psel_scene(psel_scene), .m_apb_penable(penable),
    .m_apb_pwrite(pwrite), .m_apb_pprot(pprot), .m_apb_paddr(paddr), .m_apb_pwdata(pwdata),
    .m_apb_pstrb(pstrb), .m_apb_pready_board(pready_board), .m_apb_prdata_board(prdata_board),
    .m_apb_pslverr_board(pslverr_board), .m_apb_pready_optics(pready_optics),
    .m_apb_prdata_optics(prdata_optics), .m_apb_pslverr_optics(pslverr_optics),
    .m_apb_pready_scene(pready_scene), .m_apb_prdata_scene(prdata_scene),
    .m_apb_pslverr_scene(pslverr_scene)
  );
  lipp_board_registers i_registers (
    .clk(clk_i), .arst_n(core_rst_n),
    .s_apb_psel(psel_board), .s_apb_penable(penable), .s_apb_pwrite(pwrite), .s_apb_pprot(pprot),
    .s_apb_paddr(paddr[6:0]), .s_apb_pwdata(pwdata), .s_apb_pstrb(pstrb),
    .s_apb_pready(pready_board), .s_apb_prdata(prdata_board), .s_apb_pslverr(pslverr_board),
    .hwif_in, .hwif_out
  );
  logic [31:0] shown_crc, frames, clocks_q;
  always_ff @(posedge clk_i or negedge core_rst_n) begin
    if (!core_rst_n) clocks_q <= '0;
    else clocks_q <= clocks_q + 1'b1;
  end
  assign hwif_in.display_low.value.next = identity_i[31:0];
  assign hwif_in.display_high.value.next = identity_i[63:32];
  assign hwif_in.panel.width.next = 16'(Width);
  assign hwif_in.panel.height.next = 16'(Height);
  assign hwif_in.clock.value.next = 32'(ClockHz);
  assign hwif_in.epoch.value.next = epoch;
  assign hwif_in.shown_crc.value.next = shown_crc;
  assign hwif_in.frames.value.next = frames;
  assign hwif_in.clocks.value.next = clocks_q;
  assign hwif_in.counters.packets.count.incr = accepted;
  assign hwif_in.counters.framing.count.incr = framing_error;
  assign hwif_in.counters.overflow.count.incr = overflow;
  assign hwif_in.counters.dropped_cobs.count.incr = dropped_cobs;
  assign hwif_in.counters.dropped_crc.count.incr = dropped_crc;
  assign hwif_in.counters.dropped_long.count.incr = dropped_long;
  assign hwif_in.counters.dropped_short.count.incr = dropped_short;
  assign hwif_in.counters.stale.count.incr = stale;
  assign hwif_in.counters.tile_bad.count.incr = tile_bad;
  assign hwif_in.counters.frame_bad.count.incr = frame_bad;
  assign hwif_in.counters.late.count.incr = late;
  assign hwif_in.state.shown.next = shown_o;
  assign hwif_in.state.frame_lost.next = frame_lost;
  assign hwif_in.state.clock_lost.next = clock_lost_i;

  // ---- write received tiles into the frame store, and scan out frames ----
  lipp_optics_pkg::optics_config_t optics;
  localparam int TileBits = $clog2(lipp_panel_pkg::tiles(Width) * lipp_panel_pkg::tiles(Height)
      + 1);
  logic front, filled, swap, swapped;
  logic check_start, check_busy, check_done;
  logic [31:0] check_crc, presented_crc;
  logic copy_valid, copy_buffer, copy_ready, check_valid, check_buffer, check_ready;
  logic [PlaceBits-1:0] copy_first, check_first;
  logic [PlaceBits:0] copy_count, check_count;
  assign store_rst_no = core_rst_n;
  // The tile writer's ready signal has deep logic. The skid buffer i_tile_buffer keeps the tile
  // writer's logic out of the dispatcher's timing paths.
  lipp_skid_buffer #(.Width(9)) i_tile_buffer (
    .clk_i, .rst_ni(core_rst_n), .clear_i('0), .in_valid_i(part_valid), .in_ready_o(part_ready),
    .in_data_i({part_last, part_data}), .out_valid_o(tile_valid), .out_ready_i(tile_ready),
    .out_data_o({tile_last, tile_data})
  );
  lipp_tile_writer #(.Width(Width), .Height(Height)) i_tile_writer (
    .clk_i, .rst_ni(core_rst_n), .start_i(tile_start), .tile_i(tile), .coding_i(tile_coding),
    .buffer_i(!front), .empty_i(tile_empty), .done_o(tile_done), .ok_o(tile_ok),
    .crc_o(tile_crc), .valid_i(tile_valid), .ready_o(tile_ready), .data_i(tile_data),
    .last_i(tile_last), .write_valid_o, .write_ready_i, .write_buffer_o, .write_first_o,
    .write_count_o, .write_pixel_valid_o, .write_pixel_ready_i, .write_rgb_o, .write_done_i,
    .read_valid_o(copy_valid), .read_ready_i(read_ready_i && !check_busy),
    .read_buffer_o(copy_buffer), .read_first_o(copy_first), .read_count_o(copy_count),
    .read_pixel_valid_i(read_pixel_valid_i && !check_busy), .read_pixel_ready_o(copy_ready),
    .read_rgb_i
  );
  // A tile's entry in the tile table is invalid (0) from the start of a write of that tile until
  // the write ends without an error.
  lipp_tile_table #(.Width(Width), .Height(Height)) i_tile_table (
    .clk_i, .rst_ni(core_rst_n), .busy_o(table_busy),
    .write_i(tile_start || (tile_done && tile_ok)), .write_buffer_i(!front),
    .write_tile_i(tile[TileBits-1:0]), .write_crc_i(tile_start ? '0 : tile_crc),
    .read_buffer_i(table_front ? front : !front), .read_tile_i(table_at[TileBits-1:0]),
    .read_crc_o(table_crc)
  );
  logic unused_table;
  assign unused_table = ^table_at[15:TileBits];
  lipp_frame_check #(.Width(Width), .Height(Height)) i_frame_check (
    .clk_i, .rst_ni(core_rst_n), .start_i(check_start), .buffer_i(!front),
    .busy_o(check_busy), .done_o(check_done), .crc_o(check_crc), .read_valid_o(check_valid),
    .read_ready_i, .read_buffer_o(check_buffer), .read_first_o(check_first),
    .read_count_o(check_count), .read_pixel_valid_i, .read_pixel_ready_o(check_ready), .read_rgb_i
  );
  // Requests are executed one at a time, so no tile is copied while a frame is checked.
  assign {read_valid_o, read_buffer_o, read_first_o, read_count_o, read_pixel_ready_o} = check_busy
      ? {check_valid, check_buffer, check_first, check_count, check_ready}
      : {copy_valid, copy_buffer, copy_first, copy_count, copy_ready};
  lipp_presenter i_presenter (
    .clk_i, .rst_ni(core_rst_n), .start_i(present_start), .epoch_i(present_epoch),
    .crc_i(present_crc), .done_o(present_done), .status_o(present_status), .epoch_o(epoch),
    .shown_crc_o(presented_crc), .failed_o(frame_bad),
    .check_start_o(check_start), .check_done_i(check_done), .check_crc_i(check_crc),
    .swap_o(swap), .swapped_i(swapped)
  );
  logic unused_start, frame_end, scene_shown, want;
  logic [23:0] scene_rgb, stored_rgb;
  lipp_show_frame #(.Width(Width), .Height(Height)) i_show_frame (
    .clk_i, .rst_ni(core_rst_n), .begin_i(frame_end), .front_i(front),
    .shown_i(filled && !scene_shown), .swapped_i(swapped), .crc_i(presented_crc),
    .valid_o(show_valid_o), .ready_i(show_ready_i), .buffer_o(show_buffer_o),
    .first_o(show_first_o), .count_o(show_count_o), .pixel_valid_i(show_pixel_valid_i),
    .pixel_ready_o(show_pixel_ready_o), .pixel_rgb_i(show_rgb_i), .want_i(want && !scene_shown),
    .rgb_o(stored_rgb), .underflow_o(late), .lost_o(frame_lost)
  );
  lipp_scan_out #(
    .Width(Width), .Height(Height), .HFront(HFront), .HSync(HSync), .HBack(HBack),
    .VFront(VFront), .VSync(VSync), .VBack(VBack), .HPositive(HPositive), .VPositive(VPositive),
    .F(F), .Grid(int'(Build.grid)), .ClocksPerPixel(ClocksPerPixel)
  ) i_scan_out (
    .clk_i, .rst_ni(core_rst_n), .swap_i(swap), .swapped_o(swapped), .front_o(front),
    .filled_o(filled), .brightness_i(hwif_out.display.brightness.value),
    .pattern_i('{
      kind: lipp_panel_pkg::pattern_e'(pattern_i != '0 ? pattern_i
          : hwif_out.display.pattern.value),
      i: hwif_out.lens.i.value, j: hwif_out.lens.j.value
    }),
    .optics_i(optics), .frame_end_o(frame_end), .want_o(want),
    .pixel_i(scene_shown ? scene_rgb : stored_rgb), .pixel_o, .de_o,
    .hsync_o, .vsync_o, .rgb_o, .frame_start_o(unused_start), .shown_crc_o(shown_crc),
    .frames_o(frames)
  );

  // ---- pulse the outputs that drive the status LEDs ----
  assign shown_o = scene_shown || (filled && !frame_lost);
  always_ff @(posedge clk_i or negedge rst_n) begin
    if (!rst_n) {packet_o, error_o, frame_lost_q} <= '0;
    else {packet_o, error_o, frame_lost_q} <= {
      accepted, dropped_long || dropped_cobs || dropped_short || dropped_crc || framing_error
          || overflow || late || scene_late || (frame_lost && !frame_lost_q), frame_lost
    };
  end

  // ---- trace rays in the optics block ----
  typedef struct packed {
    logic signed [IndexBits-1:0] i, j;
    logic signed [F+3:0] x, y, z;
    logic signed [F+1:0] dx, dy, dz;
    lipp_optics_pkg::ray_status_e status;
    logic first, last;
  } exit_t;
  // traced: exit ray of the optics block; traced_q: after one skid buffer; exit: after two
  exit_t traced, traced_q, exit;
  logic traced_valid, traced_ready, traced_valid_q, exit_open, scene_open, unused_ray;
  assign unused_ray = ^{ray, exit.first};
  // Rays that enter the optics block's stream come from a TRACE request or from the panel's pixels.
  logic stream_valid, stream_ready, stream_first, stream_last;
  logic draw_valid, draw_first, draw_last;
  logic signed [PixelBits-1:0] stream_u, stream_v, draw_u, draw_v;
  assign stream_valid = drawn ? draw_valid : ray_valid;
  assign ray_ready = stream_ready && !drawn;
  assign {stream_u, stream_v} =
      drawn ? {draw_u, draw_v} : {ray[0][PixelBits-1:0], ray[1][PixelBits-1:0]};
  assign {stream_first, stream_last} = drawn ? {draw_first, draw_last} : '1;
  lipp_optics_block #(.Build(Build)) i_optics (
    .clk_i, .rst_ni(core_rst_n), .s_apb_psel(psel_optics), .s_apb_penable(penable),
    .s_apb_pwrite(pwrite), .s_apb_pprot(pprot), .s_apb_paddr(paddr[8:0]), .s_apb_pwdata(pwdata),
    .s_apb_pstrb(pstrb), .s_apb_pready(pready_optics), .s_apb_prdata(prdata_optics),
    .s_apb_pslverr(pslverr_optics),
    .ray_valid_i(stream_valid), .ray_ready_o(stream_ready), .ray_u_i(stream_u),
    .ray_v_i(stream_v), .ray_a_i(ray[2][F+1:0]), .ray_b_i(ray[3][F+1:0]),
    .ray_first_i(stream_first), .ray_last_i(stream_last),
    .exit_valid_o(traced_valid), .exit_ready_i(traced_ready), .exit_i_o(traced.i),
    .exit_j_o(traced.j),
    .exit_x_o(traced.x), .exit_y_o(traced.y), .exit_z_o(traced.z), .exit_dx_o(traced.dx),
    .exit_dy_o(traced.dy), .exit_dz_o(traced.dz), .exit_status_o(traced.status),
    .exit_first_o(traced.first), .exit_last_o(traced.last), .optics_o(optics)
  );
  // The optics block, the scene and the other receivers of exit rays lie far apart on the FPGA.
  // Skid buffers register both directions of the handshake at each of these modules.
  lipp_skid_buffer #(.Width($bits(exit_t))) i_left_buffer (
    .clk_i, .rst_ni(core_rst_n), .clear_i('0), .in_valid_i(traced_valid), .in_ready_o(traced_ready),
    .in_data_i(traced), .out_valid_o(traced_valid_q), .out_ready_i(drawn ? scene_open : exit_open),
    .out_data_o(traced_q)
  );
  lipp_skid_buffer #(.Width($bits(exit_t))) i_exit_buffer (
    .clk_i, .rst_ni(core_rst_n), .clear_i('0), .in_valid_i(traced_valid_q && !drawn),
    .in_ready_o(exit_open), .in_data_i(traced_q), .out_valid_o(exit_valid),
    .out_ready_i(exit_ready),
    .out_data_o(exit)
  );
  assign exit_words = {
    32'(exit.status), 32'(exit.dz), 32'(exit.dy), 32'(exit.dx), 32'(exit.z), 32'(exit.y),
    32'(exit.x), 32'(exit.j), 32'(exit.i)
  };
  // If no SIGN request asked for a frame's signature, the exit rays of that frame are dropped.
  assign exit_ready = trace ? trace_ready : sign_ready || !sign;
  lipp_ray_signature i_ray_signature (
    .clk_i, .rst_ni(core_rst_n), .start_i(sign_start), .ray_valid_i(exit_valid && sign),
    .ray_ready_o(sign_ready), .ray_i(exit_words), .ray_last_i(exit.last), .done_o(sign_done),
    .rays_o(sign_rays), .crc_o(sign_crc)
  );

  // ---- draw the scene from the exit rays ----
  if (Draws) begin : gen_scene
    localparam int Blanking = ((VSync + VBack) * (HSync + HBack + Width + HFront) + HSync + HBack)
        * ClocksPerPixel;
    // Number of clocks from the start of a video frame to its first drawn pixel: the sum of the
    // latencies of draw_frame, optics_block, the skid buffers and the scene.
    localparam int Latency = 2 + lipp_optics_pkg::ray_latency(Build) + 7
        + lipp_scene_pkg::scene_latency(F, Scene) + 5 + ClocksPerPixel;
    if (Blanking < Latency) begin : gen_illegal_blanking
      $fatal(1,
          "lipp_board: blanking before the first pixel must last %0d clocks for the scene, not %0d",
             Latency, Blanking);
    end

    lipp_scene_pkg::scene_config_t config_set;
    logic source, take, frame_drawn, pixel_valid, pixel_ready;
    logic unused_busy, unused_idle, unused_pixel_first, unused_pixel_last;
    logic [23:0] pixel_rgb;
    lipp_scene_block #(.Scene(Scene)) i_scene_block (
      .clk_i, .rst_ni(core_rst_n), .s_apb_psel(psel_scene), .s_apb_penable(penable),
      .s_apb_pwrite(pwrite), .s_apb_pprot(pprot), .s_apb_paddr(paddr), .s_apb_pwdata(pwdata),
      .s_apb_pstrb(pstrb), .s_apb_pready(pready_scene), .s_apb_prdata(prdata_scene),
      .s_apb_pslverr(pslverr_scene), .config_o(config_set), .source_o(source), .take_i(take),
      .shown_i(scene_shown), .slots_o(shown_slots), .drawn_i(frame_drawn), .underflow_i(scene_late)
    );
    lipp_draw_frame #(
      .Width(Width), .Height(Height), .SamplesBits(int'(Scene.samples_bits))
    ) i_draw_frame (
      .clk_i, .rst_ni(core_rst_n), .begin_i(frame_end), .source_i(source), .hold_i(update),
      .take_o(take), .shown_o(scene_shown), .owns_o(drawn), .ray_valid_o(draw_valid),
      .ray_ready_i(stream_ready && drawn), .ray_u_o(draw_u), .ray_v_o(draw_v),
      .ray_first_o(draw_first), .ray_last_o(draw_last), .pixel_valid_i(pixel_valid),
      .pixel_ready_o(pixel_ready), .pixel_rgb_i(pixel_rgb), .want_i(want && scene_shown),
      .rgb_o(scene_rgb), .underflow_o(scene_late), .drawn_o(frame_drawn)
    );
    logic slot_write;
    logic [3:0] slot;
    logic [19:0] slot_at;
    logic [7:0] slot_data;
    lipp_slot_loader #(
      .Slots(int'(Scene.slots)), .Blocks(lipp_scene_pkg::blocks(Scene))
    ) i_slot_loader (
      .clk_i, .rst_ni(core_rst_n), .start_i(block_start), .slot_i(block_slot), .block_i(block),
      .word_at_o(block_word_at), .word_i(block_word), .done_o(block_done), .write_o(slot_write),
      .write_slot_o(slot), .write_at_o(slot_at), .write_data_o(slot_data), .busy_o(blocks_busy),
      .read_slot_i(blocks_slot), .read_at_i(blocks_at), .read_crc_o(blocks_crc)
    );
    exit_t scene_ray;
    logic scene_ray_valid, scene_ray_ready;
    lipp_skid_buffer #(.Width($bits(exit_t))) i_seen_buffer (
      .clk_i, .rst_ni(core_rst_n), .clear_i('0), .in_valid_i(traced_valid_q && drawn),
      .in_ready_o(scene_open), .in_data_i(traced_q), .out_valid_o(scene_ray_valid),
      .out_ready_i(scene_ray_ready), .out_data_o(scene_ray)
    );
    lipp_scene #(.F(F), .Scene(Scene)) i_scene (
      .clk_i, .rst_ni(core_rst_n), .config_i(config_set), .take_i(take), .busy_o(unused_busy),
      .idle_o(unused_idle), .write_i(slot_write), .write_slot_i(slot), .write_at_i(slot_at),
      .write_data_i(slot_data), .exit_valid_i(scene_ray_valid), .exit_ready_o(scene_ray_ready),
      .exit_i_i(scene_ray.i), .exit_j_i(scene_ray.j), .exit_x_i(scene_ray.x),
      .exit_y_i(scene_ray.y),
      .exit_z_i(scene_ray.z), .exit_dx_i(scene_ray.dx), .exit_dy_i(scene_ray.dy),
      .exit_dz_i(scene_ray.dz),
      .exit_status_i(scene_ray.status), .exit_first_i(scene_ray.first),
      .exit_last_i(scene_ray.last),
      .pixel_valid_o(pixel_valid), .pixel_ready_i(pixel_ready), .pixel_rgb_o(pixel_rgb),
      .pixel_first_o(unused_pixel_first), .pixel_last_o(unused_pixel_last)
    );
  end else begin : gen_no_scene
    assign {drawn, scene_shown, scene_late, scene_rgb, shown_slots, scene_open} = '0;
    assign {draw_valid, draw_u, draw_v, draw_first, draw_last} = '0;
    assign {pready_scene, prdata_scene, pslverr_scene} = '0;
    assign {block_done, block_word_at, blocks_busy, blocks_crc} = '0;
    logic unused_scene;
    assign unused_scene = ^{
      update, psel_scene, paddr[9], block_start, block_slot,
      block, block_word, blocks_slot, blocks_at
    };
  end

endmodule

`default_nettype wire
